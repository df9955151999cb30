"""What a flight shows to ground stations: values to plot, its path, the heartbeat's status."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from moar_companion.companion.safety.check_inputs import Host
from moar_companion.companion.safety.conditions import CONDITIONS
from moar_companion.mavlink.autopilots import profile
from moar_companion.mavlink.component.named_values import NAMED_VALUES
from moar_companion.mavlink.dialect import create
from moar_companion.types import GeodeticPoint

from ..mavlink.peer import Peer
from .commands import LINKS, OPERATOR_LINK
from .desk import EXIT, INSPECTION, LINK, RELEASE, Desk
from .watched import Watched, by_line

STANDBY, ACTIVE, CRITICAL, EMERGENCY = 3, 4, 5, 6
INT_UNKNOWN = 0xFFFFFFFF


def at(state, **options):
    return Desk(links=LINKS, **options).come_to(state)


def last_second(desk, kind, link=OPERATOR_LINK):
    return [
        message
        for time_s, on, message in desk.sent
        if on == link and message.get_type() == kind and time_s > desk.now_s - 1.0
    ]


def plotted(desk, link=OPERATOR_LINK):
    """The last values by name."""
    kinds = ("NAMED_VALUE_FLOAT", "NAMED_VALUE_INT")
    return {m.name: m.value for kind in kinds for m in last_second(desk, kind, link)}


def status(desk):
    return desk.run(1.2).messages("HEARTBEAT")[-1].system_status


def condition_number(name):
    return [condition.name for condition in CONDITIONS].index(name) + 1


# Values to plot


def test_a_flight_shows_its_state_target_and_way():
    desk = at("flying").run(1.2)
    values = plotted(desk)
    assert (values["M_STATE"], values["M_TARGET"], values["CONDITION"]) == (3, 0, 0)
    assert values == plotted(desk, LINK)
    assert 0.0 < values["TO_GO"] < 60.0
    assert values["CLEARANCE"] == pytest.approx(
        desk.companion.state.routes.limits.clearance_m(desk.companion.pose), abs=1.5
    )
    later = plotted(desk.run(1.0))
    assert later["TO_GO"] < values["TO_GO"]
    assert later.keys() <= NAMED_VALUES.keys()


def test_what_is_unknown_is_not_sent():
    values = plotted(at("idle").run(1.2))
    assert values["M_STATE"] == 0
    assert {"TO_GO", "M_TARGET", "RESERVE_S"} & values.keys() == set()


def test_the_reserve_is_that_of_the_better_escape_route():
    desk = Desk(links=LINKS)
    desk.contingencies = True
    desk.come_to("flying").run(4.0)
    route = desk.companion.state.risk_monitor.escape_route
    assert plotted(desk)["RESERVE_S"] == pytest.approx(route.left_s, rel=0.05)


def test_an_escape_has_no_target():
    desk = at("flying").order(EXIT).run(1.5)
    values = plotted(desk)
    assert values["M_STATE"] in {3, 5}
    assert "M_TARGET" not in values


# The heartbeat's status


def test_the_status_follows_what_the_companion_does():
    desk = at("idle")
    assert status(desk) == STANDBY
    assert status(desk.order(INSPECTION)) == ACTIVE
    assert status(desk.run(1.1).send_heartbeat(desk.ours)) == ACTIVE


@pytest.mark.slow
def test_a_flight_that_a_condition_holds_is_critical_and_shows_its_number():
    desk = at("flying").set(wind_mps=17.0).run_until("holding", 10.0)
    assert status(desk) == CRITICAL
    assert plotted(desk)["CONDITION"] == condition_number("wind")
    desk.set(wind_mps=2.0).run_until("flying", 40.0)
    assert status(desk) == ACTIVE
    assert plotted(desk)["CONDITION"] != condition_number("wind")


def test_an_aircraft_that_is_released_in_the_air_is_an_emergency_until_it_is_on_the_ground():
    desk = at("flying").set(mute={"LOCAL_POSITION_NED"}).run(2.0)
    assert desk.state == "released"
    assert status(desk) == EMERGENCY
    assert status(desk.set(armed=False)) == STANDBY


def test_after_a_stall_the_emergency_lasts_until_a_pilot_takes_the_mode():
    desk = at("flying")
    desk.step(1.5)
    for _ in range(4):
        assert (status(desk), desk.state) == (EMERGENCY, "released")
    assert status(desk.send_heartbeat(0x00030000)) == STANDBY


def test_an_emergency_outlasts_its_cause_and_ends_with_an_operators_release():
    desk = at("flying").set(mute={"LOCAL_POSITION_NED"}).run(2.0)
    assert status(desk.set(mute=set()).run(2.0)) == EMERGENCY
    assert status(desk.order(RELEASE)) == STANDBY


def test_a_release_that_an_operator_orders_is_no_emergency():
    desk = at("flying").order(RELEASE)
    assert (status(desk), desk.state) == (STANDBY, "released")


def test_a_stall_before_control_is_no_emergency():
    desk = at("ready")
    desk.step(1.5)
    assert (status(desk), desk.state) == (STANDBY, "released")


def test_a_pilot_who_takes_over_is_no_emergency():
    assert status(at("flying").send_heartbeat(0x00030000)) == STANDBY


# The path


def download(desk):
    """The mission that a ground station downloads from the companion."""

    def ask(name, **fields):
        since_s = desk.now_s
        message = create(name, target_system=1, target_component=195, mission_type=0, **fields)
        desk.handle(desk.operator.pack(message), OPERATOR_LINK).run(0.1)
        kinds = ("MISSION_COUNT", "MISSION_ITEM_INT")
        (answer,) = [m for kind in kinds for m in desk.messages(kind, since_s)]
        return answer

    count = ask("MISSION_REQUEST_LIST").count
    items = [ask("MISSION_REQUEST_INT", seq=number) for number in range(count)]
    accepted = create("MISSION_ACK", target_system=1, target_component=195, type=0, mission_type=0)
    desk.handle(desk.operator.pack(accepted), OPERATOR_LINK)
    return [(item.x * 1e-7, item.y * 1e-7, item.z) for item in items]


def test_the_path_to_the_target_is_downloaded_as_a_mission():
    desk = at("flying")
    assert desk.planner.site.targets
    places = download(desk)
    goal = desk.site.targets[0].position_m
    end = desk.site.frame.to_geodetic((goal[0], 0.0, goal[1]))
    assert 2 <= len(places) < 40
    cell_m = desk.site.workspace.resolution_m
    assert places[-1][0] == pytest.approx(end.latitude_deg, abs=cell_m * 1e-5)
    assert places[-1][1] == pytest.approx(end.longitude_deg, abs=cell_m * 2e-5)
    assert places[-1][2] == pytest.approx(end.altitude_amsl_m, abs=cell_m)


def test_the_mission_is_where_the_autopilot_will_report_the_aircraft_by_the_line():
    desk = by_line(Watched(links=LINKS).run(2.0), 0.9, -0.6).run(0.3).come_to("flying")
    state = desk.companion.state
    assert state.pose_tracker.offset_m == pytest.approx((0.9, -0.6))
    places = download(desk)
    origin = state.telemetry.local_origin.point
    corners_m = state.routes.flight.corners_m()
    assert len(places) == len(corners_m) >= 2
    for (latitude_deg, longitude_deg, altitude_m), corner_m in zip(places, corners_m, strict=True):
        point = GeodeticPoint(
            latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_amsl_m=altitude_m
        )
        flown_ned_m = state.pose_tracker.plane.position_to_ned(corner_m)
        assert profile("px4").to_local_ned(point, origin) == pytest.approx(flown_ned_m, abs=0.05)


def test_without_a_path_the_mission_is_empty():
    assert download(at("idle")) == []
    assert download(at("flying").send_heartbeat(0x00030000).run(1.0)) == []


@pytest.mark.parametrize("component_id", [0, 1, 190, 191])
def test_a_request_with_the_vehicles_system_id_gets_no_answer_that_clears_its_mission(component_id):
    desk, sender = at("flying"), Peer(1, component_id)
    since_s = desk.now_s
    for link in (LINK, OPERATOR_LINK):
        for name, fields in (
            ("MISSION_REQUEST_LIST", {}),
            ("MISSION_REQUEST_INT", {"seq": 0}),
            ("MISSION_CLEAR_ALL", {}),
        ):
            message = create(name, target_system=1, target_component=195, mission_type=0, **fields)
            desk.handle(sender.pack(message), link).run(0.1)
    kinds = ("MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_ACK")
    assert [m for kind in kinds for m in desk.messages(kind, since_s)] == []
    assert len(download(desk)) >= 2


def test_an_upload_is_denied_with_a_text_on_its_link_and_the_flight_goes_on():
    desk = at("flying")
    fields = {"count": 3, "mission_type": 0, "opaque_id": 0}
    upload = create("MISSION_COUNT", target_system=1, target_component=195, **fields)
    desk.handle(desk.operator.pack(upload), OPERATOR_LINK).run(0.5)
    assert [m.type for m in last_second(desk, "MISSION_ACK")] == [14]
    words = "MOAR: mission commands go to component 1, denied"
    assert words in [m.text for m in last_second(desk, "STATUSTEXT")]
    assert words not in [m.text for m in last_second(desk, "STATUSTEXT", LINK)]
    assert desk.state == "flying"


def test_the_next_corners_of_the_path_are_drawn_for_operators_alone():
    desk = at("flying").run(1.5)
    kind = "TRAJECTORY_REPRESENTATION_WAYPOINTS"
    assert last_second(desk, kind, LINK) == []
    ahead = last_second(desk, kind)[-1]
    assert 1 <= ahead.valid_points <= 5
    points = list(zip(ahead.pos_x, ahead.pos_y, ahead.pos_z, strict=True))
    assert all(math.isnan(value) for point in points[ahead.valid_points :] for value in point)
    corners = points[: ahead.valid_points]
    setpoint = desk.setpoints()[-1]
    way = [(setpoint.x, setpoint.y, setpoint.z), *corners]
    assert sum(math.dist(*step) for step in pairwise(way)) <= plotted(desk)["TO_GO"] + 1.0
    assert ahead.command == [0xFFFF] * 5


def test_without_a_path_no_corner_is_drawn():
    desk = at("idle").run(3.0)
    assert desk.messages("TRAJECTORY_REPRESENTATION_WAYPOINTS") == []


# The computer


def test_the_computers_memory_and_disk_are_sent_as_far_as_they_are_known():
    desk = at("idle").run(1.0)
    assert desk.messages("ONBOARD_COMPUTER_STATUS") == []
    desk.companion.note_host(Host(memory_available=2**30, memory_total=4 * 2**30, disk_free=1.0))
    desk.run(3.0)
    sent = desk.messages("ONBOARD_COMPUTER_STATUS")
    assert 4 <= len(sent) <= 8  # at most once a second on each of two links
    assert (sent[-1].ram_usage, sent[-1].ram_total) == (3 * 1024, 4 * 1024)
    assert sent[-1].storage_total == [INT_UNKNOWN] * 4
    assert sent[-1].cpu_cores == [255] * 8
    assert sent[-1].link_tx_rate == [INT_UNKNOWN] * 6
