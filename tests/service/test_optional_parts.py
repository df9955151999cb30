"""Optional parts of the service: none is imported unasked; what a missing one needs."""

from __future__ import annotations

import contextlib

import pytest

from moar_companion.errors import InputError
from moar_companion.service.optional_parts import open_perception, open_signing
from moar_companion.settings.config import CompanionConfig
from moar_companion.settings.link_config import KeySource, LinkConfig
from moar_companion.settings.perception_config import Perception, Sensor

from ..mavlink.signed import SECRET
from ..processes import output_of

OPTIONAL = {
    "moar_companion.service.recording.calls",
    "moar_companion.service.cycle_recorder",
    "moar_companion.service.mqtt_publisher",
    "moar_companion.service.parameter_file",
    "moar_companion.service.perception_process",
    "moar_companion.service.signing_clock",
    "moar_companion.service.snapshot_file",
    "moar_companion.service.status_socket",
}
LIBRARIES = {
    "aiomqtt",
    "matplotlib",
    "mavsdk",
    "mcap",
    "numba",
    "paho.mqtt.client",
    "scipy",
    "serial",
}


def test_the_service_imports_neither_optional_parts_nor_their_libraries():
    loaded = "import sys, moar_companion.service.app; print(*sys.modules)"
    modules = output_of(loaded).split()
    assert "moar_companion.service.app" in modules
    assert not (OPTIONAL | LIBRARIES) & set(modules)


def test_signed_links_without_a_state_directory_are_signed_and_warned_of(
    tmp_path, monkeypatch, caplog
):
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    key = tmp_path / "key"
    key.write_bytes(SECRET)
    key.chmod(0o400)
    links = (LinkConfig(url="udp:127.0.0.1:14540", signed=True),)
    config = CompanionConfig(vehicle=tmp_path, links=links, signing=KeySource(key_file=key))
    with contextlib.ExitStack() as stack:
        signing, file = open_signing(config, 1.8e9, stack)
    assert (signing is None, file) == (False, None)
    (warning,) = caplog.messages
    assert warning == "signed links without a state directory: time stamps are not kept"


def test_a_sensor_without_a_site_is_refused_with_the_key(tmp_path):
    perception = Perception(sensor=Sensor.VELODYNE)
    file = tmp_path / "companion.yaml"
    config = CompanionConfig(vehicle=tmp_path, perception=perception, file=file)
    with pytest.raises(InputError) as refused:
        open_perception(config, None, 1.0)
    assert str(refused.value) == f"{file}: perception.sensor: needs a site file: `site`, or --site"
