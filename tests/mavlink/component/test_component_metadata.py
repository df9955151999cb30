"""The files that describe the component, as ground stations read them."""

from __future__ import annotations

import hashlib
import json
import lzma
import re
import subprocess
import sys

import jsonschema
import pytest

from moar_companion.mavlink.commands import ORDER_MEANINGS, ORDERS
from moar_companion.mavlink.component.component_metadata import (
    component_information,
    component_metadata,
    metadata_files,
)
from moar_companion.mavlink.component.file_server import FileServer, file_crc32
from moar_companion.mavlink.dialect import mavlink
from moar_companion.settings.flight_parameters import flight_parameters

from .ftp_client import BURST, Client

CRC = {"type": "integer", "minimum": 0, "maximum": 2**32 - 1}
GENERAL = {
    "type": "object",
    "properties": {
        "version": {"const": 1},
        "vendorName": {"type": "string"},
        "modelName": {"type": "string"},
        "firmwareVersion": {"type": "string", "pattern": r"^\d+\.\d+\.\d+(\.\d+)?$"},
        "metadataTypes": {
            "type": "array",
            "items": {
                "type": "object",
                "properties": {
                    "type": {"type": "integer"},
                    "uri": {"type": "string"},
                    "fileCrc": CRC,
                },
                "required": ["type", "uri", "fileCrc"],
                "additionalProperties": False,
            },
        },
    },
    "required": ["version", "metadataTypes"],
    "additionalProperties": False,
}
"""What MAVLink's schema of the file permits, as far as it is used here."""
NUMBER, TEXT = {"type": "number"}, {"type": "string"}
PARAMETER = {
    "type": "object",
    "properties": {
        "name": {"type": "string", "pattern": "^[A-Z0-9_]{1,16}$"},
        "type": {"enum": ["Int32", "Float"]},
        **dict.fromkeys(("group", "category", "shortDesc", "longDesc", "units"), TEXT),
        **dict.fromkeys(("default", "min", "max"), NUMBER),
        "decimalPlaces": {"type": "integer", "minimum": 0},
        "values": {
            "type": "array",
            "items": {
                "type": "object",
                "properties": {"value": NUMBER, "description": TEXT},
                "required": ["value", "description"],
                "additionalProperties": False,
            },
        },
    },
    "required": ["name", "type"],
    "additionalProperties": False,
}
PARAMETERS = {
    "type": "object",
    "properties": {
        "version": {"const": 1},  # QGroundControl reads no other
        "parameters": {"type": "array", "items": PARAMETER},
    },
    "required": ["version", "parameters"],
    "additionalProperties": False,
}


@pytest.fixture(scope="module")
def files():
    return metadata_files(195)


def content(files, name):
    return json.loads(lzma.decompress(files[name]))


def test_the_general_file_lists_the_others_with_the_checksums_of_their_bytes(files):
    general = content(files, "general.json.xz")
    jsonschema.validate(general, GENERAL)
    assert {entry["type"]: entry["uri"] for entry in general["metadataTypes"]} == {
        1: "mftp://[;comp=195]/parameter.json.xz",
        2: "mftp://[;comp=195]/commands.json.xz",
    }
    for entry in general["metadataTypes"]:
        assert entry["fileCrc"] == file_crc32(files[entry["uri"].rsplit("/", 1)[1]])


def qgroundcontrol_path(uri):
    """Path that QGroundControl asks for: the scheme without one slash, and without the component.

    Source: FTPManager::_parseURI.
    """
    rest = uri[len("mftp://") - 1 :]
    assert "://" not in rest
    assert re.match(r"^/??\[;comp=195\]", rest)
    return re.sub(r"\[;comp=\d+\]", "", rest)


def mavsdk_path(uri):
    """Path that MAVSDK asks for. Source: ComponentMetadataImpl::uri_is_mavlinkftp."""
    component, path = re.match(r"^(?:\[;comp=(\d+)\])(.*)", uri[len("mftp://") :]).groups()
    assert component == "195"
    return path


@pytest.mark.parametrize("path_of", [qgroundcontrol_path, mavsdk_path])
def test_the_place_in_component_metadata_is_found_as_ground_stations_read_it(files, path_of):
    (message,) = component_metadata(195, 12.5)
    client = Client(FileServer(files))
    size = client.open(path_of(message.uri).encode()).data
    data = b"".join(packet.data for packet in client.ask(BURST, size=239))
    assert (len(data), file_crc32(data)) == (int.from_bytes(size, "little"), message.file_crc)
    assert message.time_boot_ms == 12500


def test_the_deprecated_message_names_the_same_file():
    (old,), (new,) = component_information(195, 1.0), component_metadata(195, 1.0)
    assert (old.general_metadata_uri, old.general_metadata_file_crc) == (new.uri, new.file_crc)
    assert old.peripherals_metadata_uri == ""


def test_every_parameter_is_described_within_the_schema(files):
    described = content(files, "parameter.json.xz")
    jsonschema.validate(described, PARAMETERS)
    rows = {entry["name"]: entry for entry in described["parameters"]}
    assert list(rows) == list(flight_parameters())
    for name, entry in rows.items():
        assert entry["shortDesc"], name
        assert f"Setting: {flight_parameters()[name].key}." in entry["longDesc"]
        assert entry["min"] < entry["max"]
        assert entry["min"] <= entry.get("default", entry["min"]) <= entry["max"]


def test_a_choice_has_its_words_and_an_optional_number_admits_minus_one(files):
    rows = {entry["name"]: entry for entry in content(files, "parameter.json.xz")["parameters"]}
    assert rows["ADAPTATION"]["type"] == "Int32"
    assert rows["ADAPTATION"]["values"] == [
        {"value": 0, "description": "paper"},
        {"value": 1, "description": "calibrated"},
    ]
    assert (rows["SPEED_MAX"]["min"], rows["SPEED_MAX"]["default"]) == (-1.0, -1.0)
    assert "-1 (none)" in rows["SPEED_MAX"]["longDesc"]
    assert rows["SAFE_D_MIN"]["units"] == "m"
    assert "default" not in rows["SAFE_D_MIN"]


def test_every_order_is_in_the_commands_with_its_number(files):
    read = {}
    for entry in content(files, "commands.json.xz")["mavCmdInfo"]:
        words, values = (entry["param1"][key].split(",") for key in ("enumStrings", "enumValues"))
        read |= {
            word: (entry["id"], float(value)) for word, value in zip(words, values, strict=True)
        }
        assert mavlink.enums["MAV_CMD"][entry["id"]].name == entry["rawName"]
        assert "component 195" in entry["description"]
        assert all(f"{word}: {ORDER_MEANINGS[word]}." in entry["description"] for word in words)
    assert read == ORDERS


def digests(files):
    return {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}


@pytest.mark.slow
def test_the_files_are_the_same_in_every_process(files):
    program = (
        "import json; from tests.mavlink.component.test_component_metadata import *; "
        "print(json.dumps(digests(metadata_files(195))))"
    )
    for seed in ("0", "1"):
        done = subprocess.run(
            [sys.executable, "-c", program],
            capture_output=True,
            check=True,
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": ":".join(filter(None, sys.path))},
        )
        assert json.loads(done.stdout) == digests(files)


def test_another_component_id_is_in_the_places():
    (entry, _) = content(metadata_files(191), "general.json.xz")["metadataTypes"]
    assert entry["uri"].startswith("mftp://[;comp=191]/")
