"""Reports of the mission: the state in every heartbeat, state changes as texts."""

from __future__ import annotations

from moar_companion.mission_states import MissionState

from .desk import OFFBOARD, Desk


def test_the_heartbeat_carries_the_number_of_the_mission_state():
    desk = Desk().come_to("idle", then_s=1.1)
    numbers = [desk.messages("HEARTBEAT")[-1].custom_mode]
    desk.come_to("ready", then_s=1.1)
    numbers.append(desk.messages("HEARTBEAT")[-1].custom_mode)
    desk.say_heartbeat(OFFBOARD).run(1.1)
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
