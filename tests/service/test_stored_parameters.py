"""Parameters kept for the next start: above the files, below the command line."""

from __future__ import annotations

import json
import logging
import os

import pytest

from moar_companion.service.stored_parameters import ParameterFile, start_settings
from moar_companion.settings.config import CompanionConfig, State, shipped_configs
from moar_companion.settings.vehicle import Vehicle, VehicleFile

X500 = shipped_configs() / "vehicles" / "x500.yaml"
FILE = VehicleFile.load(X500)


@pytest.fixture
def started(tmp_path):
    """Settings of a start in this folder."""

    def start(*, vehicle_named=False, file=FILE, put_aside=True):
        config = CompanionConfig(vehicle=X500, state=State(directory=tmp_path))
        return start_settings(config, file, vehicle_named=vehicle_named, put_aside=put_aside)

    return start


def kept(folder, settings, **values):
    """Sets values in flight, and ends the process."""
    file = ParameterFile(folder, settings)
    parameters = settings.parameters
    for name, value in values.items():
        parameters = parameters.with_value(name, value)
    file.keep(parameters)
    file.close()
    return file


def write(folder, content):
    (folder / "parameters.json").write_text(content)


def values(**items):
    return json.dumps({"version": 1, "vehicles": {FILE.name: items}})


def test_without_a_file_the_settings_are_those_of_the_files(started):
    settings = started()
    assert settings.vehicle == Vehicle.load(X500)
    assert settings.config.supervision.wind_limit_mps == 15.0
    assert (settings.parameters.changed, settings.notes, settings.problems) == ({}, (), ())


def test_a_restart_keeps_what_was_set(started, tmp_path):
    kept(tmp_path, started(), LIM_WIND=9.0, SAFE_D_MAX=6.0, SAFE_D_MIN=4.0, ADAPTATION=1.0)
    settings = started()
    assert settings.config.supervision.wind_limit_mps == 9.0
    assert (settings.vehicle.safety.d_min_m, settings.vehicle.safety.d_max_m) == (4.0, 6.0)
    assert settings.notes[0] == "LIM_WIND 9, above the file's 15"
    assert settings.problems == settings.faults == ()


def test_the_command_line_s_vehicle_stands_above_and_loses_nothing(started, tmp_path):
    kept(tmp_path, started(), LIM_WIND=9.0, SAFE_D_MAX=6.0)
    named = started(vehicle_named=True)
    assert named.vehicle == Vehicle.load(X500)
    assert named.config.supervision.wind_limit_mps == 9.0, "which the command line does not name"
    assert named.notes == (
        "LIM_WIND 9, above the file's 15",
        "SAFE_D_MAX 6 does not count: --vehicle is given",
    )
    kept(tmp_path, named, LIM_BATTERY=0.3)
    assert started().parameters.changed == {"SAFE_D_MAX": 6.0, "LIM_WIND": 9.0, "LIM_BATTERY": 0.3}


@pytest.mark.parametrize("values_set", [(4.0, FILE.safety.d_max_m), (FILE.safety.d_max_m,), (4.0,)])
def test_a_value_below_the_command_line_is_forgotten_once_another_is_set(
    values_set, started, tmp_path
):
    kept(tmp_path, started(), SAFE_D_MAX=5.0, SAFE_D_MIN=2.0)
    named = started(vehicle_named=True)
    parameters = named.parameters
    for value in values_set:
        parameters = parameters.with_value("SAFE_D_MAX", value)
    file = ParameterFile(tmp_path, named)
    file.keep(parameters)
    file.close()
    assert started().parameters.value("SAFE_D_MAX") == values_set[-1]
    assert started().parameters.value("SAFE_D_MIN") == 2.0, "which was not set again"


def test_each_vehicle_has_its_own(started, tmp_path):
    other = FILE.model_copy(update={"name": "another"})
    kept(tmp_path, started(), SAFE_D_MAX=6.0)
    assert started(file=other).parameters.changed == {}
    kept(tmp_path, started(file=other), SAFE_D_MAX=7.0)
    assert started().parameters.changed == {"SAFE_D_MAX": 6.0}
    assert started(file=other).parameters.changed == {"SAFE_D_MAX": 7.0}


def test_a_value_that_is_no_longer_valid_is_dropped_with_one_text(started, tmp_path):
    write(tmp_path, values(SAFE_D_MIN=4.0, LIM_WIND=9.0, GONE=1.0))
    settings = started()
    assert settings.parameters.changed == {"LIM_WIND": 9.0}
    path = tmp_path / "parameters.json"
    assert settings.problems == (
        f"{path}: SAFE_D_MIN is 4, must be < SAFE_D_MAX (3), dropped",
        f"{path}: GONE is no parameter, dropped",
    )
    (fault,) = settings.faults
    assert (fault.reason, fault.action) == ("2 stored parameters not valid", "dropped")


@pytest.mark.parametrize("number", ["3.4028235e38", "-3.4028235e38", "1e300", "1e999", "NaN"])
def test_a_number_without_end_is_dropped_and_the_service_starts(number, started, tmp_path):
    write(tmp_path, values(LIM_WIND=9.0, SAFE_D_MAX=7.0).replace("9.0", number))
    settings = started()
    assert settings.parameters.changed == {"SAFE_D_MAX": 7.0}
    (problem,) = settings.problems
    assert "LIM_WIND is " in problem


def test_a_number_of_more_digits_than_a_single_is_taken(started, tmp_path):
    write(tmp_path, values(LIM_WIND=46.37611578667585))
    assert started().config.supervision.wind_limit_mps == pytest.approx(46.376115)


BROKEN = ["", "{", "[]", "\0" * 300, values(LIM_WIND="9"), values(LIM_WIND=9).replace("1,", "2,")]


@pytest.mark.parametrize("content", BROKEN)
def test_a_broken_file_is_put_aside_with_one_warning(content, started, tmp_path, caplog):
    write(tmp_path, content)
    settings = started()
    assert settings.parameters.changed == {}
    assert (tmp_path / "parameters.broken").read_text() == content, "nothing is lost"
    with caplog.at_level(logging.INFO):
        settings.log()
    (record,) = caplog.records
    assert "parameters.json: no parameters of this version" in record.getMessage()
    (fault,) = settings.faults
    assert (fault.reason, fault.action) == ("parameter file unusable", "files count")
    assert started().problems == ()


def test_a_check_leaves_a_broken_file_where_it_is(started, tmp_path):
    write(tmp_path, "{")
    assert started(put_aside=False).problems
    assert [item.name for item in tmp_path.iterdir()] == ["parameters.json"]


def test_a_disk_that_is_full_is_told_and_the_old_file_stays(started, tmp_path, monkeypatch):
    kept(tmp_path, started(), LIM_WIND=9.0)

    def fsync(_descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fsync)
    file = kept(tmp_path, started(), LIM_WIND=8.0)
    assert [fault.reason for fault in file.faults] == ["no parameter file: disk full"]
    monkeypatch.undo()
    assert started().parameters.changed == {"LIM_WIND": 9.0}
