"""Folder of the recordings: by the configuration, else systemd's."""

from pathlib import Path

import pytest

from moar_companion.service.directories import recorder_folder
from moar_companion.settings.config import CompanionConfig, RecorderSettings

STATE = "/var/lib/moar-companion"


@pytest.mark.parametrize(
    ("recorder", "state", "folder"),
    [
        (RecorderSettings(), None, None),
        (RecorderSettings(), STATE, Path(STATE, "flights")),
        (RecorderSettings(), f"{STATE}:/another", Path(STATE, "flights")),
        (RecorderSettings(directory=Path("/data")), STATE, Path("/data")),
        (RecorderSettings(enabled=False), STATE, None),
        (RecorderSettings(enabled=False, directory=Path("/data")), STATE, None),
    ],
)
def test_flights_are_recorded_by_default_under_systemd(recorder, state, folder, monkeypatch):
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    if state is not None:
        monkeypatch.setenv("STATE_DIRECTORY", state)
    found = recorder_folder(CompanionConfig(vehicle=Path("v.yaml"), recorder=recorder))
    assert (None if found is None else found.path) == folder
