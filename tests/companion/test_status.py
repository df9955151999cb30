"""Status of a companion on the desk."""

import json
import math
from dataclasses import replace

import pytest

from moar_companion.companion.companion import Companion
from moar_companion.companion.guidance.path_follower import PathFollower
from moar_companion.companion.reports import Decision
from moar_companion.companion.status import LatestDecisions
from moar_companion.mavlink.session import Severity
from moar_companion.mavlink.signing import Signing, SigningKey
from moar_companion.mavlink.telemetry import LinkStatistics
from moar_companion.settings.config import CompanionConfig, shipped_configs
from moar_companion.settings.link_config import LinkConfig
from moar_companion.settings.vehicle import Vehicle

from ..mavlink.peer import Peer
from ..mavlink.signed import OTHER_SECRET, SECRET, SignedPeer
from .desk import EXIT, Desk
from .scripted_autopilot import POSCTL


def status_of(desk, latest=None, recorder=None):
    latest = latest or LatestDecisions()
    latest.note(desk.decisions, desk.companion.telemetry.link)
    status = latest.status_of(desk.companion, desk.now_s, clock_offset_s=1000.0, recorder=recorder)
    return json.loads(json.dumps(status, allow_nan=False))


def counted(received_s, packets, lost=0):
    return LinkStatistics(received_s=received_s, packets_received=packets, packets_lost=lost)


def test_before_anything_is_received_all_values_are_null_and_the_risks_unknown():
    status = status_of(Desk())
    assert status["autopilot"] is status["path"] is status["plan"] is status["link"] is None
    assert status["mission"] == dict.fromkeys(
        ("for_s", "mission", "goal", "text", "text_age_s"), None
    ) | {"state": "idle"}
    assert set(status["aircraft"].values()) == {None}
    assert set(status["age_s"].values()) == {None}
    assert status["recorder"] is status["refused"] is status["gate"] is None
    assert [index["known"] for index in status["risk"].values()] == [False] * 4
    assert status["time_s"] == 1050.0


def test_refusals_of_signed_links_are_counted_before_any_autopilot_is_received():
    config = CompanionConfig(
        vehicle=shipped_configs(),
        links=(LinkConfig(url="a", signed=True), LinkConfig(url="b")),
    )
    vehicle = Vehicle.load(shipped_configs() / "vehicles" / "x500.yaml")
    signing = Signing(key=SigningKey(SECRET), wall_s=0.0)
    companion = Companion(config, vehicle, None, signing=signing)
    companion.tick(1.0)
    companion.receive("a", Peer(1, 1).heartbeat() * 2, 1.0)
    companion.receive("a", SignedPeer(secret=OTHER_SECRET).heartbeat(), 1.0)
    status = LatestDecisions().status_of(companion, 1.0, clock_offset_s=0.0, recorder=None)
    assert status["refused"] == {"a": {"unsigned": 2, "wrong": 1, "old": 0}}
    assert status["autopilot"] is None


def test_in_flight_the_status_has_the_position_and_the_flown_mission():
    desk = Desk().come_to("flying", then_s=0.5)
    status = status_of(desk)
    assert status["autopilot"]["kind"] == "px4"
    assert (status["autopilot"]["ours"], status["autopilot"]["armed"]) == (True, True)
    mission = status["mission"]
    assert (mission["state"], mission["mission"]) == ("flying", "inspection")
    assert mission["goal"] == desk.site.targets[0].name
    assert mission["text"].startswith("MOAR: flying inspection")
    assert mission["for_s"] == pytest.approx(0.5, abs=0.1)
    aircraft = status["aircraft"]
    assert aircraft["position_ned_m"] == pytest.approx(desk.position_ned_m, abs=0.1)
    assert aircraft["position_m"] == pytest.approx(desk.companion.pose.position_m)
    assert aircraft["landed"] == "in_air"
    assert status["weights"]["base"] != status["weights"]["adjusted"]
    assert sum(status["weights"]["adjusted"].values()) == pytest.approx(1.0)


def test_the_status_tells_what_companion_and_autopilot_do_after_a_loss():
    assert status_of(Desk())["failsafes"] is None
    desk = Desk().come_to("flying")
    found = {
        (item["trigger"], item["by"]): item for item in status_of(desk)["failsafes"]["actions"]
    }
    limits = desk.companion.state.config.supervision
    ground = found["ground station", "companion"]
    assert (ground["action"], ground["after_s"]) == ("hold", limits.ground_link_lost_s)
    limits = desk.companion.state.routes.limits
    loss = found["companion loss", "autopilot"]
    assert (loss["action"], loss["after_s"]) == (limits.offboard_loss.loss.action.value, None)
    assert len(found) == len(limits.watch.enabled.actions) + 1


def test_the_setpoint_of_the_status_is_the_one_that_was_sent():
    desk = Desk().come_to("flying", then_s=2.0)
    sent = desk.setpoints()[-1]
    path = status_of(desk)["path"]
    plane = desk.companion.state.pose_tracker.plane
    ned_m = plane.position_to_ned(tuple(path["setpoint"]["position_m"]))
    assert ned_m == pytest.approx((sent.x, sent.y, sent.z), abs=1e-4)
    assert math.dist(ned_m, desk.position_ned_m) == pytest.approx(path["error_m"], abs=0.1)


@pytest.mark.uncounted
def test_the_remaining_path_shrinks_to_zero_at_the_target_at_the_reported_speed():
    desk = Desk().come_to("flying", then_s=0.5)
    left = status_of(desk)["path"]
    began_s = desk.now_s
    desk.run_until("at_target", 2.0 * left["left_s"])
    assert desk.now_s - began_s == pytest.approx(left["left_s"], rel=0.2, abs=1.0)
    assert left["left_m"] > status_of(desk)["path"]["left_m"]


def test_clearance_is_from_the_hull_to_the_nearest_obstacle():
    desk = Desk().come_to("ready")
    x_m, _, z_m = desk.companion.pose.position_m
    nearest_m = min(
        math.dist((x_m, z_m), item.position_m) - item.radius_m
        for item in desk.site.obstacles
        if hasattr(item, "radius_m")
    )
    clearance_m = status_of(desk)["aircraft"]["clearance_m"]
    assert 0.0 < clearance_m <= nearest_m - desk.vehicle.radius_m + 1e-6


def test_without_a_site_there_is_no_place_and_no_clearance():
    aircraft = status_of(Desk(with_site=False).run(2.0))["aircraft"]
    assert aircraft["position_m"] is aircraft["clearance_m"] is None
    assert aircraft["position_ned_m"] is not None


def test_the_status_keeps_the_last_setpoint_that_the_gate_refused(monkeypatch):
    desk = Desk().come_to("flying", then_s=2.0)
    assert status_of(desk)["gate"] is None
    of_now = PathFollower.setpoint

    def jumped(*arguments):
        setpoint = of_now(*arguments)
        x_m, y_m, z_m = setpoint.position_m
        return replace(setpoint, position_m=(x_m, y_m + 0.3, z_m))

    with monkeypatch.context() as once:
        once.setattr(PathFollower, "setpoint", jumped)
        desk.step()
    desk.run(2.0)
    gate = status_of(desk)["gate"]
    assert (gate["action"], gate["reason"], gate["unit"]) == (
        "held",
        "setpoint jumps by 0.3 m",
        "m",
    )
    assert gate["value"] == pytest.approx(0.3, abs=0.02)
    assert gate["limit"] < gate["value"]
    assert gate["age_s"] == pytest.approx(2.0, abs=0.05)


def test_a_pilot_who_takes_over_ends_the_path():
    desk = Desk().come_to("flying").send_heartbeat(POSCTL).run(0.2)
    status = status_of(desk)
    assert status["mission"]["state"] == "overridden"
    assert status["path"] is None


def test_the_last_plan_is_the_one_flown_with_its_request():
    desk, latest = Desk().come_to("flying", then_s=3.0), LatestDecisions()
    plan = status_of(desk, latest)["plan"]
    assert (plan["status"], plan["mission"]) == ("found", "inspection")
    assert plan["cost"]["total"] > 0.0
    assert plan["replans"] == len(desk.decided("replan")) > 0
    assert plan["paths"] == len(desk.decided("plan"))
    desk.decisions.clear()
    desk.order(EXIT).run(1.0)
    plan = status_of(desk, latest)["plan"]
    assert (plan["mission"], plan["reason"]) == ("exit", "an order")
    assert plan["age_s"] <= 1.0


def test_a_new_plan_has_the_reason_of_its_request():
    latest = LatestDecisions()
    plan = Desk().come_to("flying").decided("plan")[-1]
    why = plan["explanation"] | {"reason": "wind risk 0.10 -> 0.32"}
    latest.note(
        [
            Decision(time_s=1.0, kind="replan", data={"reason": "wind risk 0.10 -> 0.32"}),
            Decision(time_s=1.2, kind="plan", data=plan | {"first": False, "explanation": why}),
            Decision(time_s=2.0, kind="replan", data={"reason": "time"}),
        ],
        None,
    )
    status = latest.status_of(Desk().companion, 3.0, clock_offset_s=0.0, recorder=None)
    assert status["plan"]["reason"] == "wind risk 0.10 -> 0.32"
    assert status["plan"]["age_s"] == pytest.approx(1.8)
    assert status["plan"]["replans"] == 2


def test_an_index_names_its_inputs_and_the_one_that_decides():
    risk = status_of(Desk().come_to("ready"))["risk"]["communication"]
    assert risk["worst"] in {item["name"] for item in risk["inputs"]}
    assert set(risk["inputs"][0]) == {
        *("name", "value", "unit", "reading", "age_s", "risk", "known")
    }
    unheard = next(item for item in risk["inputs"] if item["name"] == "radio margin here")
    assert unheard["value"] is unheard["age_s"] is unheard["risk"] is None


def test_the_packet_rate_is_counted_over_a_second_and_restarts_when_counts_go_back():
    desk, latest = Desk().run(1.2), LatestDecisions()

    def rate_hz(link):
        latest.note([], link)
        status = latest.status_of(desk.companion, desk.now_s, clock_offset_s=0.0, recorder=None)
        return status["link"]["rate_hz"]

    assert rate_hz(counted(10.0, 100)) is None
    assert rate_hz(counted(10.5, 150)) is None
    assert rate_hz(counted(11.0, 200)) == pytest.approx(100.0)
    assert rate_hz(counted(11.5, 3)) is None


def test_ages_grow_while_a_source_is_silent():
    desk = Desk().run(1.5)
    desk.mute = {"ATTITUDE"}
    desk.run(2.0)
    ages = status_of(desk)["age_s"]
    assert ages["attitude"] == pytest.approx(2.0, abs=0.1)
    assert ages["local_position"] < 0.1
    assert ages["radio"] is None


def test_the_text_of_the_status_is_the_last_one_sent_to_operators():
    desk = Desk().run(1.2)
    desk.companion.state.reports.send_text(Severity.NOTICE, "first", desk.now_s)
    desk.companion.state.reports.send_text(Severity.WARNING, "second", desk.now_s)
    desk.take_what_is_sent()
    mission = status_of(desk.run(1.0))["mission"]
    assert mission["text"] == "MOAR: second"
    assert mission["text_age_s"] == pytest.approx(1.0)
