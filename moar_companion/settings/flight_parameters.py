"""Settings that a ground station may change in flight, as MAVLink parameters of component 195.

Inputs: a vehicle file and the configuration as read, and values by parameter names. Outputs: the
vehicle and the configuration with these values, checked as the files are; a table of parameters.
`_GROUPS` names the keys; types, limits, defaults and descriptions are those of the files' models.

In no file and so never set in flight: links, authority, senders that may command, signing, ids,
files; the checks that end the stream by old or jumping data; the reactions to an offboard loss; the
acceleration, by which the path that is flown brakes.
"""

from __future__ import annotations

import functools
import math
import re
import struct
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

from .config import COMPANION_FILE, CompanionConfig, config_findings, default_vehicle
from .file_reference import FileKey, keys
from .vehicle import Vehicle, VehicleFile, vehicle_findings
from .yaml_file import FileFinding, dotted, validated
from .yaml_schema import FileModel, as_written

NONE = -1.0
"""Value of an optional number that is not given: no such number is negative."""

_File = Literal["vehicle", "service"]
_VEHICLE: _File = "vehicle"
_SERVICE: _File = "service"

_RANGE_ENDS = ("_R0", "_R1")
"""Endings of the names of a range: its values at which the risk is 0, and 1."""
_SECTIONS = ("setpoint_rate_hz", "replanning", "supervision")
"""Keys of the configuration that have parameters, or stand above some."""
_DECIMALS = 3
_KEY = re.compile(r"[a-z]\w+")
_CLAUSE_END = re.compile(r"\.? *$|[;:] |\. (?=[A-Z])")


class _Group(NamedTuple):
    """Parameters of one section of a file: names, and keys below the section."""

    title: str
    file: _File
    section: str
    keys: dict[str, str]


def _weights(short: str, mission: str) -> dict[str, str]:
    words = ("safety", "time", "energy")
    return {f"WGT_{short}_{word.upper()}": f"{mission}.{word}" for word in words}


_GROUPS = (
    _Group(
        "Weights",
        _VEHICLE,
        "weights.",
        {
            **_weights("INSP", "inspection"),
            **_weights("EXIT", "exit"),
            **_weights("EVAC", "evacuation"),
        },
    ),
    _Group("Weights", _VEHICLE, "", {"ADAPTATION": "adaptation"}),
    _Group(
        "Distances",
        _VEHICLE,
        "",
        {
            "SAFE_RADIUS": "geometry.radius_m",
            "SAFE_D_MIN": "safety.d_min_m",
            "SAFE_D_MAX": "safety.d_max_m",
            "SAFE_COLLISION": "safety.weights.collision",
            "SAFE_INSERTION": "safety.weights.insertion",
            "SAFE_DAMAGE": "safety.weights.damage",
            "SAFE_EXPOSURE": "safety.exposure",
            "SAFE_TRK_MARGIN": "guidance.tracking_margin_m",
        },
    ),
    _Group(
        "Distances",
        _SERVICE,
        "supervision.",
        {
            "SAFE_POS_MARGIN": "position_uncertainty_m",
            "SAFE_FENCE": "fence_margin_m",
            "SAFE_PLANE": "plane_tolerance_m",
        },
    ),
    _Group(
        "Speeds",
        _VEHICLE,
        "speed.",
        {
            "SPEED_MIN": "min_mps",
            "SPEED_MAX": "max_mps",
            "SPEED_HORIZONTAL": "horizontal_mps",
            "SPEED_UP": "up_mps",
            "SPEED_DOWN": "down_mps",
            "SPEED_DIAG_UP": "diagonal_up_mps",
            "SPEED_DIAG_DOWN": "diagonal_down_mps",
        },
    ),
    _Group(
        "Guidance",
        _VEHICLE,
        "guidance.",
        {
            "GUID_YAW_RATE": "yaw_rate_deg_per_s",
            "GUID_YAW_MODE": "yaw_mode",
            "GUID_YAW_FIXED": "fixed_yaw_deg",
            "GUID_TRK_SLOW": "tracking_slow_m",
            "GUID_TRK_HOLD": "tracking_hold_m",
            "GUID_OFF_PATH": "off_path_m",
            "GUID_LEASH": "leash_m",
            "GUID_RECOVERY": "recovery_m",
            "GUID_LAND_HEIGHT": "landing_height_m",
        },
    ),
    _Group(
        "Replanning",
        _SERVICE,
        "replanning.",
        {
            "PLAN_PERIOD": "period_s",
            "PLAN_RISK_CHANGE": "risk_change",
            "PLAN_INTERVAL": "min_interval_s",
            "PLAN_IMPROVEMENT": "improvement",
        },
    ),
    _Group("Replanning", _SERVICE, "", {"SETPOINT_RATE": "setpoint_rate_hz"}),
    _Group(
        "Conditions",
        _SERVICE,
        "supervision.",
        {
            "LIM_WIND": "wind_limit_mps",
            "LIM_LOCALIZATION": "localization_limit",
            "LIM_UNCERTAINTY": "position_uncertainty_limit_m",
            "LIM_BATTERY": "battery_reserve",
            "LIM_GCS_LOST": "ground_link_lost_s",
            "LIM_GCS_ACTION": "ground_link_action",
            "LIM_EXPOSURE": "exposure_limit_s",
            "LIM_EXP_RESERVE": "exposure_reserve_s",
            "LIM_PLAN_STALE": "plan_stale_s",
            "LIM_READY": "ready_timeout_s",
            "LIM_DISK": "disk_free_mb",
            "LIM_MEMORY": "memory_free_mb",
        },
    ),
    _Group("Conditions", _VEHICLE, "power.", {"LIM_FLIGHT_TIME": "reserve_s"}),
    _Group(
        "Risks",
        _VEHICLE,
        "risk.",
        {
            "RISK_UNKNOWN": "unknown",
            "RISK_RECV_LOST": "receiver_lost",
            "RISK_WIND": "wind_mps",
            "RISK_GUST": "gust_mps",
            "RISK_TILT": "tilt_deg",
            "RISK_MOTOR": "motor_fraction",
            "RISK_TRACKING": "tracking_error_m",
            "RISK_RADIO": "radio_margin",
            "RISK_RC_RSSI": "rc_rssi",
            "RISK_RC_AGE": "remote_control_age_s",
            "RISK_GCS_AGE": "ground_station_age_s",
            "RISK_LOSS": "packet_loss",
            "RISK_SATS": "satellites",
            "RISK_HDOP": "hdop",
            "RISK_VDOP": "vdop",
            "RISK_H_ACCUR": "horizontal_accuracy_m",
            "RISK_V_ACCUR": "vertical_accuracy_m",
            "RISK_INNOV": "innovation",
            "RISK_MAGNETIC": "magnetic_change",
            "RISK_BATTERY": "battery_remaining",
            "RISK_CELL": "cell_voltage_v",
            "RISK_HOME": "home_margin_s",
        },
    ),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightParameter:
    """One parameter: a key of a file under a MAVLink name of at most 16 characters.

    file, keys: the file, and the path of the key in it; an integer is the index in a list. limits
    are in the unit of the file; optional: NONE is permitted, too. choices: values of the file,
    whose indices are those of the parameter; empty for a number.
    """

    name: str
    file: _File
    keys: tuple[str | int, ...]
    group: str
    unit: str
    minimum: float
    maximum: float
    default: float | None
    """None: the file has to have the key."""
    optional: bool
    choices: tuple[str, ...]
    description: str

    @property
    def is_integer(self) -> bool:
        """True for an INT32, False for a REAL32."""
        return bool(self.choices)

    @property
    def key(self) -> str:
        """The key as users read it."""
        return dotted(self.keys)

    @property
    def decimals(self) -> int:
        """Digits after the point that displays need."""
        return 0 if self.choices else _DECIMALS

    @property
    def short_description(self) -> str:
        """The first clause of the description."""
        end = next(
            at.start()
            for at in _CLAUSE_END.finditer(self.description)
            if self.description.count("(", 0, at.start())
            == self.description.count(")", 0, at.start())
        )
        part = self.keys[-1]
        return self.description[:end] + (f" (risk {part})" if isinstance(part, int) else "")

    @property
    def special_values(self) -> str:
        """Values with a meaning, in words; empty without any."""
        if self.optional:
            return f"{NONE:g} (none)"
        return ", ".join(f"{index} ({word})" for index, word in enumerate(self.choices))

    @property
    def allowed(self) -> str:
        """The permitted values in words."""
        limits = "" if self.choices else f"{self.minimum:g} to {self.maximum:g}"
        return " or ".join(filter(None, (limits, self.special_values)))

    def from_file(self, value: Any) -> float:
        """The parameter's value for that of the file."""
        if value is None:
            return NONE
        return float(self.choices.index(value)) if self.choices else float(value)

    def to_file(self, value: float) -> Any:
        """The file's value for that of the parameter; one that is no choice stays a number."""
        if self.optional and value == NONE:
            return None
        if self.choices and value.is_integer() and 0 <= value < len(self.choices):
            return self.choices[int(value)]
        return value


class ParameterError(Exception):
    """A value that is not set; its text: name, value, what is allowed."""


@functools.cache
def flight_parameters() -> Mapping[str, FlightParameter]:
    """All parameters by their names, in the order of their indices."""
    known = {_VEHICLE: keys(VehicleFile), _SERVICE: keys(COMPANION_FILE.schema)}
    return {
        item.name: item
        for group in _GROUPS
        for name, key in group.keys.items()
        for item in _parameters_of(group, name, known[group.file][group.section + key])
    }


def _parameters_of(group: _Group, name: str, key: FileKey) -> Iterator[FlightParameter]:
    """The parameter of a key, or those of both ends of a range."""
    path = tuple(key.name.split("."))
    if key.kind.get("type") != "array":
        yield _parameter(group, name, path, key, key.kind, key.default, key.description)
        return
    for index, (ending, default) in enumerate(zip(_RANGE_ENDS, key.default, strict=True)):
        text = f"{key.description} Here the risk is {index}."
        yield _parameter(
            group, name + ending, (*path, index), key, key.kind["items"], default, text
        )


def _parameter(
    group: _Group,
    name: str,
    path: tuple[str | int, ...],
    key: FileKey,
    kind: dict[str, Any],
    default: Any,
    description: str,
) -> FlightParameter:
    choices = tuple(kind.get("enum", ()))
    made = FlightParameter(
        name=name,
        file=group.file,
        keys=path,
        group=group.title,
        unit=key.unit,
        minimum=0.0 if choices else kind["minimum"],
        maximum=len(choices) - 1.0 if choices else kind["maximum"],
        default=None,
        optional=key.optional,
        choices=choices,
        description=description,
    )
    return made if key.needed else replace(made, default=made.from_file(default))


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightParameters:
    """Values of all parameters: those of the files, and above them those that were set.

    vehicle, service: the vehicle file and the sections of the configuration, as written in files.
    changed: values that were set, and differ from the files'. given: names that were set to any.
    """

    vehicle: Mapping[str, Any]
    service: Mapping[str, Any]
    changed: Mapping[str, float] = field(default_factory=dict)
    given: tuple[str, ...] = ()

    @classmethod
    def of(cls, vehicle: VehicleFile, config: CompanionConfig) -> FlightParameters:
        """The values of the files."""
        service = {key: as_written(getattr(config, key)) for key in _SECTIONS}
        return cls(vehicle=as_written(vehicle), service=service)

    def value(self, name: str) -> float:
        """Value of a parameter; KeyError for an unknown name."""
        return self.changed[name] if name in self.changed else self.in_file(name)

    def in_file(self, name: str) -> float:
        """Value of a parameter in its file, or its default."""
        parameter = flight_parameters()[name]
        value: Any = self.vehicle if parameter.file == _VEHICLE else self.service
        for part in parameter.keys:
            if isinstance(part, str) and part not in value:
                assert parameter.default is not None
                return parameter.default
            value = value[part]
        return parameter.from_file(value)

    def with_value(self, name: str, value: float) -> FlightParameters:
        """These with a parameter set, in the precision of MAVLink; a file's own value resets it.

        Raises KeyError for an unknown name, ParameterError for a value that the models of the
        files refuse, alone or beside the others.
        """
        parameter = flight_parameters()[name]
        given = shortest(value)
        if not math.isfinite(given) or (parameter.choices and parameter.to_file(given) == given):
            raise ParameterError(f"{name} is {value:g}, must be {parameter.allowed}")
        changed = {key: item for key, item in self.changed.items() if key != name}
        if given != shortest(self.in_file(name)):
            changed[name] = given
        made = replace(self, changed=changed, given=tuple(dict.fromkeys((*self.given, name))))
        model: FileModel | list[FileFinding]
        model = (_vehicle_model if parameter.file == _VEHICLE else _service_model)(made)
        if isinstance(model, list):
            model.sort(key=lambda finding: finding.key != parameter.keys)
            raise ParameterError(_problem(parameter, given, model[0]))
        return made

    def with_values_of(
        self, names: Iterable[str], other: FlightParameters
    ) -> FlightParameters | None:
        """These with some parameters as in `other`; None where they are not valid together."""
        taken = frozenset(names)
        changed = {name: item for name, item in self.changed.items() if name not in taken}
        changed |= {name: item for name, item in other.changed.items() if name in taken}
        given = tuple(name for name in self.given if name not in taken or name in other.given)
        made = replace(self, changed=changed, given=tuple(dict.fromkeys((*given, *other.given))))
        models = (_vehicle_model(made), _service_model(made))
        return None if any(isinstance(model, list) for model in models) else made

    def differing(self, other: FlightParameters) -> tuple[str, ...]:
        """Names of the parameters with another value in `other`."""
        names = dict.fromkeys((*self.changed, *other.changed))
        return tuple(name for name in names if self.value(name) != other.value(name))

    def with_stored(self, values: Mapping[str, float]) -> tuple[FlightParameters, list[str]]:
        """These with values that an earlier process has stored, and a text for each that fails.

        Values that are valid together are set in an order in which each is valid.
        """
        made, waiting, before = self, dict(values), len(values) + 1
        texts: list[str] = []
        while len(waiting) < before:
            before, texts = len(waiting), []
            for name, value in list(waiting.items()):
                try:
                    made = made.with_value(name, value)
                except KeyError:
                    texts.append(f"{name} is no parameter")
                except ParameterError as refused:
                    texts.append(str(refused))
                else:
                    del waiting[name]
        return made, texts

    def apply(self, config: CompanionConfig) -> tuple[CompanionConfig, Vehicle]:
        """The configuration with these values, and the vehicle."""
        service, vehicle = _service_model(self), _vehicle_model(self)
        assert not isinstance(service, list)
        assert not isinstance(vehicle, list)
        set_here = _config_of(service)
        sections = {key: getattr(set_here, key) for key in _SECTIONS}
        return replace(config, **sections), Vehicle.of(vehicle)


def _vehicle_model(parameters: FlightParameters) -> VehicleFile | list[FileFinding]:
    """The vehicle file with the values that were set, or its errors."""
    return validated(_written(parameters, _VEHICLE), VehicleFile, vehicle_findings)


def _service_model(parameters: FlightParameters) -> FileModel | list[FileFinding]:
    """The configuration's file with the values that were set, or its errors."""
    return validated(
        _written(parameters, _SERVICE),
        COMPANION_FILE.schema,
        lambda model: config_findings(_config_of(model)),
    )


def _written(parameters: FlightParameters, file: _File) -> dict[str, Any]:
    """The content of a file with the values that were set."""
    read = parameters.vehicle if file == _VEHICLE else parameters.service
    content: dict[str, Any] = _copied(read)
    for name, value in parameters.changed.items():
        parameter = flight_parameters()[name]
        if parameter.file == file:
            _put(content, parameter, value)
    return content


def _problem(parameter: FlightParameter, value: float, finding: FileFinding) -> str:
    """Text of a finding in the file after a value: `LIM_WIND is 200, must be at most 100`.

    A finding of another key has what is allowed in parentheses. Keys are named as parameters.
    """
    names = {
        row.keys[-1]: row.name
        for row in flight_parameters().values()
        if (row.file, row.keys[:-1]) == (parameter.file, finding.key[:-1])
    }
    problem = _KEY.sub(lambda word: names.get(word[0], word[0]), finding.problem)
    problem = problem.replace("must be less than", "must be <").replace("greater than", ">")
    if finding.key == parameter.keys:
        return f"{parameter.name} {problem}"
    key, (found, _, allowed) = finding.key[-1], problem.partition(", ")
    return f"{parameter.name} is {value:g}, {names.get(key, key)} {found} ({allowed})"


def _config_of(model: FileModel) -> CompanionConfig:
    """The configuration of a file without a vehicle."""
    return COMPANION_FILE.filled(model, vehicle=default_vehicle())


def _put(content: dict[str, Any], parameter: FlightParameter, value: float) -> None:
    """Sets a value in the content of a file."""
    *sections, key = parameter.keys
    at: Any = content
    for part in sections:
        at = at[part]
    at[key] = parameter.to_file(value)


def _copied(content: Any) -> Any:
    if isinstance(content, Mapping):
        return {key: _copied(item) for key, item in content.items()}
    return [_copied(item) for item in content] if isinstance(content, list) else content


def shortest(value: float) -> float:
    """The shortest decimal that is the same number in single precision: 0.3, not 0.30000001.

    Infinite where single precision ends; NaN stays.
    """
    single = _single(value)
    decimals = (float(f"{single:.{digits}g}") for digits in range(1, 10))
    return next((number for number in decimals if _single(number) == single), single)


def _single(value: float) -> float:
    """A number in single precision; infinite beyond its range."""
    try:
        (single,) = struct.unpack("<f", struct.pack("<f", value))
    except OverflowError:
        return math.copysign(math.inf, value)
    return float(single)
