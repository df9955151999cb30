"""Values keep every bit through JSON."""

import json
import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from moar_companion.companion.mission.values import Task
from moar_companion.companion.safety.check_inputs import Host
from moar_companion.companion.safety.file_faults import FileFault
from moar_companion.planner.site import Site
from moar_companion.service.recording.value_codec import decoded, encoded
from moar_companion.settings.config import CompanionConfig, shipped_configs
from moar_companion.settings.link_config import LinkConfig
from moar_companion.settings.vehicle import Vehicle
from moar_companion.types import Mission


def through_json(kind, value):
    return decoded(kind, json.loads(json.dumps(encoded(value), allow_nan=False)))


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_every_float_comes_back_bit_for_bit(value):
    back = through_json(float, value)
    assert (math.isnan(value) and math.isnan(back)) or struct.pack("d", value) == struct.pack(
        "d", back
    )


@pytest.mark.parametrize("path", sorted((shipped_configs() / "sites").glob("*.yaml")), ids=str)
def test_every_shipped_site_comes_back_equal(path):
    site = Site.load(path)
    assert through_json(Site, site) == site


@pytest.mark.parametrize("path", sorted((shipped_configs() / "vehicles").glob("*.yaml")), ids=str)
def test_every_shipped_vehicle_comes_back_equal(path):
    vehicle = Vehicle.load(path)
    assert through_json(Vehicle, vehicle) == vehicle


@pytest.mark.parametrize(
    "value",
    [
        CompanionConfig.load(shipped_configs() / "companion.yaml"),
        CompanionConfig(vehicle=shipped_configs(), links=(LinkConfig(url="tcp:h:1", signed=True),)),
        Task(mission=Mission.EXIT, landing=1),
        Host(disk_free=1.5, file_faults=(FileFault(reason="no", action="on"),)),
    ],
    ids=lambda value: type(value).__name__,
)
def test_other_inputs_of_the_machine_come_back_equal(value):
    assert through_json(type(value), value) == value


def test_an_object_that_is_no_value_is_refused():
    with pytest.raises(TypeError, match="function is no value"):
        encoded({"call": lambda: None})
