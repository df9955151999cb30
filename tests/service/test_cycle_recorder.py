"""The recording of a service: a fault of the recorded values ends it, and not the cycles."""

from __future__ import annotations

import contextlib
import json
import math

import pytest

from moar_companion.companion.reports import Decision
from moar_companion.service.cycle_recorder import CycleRecorder
from moar_companion.service.recording.calls import RecordedCompanion
from moar_companion.settings.config import CompanionConfig, RecorderSettings, shipped_configs
from moar_companion.settings.vehicle import Vehicle

VEHICLE = shipped_configs() / "vehicles" / "x500.yaml"


def decision(value):
    return Decision(time_s=1.0, kind="risk", data={"wind": value})


@pytest.mark.parametrize(
    ("status", "value", "fault"),
    [
        (dict, math.nan, "ValueError: Out of range float values are not JSON compliant"),
        ([{}].pop, 0.5, "IndexError: pop from empty list"),
    ],
    ids=["a decision that is not finite", "a fault of the next status"],
)
def test_a_fault_of_the_values_ends_the_recording_with_one_warning(
    tmp_path, caplog, status, value, fault
):
    companion = RecordedCompanion(CompanionConfig(vehicle=VEHICLE), Vehicle.load(VEHICLE), None)
    recorder = CycleRecorder(
        tmp_path, RecorderSettings(), companion, status, clock_offset_s=0.0, now_s=0.0
    )
    with contextlib.closing(recorder):
        recorder.record(0.0, [], [decision(0.25)])
        for now_s in (1.0, 2.0):
            companion.tick(now_s)
            recorder.record(now_s, [], [decision(value)])
        assert companion.calls() == []
    assert recorder.ended.strerror.startswith(fault)
    warnings = [item.getMessage() for item in caplog.records if item.levelname == "WARNING"]
    assert warnings == [f"recording ended: {recorder.folder}: {recorder.ended.strerror}"]
    (kept,) = (recorder.folder / "decisions.jsonl").read_text().splitlines()
    assert json.loads(kept)["data"] == {"wind": 0.25}
