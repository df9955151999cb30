"""Each replayed recording gives the same decisions and packets."""

import json

import pytest

from moar_companion.analysis.replay.exact import ExactReplay
from moar_companion.commands.replay_mcap import McapRecording, replay_exactly
from moar_companion.service.recording.calls import OUTPUTS
from tests.recordings.command import names, path_of, renewed, write


@pytest.mark.slow
@pytest.mark.parametrize("name", names())
def test_a_replayed_recording_gives_the_same_decisions_and_packets(name):
    replay = ExactReplay()
    for _, calls in McapRecording(str(path_of(name))).cycles():
        for method, data, options, recorded in calls:
            result = replay.carried_out(method, data, options)
            if method in OUTPUTS:
                assert_same(recorded, result, f"{replay.time_s:.2f} s {method}")


def assert_same(recorded, recomputed, where):
    """Asserts equality except for the last digits, which differ between kinds of processors."""
    if isinstance(recorded, dict) and isinstance(recomputed, dict):
        assert recorded.keys() == recomputed.keys(), where
        for name, value in recorded.items():
            assert_same(value, recomputed[name], f"{where} {name}")
    elif isinstance(recorded, list) and isinstance(recomputed, list):
        assert len(recorded) == len(recomputed), where
        for index, pair in enumerate(zip(recorded, recomputed, strict=True)):
            assert_same(*pair, f"{where}[{index}]")
    elif isinstance(recorded, float) and isinstance(recomputed, float):
        assert recomputed == pytest.approx(recorded, rel=1e-12, abs=1e-12), where
    else:
        assert recomputed == recorded, where


def shortest():
    return min(names(), key=lambda name: path_of(name).stat().st_size)


@pytest.mark.slow
def test_a_renewed_recording_keeps_the_inputs_and_has_new_answers(tmp_path, capsys):
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
