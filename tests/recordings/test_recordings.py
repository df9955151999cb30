"""Each recorded flight is decided and sent again as it was; what differs is printed."""

import json

import pytest

from moar_companion.commands.replay_mcap import McapRecording, replay_exactly
from tests.recordings.command import names, path_of, renewed, write


@pytest.mark.slow
@pytest.mark.parametrize("name", names())
def test_a_recorded_flight_is_decided_and_sent_again_as_it_was(name):
    assert replay_exactly(str(path_of(name)), None) == 0


def shortest():
    return min(names(), key=lambda name: path_of(name).stat().st_size)


def test_a_renewed_recording_has_the_inputs_of_before_and_the_answers_of_today(tmp_path, capsys):
    cycles = [
        cycle
        for cycle, _ in zip(
            McapRecording(str(path_of(shortest()))).cycles(), range(600), strict=False
        )
    ]
    changed = json.loads(json.dumps(cycles))
    decided = [
        item
        for _, calls in changed
        for method, _, _, result in calls
        if method == "decisions"
        for item in result
    ]
    decided[3]["kind"] = "another"
    path = tmp_path / "changed.mcap"
    write(path, changed)
    assert replay_exactly(str(path), None) == 1
    assert "recorded    another" in capsys.readouterr().out
    write(path, renewed(changed))
    assert [calls for _, calls in McapRecording(str(path)).cycles()] == [
        calls for _, calls in cycles
    ]
