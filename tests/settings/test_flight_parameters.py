"""Settings that may be changed in flight: their table, and values beside those of the files."""

from __future__ import annotations

import dataclasses
import math
import re
import struct

import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st

from moar_companion.settings.config import CompanionConfig, shipped_configs
from moar_companion.settings.flight_parameters import (
    NONE,
    FlightParameters,
    ParameterError,
    flight_parameters,
    shortest,
)
from moar_companion.settings.vehicle import AdaptationKind, Vehicle, VehicleFile
from moar_companion.types import Mission

_CONFIG = CompanionConfig(vehicle=shipped_configs() / "vehicles" / "x500.yaml")
_FILE = VehicleFile.load(_CONFIG.vehicle)
PARAMETERS = FlightParameters.of(_FILE, _CONFIG)
_NAMES = list(flight_parameters())


def _refusal(name: str, value: float, parameters: FlightParameters = PARAMETERS) -> str:
    with pytest.raises(ParameterError) as refused:
        parameters.with_value(name, value)
    return str(refused.value)


def test_there_are_a_hundred_or_fewer_each_under_a_mavlink_name() -> None:
    assert len(_NAMES) <= 100
    assert all(len(name) <= 16 and name == name.upper() and name.isascii() for name in _NAMES)


def test_no_key_is_set_by_two_parameters() -> None:
    keys = [(item.file, item.keys) for item in flight_parameters().values()]
    assert len(set(keys)) == len(keys)


@pytest.mark.parametrize(
    "word",
    [
        "links",
        "authority",
        "commands",
        "signing",
        "component_id",
        "system_id",
        "file",
        "directory",
        "resume",
        "loss_action",
        "failsafe_action",
        "timeout_s",
        "jump_limit_m",
    ],
)
def test_what_protects_the_flight_is_no_parameter(word: str) -> None:
    keys = [item.key for item in flight_parameters().values() if item.name != "LIM_READY"]
    assert not any(word in key for key in keys)


def test_each_has_limits_a_description_and_the_default_of_its_model() -> None:
    for item in flight_parameters().values():
        assert item.minimum < item.maximum
        assert item.short_description
        assert item.default is None or item.minimum <= item.default <= item.maximum or item.optional
    wind = flight_parameters()["LIM_WIND"]
    assert (wind.key, wind.unit, wind.default) == ("supervision.wind_limit_mps", "m/s", 15.0)
    assert flight_parameters()["RISK_CELL_R1"].default == 3.4


@pytest.mark.parametrize("name", _NAMES)
def test_the_limits_of_the_table_are_permitted_and_nothing_beyond(name: str) -> None:
    row = flight_parameters()[name]
    for limit, beyond in ((row.minimum, -0.001), (row.maximum, 1.0)):
        _, texts = PARAMETERS.with_stored({name: limit})
        # Beside other values one may be refused: the text then has no number as the limit.
        assert not any(re.search(r"must be (at least|at most|<|>) [\d.]", text) for text in texts)
        assert "must be" in _refusal(name, limit + beyond)


@pytest.mark.parametrize("vehicle", sorted((shipped_configs() / "vehicles").glob("*.yaml")))
def test_nothing_changed_gives_the_files_own_settings(vehicle: object) -> None:
    config, flown = FlightParameters.of(VehicleFile.load(vehicle), _CONFIG).apply(_CONFIG)
    assert config == _CONFIG
    assert flown == Vehicle.load(vehicle)


def test_values_are_those_of_the_files() -> None:
    assert PARAMETERS.value("SAFE_D_MAX") == _FILE.safety.d_max_m
    assert PARAMETERS.value("GUID_YAW_RATE") == pytest.approx(45.0)
    assert PARAMETERS.value("SAFE_POS_MARGIN") == NONE
    assert PARAMETERS.value("LIM_GCS_ACTION") == 1.0


def test_a_changed_value_counts_in_the_settings() -> None:
    changed = PARAMETERS.with_value("ADAPTATION", 1.0).with_value("GUID_YAW_RATE", 90.0)
    changed = changed.with_value("LIM_WIND", 12.0).with_value("WGT_EXIT_SAFETY", 0.66)
    config, vehicle = changed.apply(_CONFIG)
    assert vehicle.adaptation is AdaptationKind.CALIBRATED
    assert vehicle.guidance.yaw_rate_radps == pytest.approx(math.pi / 2.0)
    assert config.supervision == dataclasses.replace(_CONFIG.supervision, wind_limit_mps=12.0)
    assert vehicle.weights[Mission.EXIT].safety == pytest.approx(0.5)
    assert changed.value("WGT_EXIT_SAFETY") == 0.66


def test_two_ends_of_a_range_are_two_parameters() -> None:
    _, vehicle = PARAMETERS.with_value("RISK_TILT_R1", 40.0).apply(_CONFIG)
    before = _FILE.risk.tilt_rad
    assert vehicle.risk.tilt_rad.high == pytest.approx(math.radians(40.0))
    assert vehicle.risk.tilt_rad.low == before.low


def test_every_parameter_of_a_file_without_optional_keys_can_be_set(tmp_path) -> None:
    needed = {"name", "geometry", "safety", "speed", "weights"}
    file = tmp_path / "vehicle.yaml"
    written = yaml.safe_load(_CONFIG.vehicle.read_text())
    file.write_text(yaml.safe_dump({key: written[key] for key in needed}))
    parameters = FlightParameters.of(VehicleFile.load(file), _CONFIG)
    assert parameters.apply(_CONFIG)[1] == Vehicle.load(file)
    for name, row in flight_parameters().items():
        present = parameters.value(name)
        value = 1.0 - present if row.choices else present * 1.001
        if row.optional:
            value = 1.0
        value += 0.001 * (value == present)
        assert parameters.with_value(name, value).changed == {name: shortest(value)}


def test_an_optional_number_is_none_by_minus_one() -> None:
    given = PARAMETERS.with_value("SAFE_TRK_MARGIN", 0.5)
    assert given.apply(_CONFIG)[1].guidance.tracking_margin_m == 0.5
    assert given.with_value("SAFE_TRK_MARGIN", NONE).changed == {}


def test_the_files_own_value_is_no_change() -> None:
    single = 1.2000000476837158  # 1.2 as a float of MAVLink
    assert PARAMETERS.with_value("SAFE_D_MIN", single).changed == {}
    changed = PARAMETERS.with_value("SAFE_D_MIN", 1.3)
    assert changed.with_value("SAFE_D_MIN", single).changed == {}


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("LIM_WIND", 0.0, "LIM_WIND is 0.0, must be at least 0.1"),
        ("LIM_WIND", math.nan, "LIM_WIND is nan, must be 0.1 to 100"),
        ("LIM_WIND", -math.inf, "LIM_WIND is -inf, must be 0.1 to 100"),
        ("SETPOINT_RATE", 200.0, "SETPOINT_RATE is 200.0, must be at most 100"),
        ("ADAPTATION", 2.0, "ADAPTATION is 2, must be 0 (paper), 1 (calibrated)"),
        ("ADAPTATION", 0.5, "ADAPTATION is 0.5, must be 0 (paper), 1 (calibrated)"),
        ("SAFE_D_MIN", 50.0, "SAFE_D_MIN is 50, must be < SAFE_D_MAX (3)"),
        (
            "SAFE_D_MAX",
            0.2,
            "SAFE_D_MAX is 0.2, SAFE_D_MIN is 1.2 (must be < SAFE_D_MAX (0.2))",
        ),
        (
            "SPEED_MIN",
            20.0,
            "SPEED_MIN is 20, SPEED_HORIZONTAL is 5 (must be at least SPEED_MIN (20))",
        ),
        (
            "PLAN_PERIOD",
            0.2,
            "PLAN_PERIOD is 0.2, PLAN_INTERVAL is 0.3 (must be at most PLAN_PERIOD (0.2))",
        ),
        ("GUID_TRK_SLOW", 1.6, "GUID_TRK_SLOW is 1.6, must be < GUID_TRK_HOLD (1.5)"),
        (
            "RISK_HDOP_R0",
            3.0,
            "RISK_HDOP_R0 is 3, hdop has two equal values (must differ)",
        ),
    ],
)
def test_a_value_that_a_file_may_not_have_is_refused(name: str, value: float, text: str) -> None:
    assert _refusal(name, value) == text


def test_weights_are_not_all_0() -> None:
    some = PARAMETERS.with_value("WGT_EXIT_SAFETY", 0.0).with_value("WGT_EXIT_TIME", 0.0)
    assert _refusal("WGT_EXIT_ENERGY", 0.0, some) == (
        "WGT_EXIT_ENERGY is 0, exit are all 0 (must have a positive sum)"
    )


_SINGLES = st.integers(0, 2**32 - 1).map(
    lambda bits: struct.unpack("<f", struct.pack("<I", bits))[0]
)
_LARGEST = struct.unpack("<f", b"\xff\xff\x7f\x7f")[0]
_NEAR_A_MIDPOINT = 46.37611578667585
"""Between two singles: its nine digits are the other one."""


@given(st.sampled_from(_NAMES), st.floats() | _SINGLES)
@example("LIM_WIND", _LARGEST)
@example("LIM_WIND", -_LARGEST)
@example("LIM_WIND", 1e300)
@example("LIM_WIND", _NEAR_A_MIDPOINT)
@example("LIM_GCS_ACTION", math.nan)
def test_any_value_is_refused_or_read_back_as_it_was_set(name: str, value: float) -> None:
    stored, texts = PARAMETERS.with_stored({name: value})
    if texts:
        assert stored.changed == PARAMETERS.changed == {}
        assert texts == [_refusal(name, value)]
        return
    changed = PARAMETERS.with_value(name, value)
    assert stored.changed == changed.changed
    assert changed.value(name) == pytest.approx(value, rel=1e-6, abs=1e-12)
    changed.apply(_CONFIG)
    for other in _NAMES:
        assert other == name or changed.value(other) == PARAMETERS.value(other)


def _single_bytes(value: float) -> bytes:
    return struct.pack("<f", value)


@given(st.floats(-_LARGEST, _LARGEST) | _SINGLES.filter(math.isfinite))
@example(_LARGEST)
@example(-_LARGEST)
@example(struct.unpack("<f", b"\xf0\xff\x7f\x7f")[0])
@example(_NEAR_A_MIDPOINT)
def test_the_shortest_decimal_is_the_same_single(value: float) -> None:
    assert _single_bytes(shortest(value)) == _single_bytes(value)


@pytest.mark.parametrize(("single", "decimal"), [(0.30000001192092896, 0.3), (1e300, math.inf)])
def test_the_shortest_decimal_of_a_number(single: float, decimal: float) -> None:
    assert shortest(single) == decimal


def test_stored_values_that_are_valid_together_are_set_in_any_order() -> None:
    for stored in ({"SAFE_D_MIN": 4.0, "SAFE_D_MAX": 6.0}, {"SAFE_D_MAX": 6.0, "SAFE_D_MIN": 4.0}):
        made, texts = PARAMETERS.with_stored(stored)
        assert made.changed == stored
        assert texts == []


def test_of_stored_values_only_those_that_fail_are_dropped_with_a_text_each() -> None:
    made, texts = PARAMETERS.with_stored({"SAFE_D_MIN": 4.0, "LIM_WIND": 9.0, "OLD_NAME": 1.0})
    assert made.changed == {"LIM_WIND": 9.0}
    assert texts == [
        "SAFE_D_MIN is 4, must be < SAFE_D_MAX (3)",
        "OLD_NAME is no parameter",
    ]
