"""The autopilot's fence compared with a small site: each kind of finding by a fence that has it."""

from moar_companion.companion.preflight.aircraft_check import Preflight
from moar_companion.companion.preflight.fence_check import fence_findings
from moar_companion.companion.preflight.findings import Level
from moar_companion.companion.preflight.site_routes import routes_of
from moar_companion.mavlink.autopilots.fence import Area, Fence, Limit
from moar_companion.mavlink.dialect import mavlink
from moar_companion.planner.plan_values import PlanStatus
from moar_companion.planner.planner import Planner
from moar_companion.settings.config import CompanionConfig, shipped_configs
from moar_companion.settings.link_config import LinkConfig
from moar_companion.types import PX4

from ..losses import loss_of
from ..mavlink.peer import Peer
from ..planner.problems import FRAME, make_site, make_vehicle, polygon

OK, NOTE, WARNING, NO_GO = Level
PLANNER = Planner(
    make_site(
        start=(3.5, 0.5), targets={"near": (3.5, 5.5), "far": (8.5, 5.5)}, exits=[(1.5, 0.0)]
    ),
    make_vehicle(),
)
HOME_M = (0.0, 0.0, 0.0)


def circle(radius_m):
    return Limit(parameter="GF_MAX_HOR_DIST", value_m=radius_m)


def keep_away(x_m, radius_m):
    """An uploaded circle around a place of the plane that the aircraft must stay out of."""
    place = FRAME.to_geodetic((x_m, 0.0, 0.0))
    return Area(
        name="exclusion circle 1",
        inclusion=False,
        vertices_deg=((place.latitude_deg, place.longitude_deg),),
        radius_m=radius_m,
    )


def found(fence, *, planner=PLANNER, home_m=HOME_M, margin_m=0.5):
    findings = fence_findings(planner, fence, home_m, margin_m, reported=True)
    return [(item.level, item.subject, item.text) for item in findings]


def test_a_fence_that_cuts_only_unused_space_is_kept_by_all_targets_and_routes():
    assert found(Fence(circle=circle(9.6), action="hold"), margin_m=0.5) == [
        (NOTE, "fence", "GF_MAX_HOR_DIST 9.6 m; outside the autopilot would hold"),
        (OK, "fence", "all targets and routes keep 0.5 m from it"),
    ]


def test_a_target_outside_the_fence_is_a_no_go_and_the_others_are_not_named():
    assert found(Fence(circle=circle(6.0)))[1:] == [
        (NO_GO, "target far", "(8.5, 5.5) is outside GF_MAX_HOR_DIST 6 m, less 0.5 m")
    ]


def test_routes_that_an_exclusion_area_cuts_are_a_no_go():
    findings = found(Fence(areas=(keep_away(5.5, 0.5),)))
    assert findings[1:] == [
        (NO_GO, "target far", f"{route}: no path inside exclusion circle 1, less 0.5 m")
        for route in ("exit", "from near")
    ]


def test_a_landing_point_whose_approach_is_outside_the_fence_is_a_no_go():
    findings = found(Fence(areas=(keep_away(1.5, 0.5),)))
    text = "(1.5, 0) cannot be reached inside exclusion circle 1, less 0.5 m"
    assert findings[1:] == [(NO_GO, "landing exit 0", text)]


def test_a_landing_point_that_nothing_reaches_is_not_blamed_on_the_fence():
    floor = polygon((-60.0, -1.4), (60.0, -1.4), (60.0, -1.2), (-60.0, -1.2))
    site = make_site(floor, targets={"near": (2.5, 5.5)}, exits=[(1.5, -10.0)])
    planner = Planner(site, make_vehicle())
    findings = found(Fence(areas=(keep_away(8.5, 0.5),)), planner=planner)
    assert findings[1:] == [(OK, "fence", "all targets and routes keep 0.5 m from it")]


def test_a_fence_about_an_unknown_home_is_a_no_go():
    unplaced = found(Fence(circle=circle(100.0)), home_m=None)
    assert unplaced[1:] == [(NO_GO, "fence", "the fence is relative to home, and home is unknown")]


def test_an_uploaded_area_needs_no_home():
    findings = found(Fence(areas=(keep_away(50.0, 5.0),)), home_m=None)
    assert findings[1:] == [(OK, "fence", "the whole site and its landing points are inside")]


def test_a_fence_judged_by_the_receivers_position_is_a_warning():
    findings = found(Fence(circle=circle(9.6), source_gnss="GF_SOURCE"))
    text = "1: the fence is judged by the receiver's position, not by the estimator's"
    assert (WARNING, "GF_SOURCE", text) in findings


def test_without_a_site_only_the_limits_of_the_fence_are_listed():
    assert found(Fence(circle=circle(6.0), action="hold"), planner=None) == [
        (NOTE, "fence", "GF_MAX_HOR_DIST 6 m; outside the autopilot would hold")
    ]


# Without a plan, or without a known autopilot


def test_a_route_without_a_path_has_no_time_and_no_objection():
    wall = polygon((5.2, -1.0), (5.8, -1.0), (5.8, 20.0), (5.2, 20.0))
    planner = Planner(make_site(wall), make_vehicle())
    ((route,),) = routes_of(planner).values()
    falls = loss_of(PX4, COM_OBL_RC_ACT=7.0)
    assert route.plan.status is PlanStatus.UNREACHABLE
    assert (route.flown_s(planner), route.objection(planner, falls, None)) == (0.0, None)
    free = Planner(make_site(), make_vehicle())
    ((route,),) = routes_of(free).values()
    assert route.objection(free, falls, None) is not None


def test_of_an_unknown_autopilot_no_fence_is_reported():
    config = CompanionConfig(vehicle=shipped_configs(), links=(LinkConfig(url="udp"),))
    check, peer = Preflight(config, PLANNER.vehicle, PLANNER), Peer(1, 1)
    for second in range(25):
        check.receive("udp", peer.heartbeat(autopilot=mavlink.MAV_AUTOPILOT_GENERIC), second)
        check.tick(float(second))
    found = {item.subject: item.level for item in check.findings()}
    assert found["autopilot"] is NO_GO
    assert "fence" not in found
