"""Description of the component for ground stations: its parameters and orders, as files. Pure.

In: the tables of parameters (`settings.flight_parameters`) and of orders (`mavlink.commands`). Out:
files for `file_server`, and COMPONENT_METADATA, which names the first of them. A file is the same
in every process: compressed JSON, whose checksum tells a ground station that it has the file.

`general.json` lists the others. `parameter.json` has the schema of mavlink/mavlink
(component_metadata/parameter.schema.json), with the version 1 that QGroundControl requires.
MAVLink has no schema of commands yet: `commands.json` has the form of QGroundControl's own tables
of commands (MavCmdInfo).

What ground stations do with it: MAVSDK downloads the metadata of each component whose id it is
given. QGroundControl asks the autopilot alone (component 1), so that it shows the companion's
parameters by their names, without units and descriptions. It downloads the parameters of ArduPilot
as a file, and then sends no PARAM_REQUEST_LIST to all components, at a refresh neither: beside
ArduPilot it does not show the companion's parameters at all. A request by name is always answered.

Source: https://mavlink.io/en/services/component_metadata.html, and QGroundControl
(RequestMetaDataTypeStateMachine.cc, CompInfoParam.cc, ParameterManager.cc).
"""

from __future__ import annotations

import json
import lzma
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any

from ...settings.flight_parameters import NONE, FlightParameter, flight_parameters
from ..commands import INDEX_MEANING, ORDER_MEANINGS, ORDERS
from ..dialect import Message, create, mavlink
from ..translate_outgoing import milliseconds
from .file_server import file_crc32

_GENERAL, _PARAMETERS, _COMMANDS = "general", "parameter", "commands"
_TYPES = {_PARAMETERS: 1, _COMMANDS: 2}
"""COMP_METADATA_TYPE of the files that the general one lists."""
_VERSION = 1
_CATEGORY = "Companion"
_XZ_FILTERS = ({"id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "dict_size": 1 << 16},)
"""A dictionary of 64 kB holds a whole file, and is all that a small decoder has to allocate."""


@cache
def metadata_files(component_id: int) -> Mapping[str, bytes]:
    """The files by their names. component_id: the companion's."""
    listed = {
        _PARAMETERS: _parameters(),
        _COMMANDS: _commands(component_id),
    }
    files = {_name(part): _compressed(content) for part, content in listed.items()}
    types = [
        {
            "type": kind,
            "uri": _uri(part, component_id),
            "fileCrc": file_crc32(files[_name(part)]),
        }
        for part, kind in _TYPES.items()
    ]
    general = {
        "version": _VERSION,
        "vendorName": "moar-companion",
        "modelName": "moar-companion",
        "metadataTypes": types,
    }
    return MappingProxyType({_name(_GENERAL): _compressed(general), **files})


def component_metadata(component_id: int, now_s: float) -> list[Message]:
    """COMPONENT_METADATA: place and checksum of the general file."""
    message = create(
        "COMPONENT_METADATA",
        time_boot_ms=milliseconds(now_s),
        file_crc=_general_crc(component_id),
        uri=_uri(_GENERAL, component_id).encode(),
    )
    return [message]


def component_information(component_id: int, now_s: float) -> list[Message]:
    """COMPONENT_INFORMATION, its deprecated predecessor, which also named files of peripherals."""
    message = create(
        "COMPONENT_INFORMATION",
        time_boot_ms=milliseconds(now_s),
        general_metadata_file_crc=_general_crc(component_id),
        general_metadata_uri=_uri(_GENERAL, component_id).encode(),
        peripherals_metadata_file_crc=0,
        peripherals_metadata_uri=b"",
    )
    return [message]


def _general_crc(component_id: int) -> int:
    return file_crc32(metadata_files(component_id)[_name(_GENERAL)])


def _name(part: str) -> str:
    return f"{part}.json.xz"


def _uri(part: str, component_id: int) -> str:
    return f"mftp://[;comp={component_id}]/{_name(part)}"


def _compressed(content: dict[str, Any]) -> bytes:
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":"))
    # The embedded decoders of ground stations need not know a checksum other than CRC-32.
    return lzma.compress(
        text.encode(), format=lzma.FORMAT_XZ, check=lzma.CHECK_CRC32, filters=_XZ_FILTERS
    )


def _parameters() -> dict[str, Any]:
    rows = [_parameter(row) for row in flight_parameters().values()]
    return {"version": _VERSION, "parameters": rows}


def _parameter(row: FlightParameter) -> dict[str, Any]:
    """A parameter as in the schema, whose names the keys are."""
    entry: dict[str, Any] = {
        "name": row.name,
        "type": "Int32" if row.is_integer else "Float",
        "group": row.group,
        "category": _CATEGORY,
        "shortDesc": _plain(row.short_description),
        "longDesc": _plain(f"{row.description} Setting: {row.key}. Permitted: {row.allowed}."),
        "units": row.unit,
        "decimalPlaces": row.decimals,
        "min": min(row.minimum, NONE) if row.optional else row.minimum,
        "max": row.maximum,
    }
    if row.default is not None:
        entry["default"] = row.default
    if row.choices:
        entry["values"] = [
            {"value": index, "description": word} for index, word in enumerate(row.choices)
        ]
    return entry


def _plain(text: str) -> str:
    """A text without the marks of Markdown."""
    return text.replace("`", "")


def _commands(component_id: int) -> dict[str, Any]:
    numbers = dict.fromkeys(command for command, _ in ORDERS.values())
    commands = [_command(number, component_id) for number in numbers]
    return {"version": _VERSION, "fileType": "MavCmdInfo", "mavCmdInfo": commands}


def _command(number: int, component_id: int) -> dict[str, Any]:
    """A command with all its orders. component_id: the companion's."""
    orders = {word: param1 for word, (command, param1) in ORDERS.items() if command == number}
    meanings = " ".join(f"{word}: {ORDER_MEANINGS[word]}." for word in orders)
    entry: dict[str, Any] = {
        "id": number,
        "rawName": mavlink.enums["MAV_CMD"][number].name,
        "friendlyName": f"Companion: {', '.join(orders)}",
        "description": f"To component {component_id}. {meanings}",
        "param1": {
            "label": "Order",
            "enumStrings": ",".join(orders),
            "enumValues": ",".join(f"{value:g}" for value in orders.values()),
        },
    }
    if number == mavlink.MAV_CMD_USER_1:
        entry["param2"] = {"label": INDEX_MEANING, "default": -1, "decimalPlaces": 0}
    return entry
