"""Every message of an .mcap has the fields of its schema, with types that Foxglove reads."""

import base64
import json

import numpy as np
import pytest

from moar_companion.companion.planning.site_maps import SiteMaps
from moar_companion.companion.safety.check_inputs import Host
from moar_companion.companion.status import LatestDecisions
from moar_companion.service.recording.calls import Call
from moar_companion.service.recording.channels import Channels, CycleSampler, encoded_message
from moar_companion.service.recording.flight_log import FlightLog
from moar_companion.service.recording.schemas import CHANNELS, SHAPES, schema

from ..flights.lockstep import hovering
from ..flights.operator import INSPECTION

OFFSET_S = 1_700_000_000.0
TYPES = {"number": (int, float), "integer": int, "string": str, "boolean": bool}


@pytest.fixture(scope="module")
def messages():
    """Messages of a short flight, by channel."""
    flight = hovering(vehicle="x500")
    channels, sampler, latest = Channels(OFFSET_S), CycleSampler(), LatestDecisions()
    site_maps = SiteMaps(site=flight.flown_site, maps=flight.planner.maps)
    flight.calls[:] = [Call(method="take_ground", arguments=(site_maps,))]
    flight.companion.note_host(Host(disk_free=1e9, memory_available=1e9))
    flight.operator.mission(INSPECTION)
    found = {}
    for _ in range(300):
        if flight.state == "ready" and flight.now_s % 1.0 < 0.02:
            flight.operator.mode("ours")
        flight.step()
        companion, now_s = flight.companion, flight.now_s
        latest.note(flight.decisions, companion.telemetry.link)
        status = None
        if sampler.status_is_due(now_s):
            status = latest.status_of(companion, now_s, clock_offset_s=OFFSET_S, recorder=None)
        calls, flight.calls, flight.decisions = flight.calls, [], []
        cycle = sampler.cycle(companion, calls, status, now_s)
        for topic, wall_s, content in channels.messages(cycle):
            assert wall_s == pytest.approx(OFFSET_S + now_s, abs=0.1)
            found.setdefault(topic, []).append(json.loads(encoded_message(content)))
    return found


def misfits(shape, value, path=""):
    """Places where a value differs from its shape: null is allowed, unknown fields are not."""
    if value is None or shape == {}:
        return
    if isinstance(shape, dict):
        assert isinstance(value, dict), path
        for name, item in value.items():
            if name not in shape:
                yield f"{path}.{name}: not in the schema"
            else:
                yield from misfits(shape[name], item, f"{path}.{name}")
    elif isinstance(shape, list):
        assert isinstance(value, list), path
        for index, item in enumerate(value):
            yield from misfits(shape[0], item, f"{path}[{index}]")
    elif shape == "base64":
        base64.b64decode(value, validate=True)
    elif not isinstance(value, TYPES[shape]):
        yield f"{path}: {value!r} is no {shape}"


UNSHAPED = {"/machine/calls": {"calls"}, "/decision": {"data"}}
"""Content without a fixed shape, which no panel plots."""


@pytest.mark.slow
def test_every_message_fits_the_schema_of_its_channel(messages):
    for topic, contents in messages.items():
        for content in contents:
            for name in UNSHAPED.get(topic, ()):
                del content[name]
            assert list(misfits(SHAPES[CHANNELS[topic]], content)) == [], topic


def test_a_plain_flight_has_a_message_on_every_channel_but_those_of_what_it_lacks(messages):
    lacks = {"/gate", "/radio", "/refused", "/perception", "/inspection"}
    assert CHANNELS.keys() - messages.keys() == lacks


def test_schemas_are_plain_enough_for_foxglove():
    def check(part, path):
        assert part["type"] in {"object", "array", "number", "integer", "string", "boolean"}, path
        if part["type"] == "array":
            assert part["items"]["type"] != "array", path
            check(part["items"], path)
        for name, item in part.get("properties", {}).items():
            check(item, f"{path}.{name}")

    for topic, (name, content) in FlightLog(0.0).channels.items():
        found = json.loads(content)
        assert found["title"] == name
        assert found["type"] == "object"
        check(found, topic)


def test_the_grid_is_the_safety_map_row_by_row(messages):
    (grid,) = messages["/safety_map"]
    maps = hovering(vehicle="x500").planner.maps
    rows = np.frombuffer(base64.b64decode(grid["data"]), "<f4").reshape(-1, grid["column_count"])
    assert pytest.approx(maps.safety_cost.astype("f4")) == rows.T
    assert grid["row_stride"] == 4 * grid["column_count"] == 4 * maps.grid.shape[0]


def test_the_pose_points_where_the_nose_points(messages):
    turn, place = messages["/pose"][-1]["pose"]["orientation"], messages["/aircraft"][-1]
    azimuth_rad = np.radians(hovering(vehicle="x500").site.frame.azimuth_deg)
    assert 2.0 * np.arctan2(turn["z"], turn["w"]) == pytest.approx(
        azimuth_rad - place["yaw_rad"], abs=0.05
    )


def test_a_schema_is_by_the_types_of_a_dataclass():
    host = json.loads(schema("moar.Host", SHAPES["moar.Host"]))["properties"]
    assert host["disk_free"] == {"type": "number"}
    assert host["file_faults"]["items"]["properties"]["reason"] == {"type": "string"}
