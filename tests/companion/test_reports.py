"""Reports of the mission: the state in every heartbeat, state changes and events as texts."""

from __future__ import annotations

from types import SimpleNamespace

from moar_companion.companion.mission_states import MissionState
from moar_companion.companion.reports import Reports
from moar_companion.mavlink.autopilot_control import CommandAnswered
from moar_companion.mavlink.identity import Autopilot, AutopilotConflict
from moar_companion.mavlink.own_ids import ComponentConflict
from moar_companion.mavlink.peers import AutopilotElsewhere, PeerRefused
from moar_companion.mavlink.statustext import Severity
from moar_companion.types import PX4

from .desk import Desk
from .scripted_autopilot import OFFBOARD


def test_the_heartbeat_carries_the_number_of_the_mission_state():
    desk = Desk().come_to("idle", then_s=1.1)
    numbers = [desk.messages("HEARTBEAT")[-1].custom_mode]
    desk.come_to("ready", then_s=1.1)
    numbers.append(desk.messages("HEARTBEAT")[-1].custom_mode)
    desk.send_heartbeat(OFFBOARD).run(1.1)
    numbers.append(desk.messages("HEARTBEAT")[-1].custom_mode)
    assert numbers == [0, 2, 3]
    assert [state.number for state in MissionState] == list(range(9))


def test_a_state_that_is_entered_again_is_reported_again():
    """A ground station shows the last text: after a resume that must not be `holding`."""
    desk = Desk().come_to("flying", then_s=1.0)
    desk.pause().run(1.0).go_on().run(1.0).pause().run(1.0).go_on().run(1.0)
    assert desk.state == "flying"
    states = [text for text in desk.texts() if text.startswith(("MOAR: flying", "MOAR: holding"))]
    assert states == ["MOAR: flying inspection to splice-outer", "MOAR: holding inspection"] * 2 + [
        "MOAR: flying inspection to splice-outer"
    ]


# Events of the session


def reported(event):
    """Severity and text that operators receive on an event, and the reason in the record."""
    sent = []
    session = SimpleNamespace(
        send_text=lambda severity, text, _now_s, **_: sent.append((severity, text))
    )
    reports = Reports(session)
    reports.report_event(event, 7.0)
    return sent, [decision.data["reason"] for decision in reports.decisions()]


def test_another_sender_with_the_autopilots_id_is_reported_with_its_address():
    event = AutopilotElsewhere(link="udpin:0.0.0.0:14540", address=("10.1.2.3", 14555))
    assert reported(event) == (
        [(Severity.WARNING, "MOAR: autopilot also at 10.1.2.3, ignored")],
        ["autopilot also at 10.1.2.3 (port 14555, on udpin:0.0.0.0:14540)"],
    )


def test_a_system_without_permission_is_reported_with_its_id_and_the_setting():
    event = PeerRefused(link="udpin:0.0.0.0:14550", address=("10.1.2.3", 14551), system_id=77)
    assert reported(event) == (
        [(Severity.NOTICE, "MOAR: system 77 may not command, not served")],
        ["system 77 may not command (10.1.2.3:14551 on udpin:0.0.0.0:14550; commands.systems)"],
    )


def test_an_autopilot_that_refuses_the_mode_is_reported_and_one_that_accepts_is_not():
    accepted, denied = (CommandAnswered(command=176, result=result) for result in (0, 2))
    assert reported(accepted) == ([], [])
    ((severity, text),), _ = reported(denied)
    assert severity == Severity.WARNING
    assert "mode" in text


def test_a_second_autopilot_is_an_error_and_both_are_recorded():
    first, second = (
        Autopilot(system_id=number, component_id=1, kind=PX4, link="serial") for number in (1, 2)
    )
    event = AutopilotConflict(autopilot=first, other=second, reason="two autopilots")
    assert reported(event) == (
        [(Severity.ERROR, "MOAR: two autopilots, no control")],
        [f"two autopilots ({first}, {second})"],
    )


def test_a_second_companion_is_reported_with_its_id():
    assert reported(ComponentConflict(system_id=1, component_id=195)) == (
        [(Severity.ERROR, "MOAR: two companions with component id 195")],
        ["two companions with component id 195 (see component_id)"],
    )
