"""Parameters of the autopilot that would be better otherwise, and files of them. Pure.

Inputs: the reported parameters, judged by the rules of `check`. Outputs: a value for each that is
a warning or worse and has one, with the reason; the text of a parameter file for a ground station.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from ...mavlink.autopilots.parameter_names import Parameters
from ...mavlink.autopilots.parameter_rules import Level, Rule
from ...mavlink.autopilots.profile import Profile
from ...mavlink.identity import Autopilot
from ...settings.config import LossCheck
from ...settings.vehicle import Vehicle
from .aircraft_check import judged_case

_REAL32 = 9
"""MAV_PARAM_TYPE_REAL32."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Advice:
    """A better value of one parameter. name, present, value: in the firmware's name and unit."""

    name: str
    present: float
    value: float
    reason: str

    def __str__(self) -> str:
        return f"{self.name} {self.present:g} -> {self.value:g}: {self.reason}"


def advices(
    autopilot: Profile,
    parameters: Parameters,
    vehicle: Vehicle,
    policy: LossCheck,
    *,
    ground_station_received: bool,
) -> list[Advice]:
    """Advice on each parameter that `check` would warn of, and of which a better value is known.

    A parameter that was not reported is left as it is.
    """
    found = []
    for rule in autopilot.rules:
        before = _judged(autopilot, rule, parameters, vehicle, policy, ground_station_received)
        if before is None:
            continue
        level, words, value = before
        if level < Level.WARNING or value is None:
            continue
        changed = Parameters(
            {**parameters, rule.parameter: value},
            {key: parameters.called(key) for key in parameters},
        )
        after = _judged(autopilot, rule, changed, vehicle, policy, ground_station_received)
        if after is None or after[0] >= level:
            continue
        name, present = parameters.called(rule.parameter), parameters[rule.parameter] or 0.0
        found.append(
            Advice(
                name=name.name,
                present=present / name.scale,
                value=value / name.scale,
                reason=f"{rule.meaning}: {words}",
            )
        )
    return found


def _judged(
    autopilot: Profile,
    rule: Rule,
    parameters: Parameters,
    vehicle: Vehicle,
    policy: LossCheck,
    ground_station_received: bool,
) -> tuple[Level, str, float | None] | None:
    """Level and words of a parameter, and the advised value; None if it was not reported."""
    value, loss = parameters.get(rule.parameter), autopilot.offboard_loss(parameters)
    if value is None or loss is None:
        return None
    case = judged_case(
        parameters, loss, vehicle, policy, ground_station_received=ground_station_received
    )
    level, words = rule.judge(value, case)
    advised = rule.advised
    return level, words, advised(value, case) if callable(advised) else advised


def qgroundcontrol_text(
    found: Iterable[Advice], autopilot: Autopilot, types: Mapping[str, int]
) -> str:
    """A `.params` file: five columns separated by tabs, the reason in a comment above each line.

    QGroundControl skips lines that begin with `#`, and takes only lines of exactly five columns
    (`Parameter.cc`, ParameterManager::readParametersFromStream).
    """
    lines = ["# Vehicle-Id Component-Id Name Value Type"]
    for each in found:
        ids = f"{autopilot.system_id}\t{autopilot.component_id}"
        value, kind = f"{each.value:.9g}", types.get(each.name, _REAL32)
        lines += [f"# {each.reason}", f"{ids}\t{each.name}\t{value}\t{kind}"]
    return "\n".join(lines) + "\n"


def mission_planner_text(found: Iterable[Advice]) -> str:
    """A `.param` file: `NAME,VALUE`, the reason in a comment above each line."""
    lines = []
    for each in found:
        lines += [f"# {each.reason}", f"{each.name},{each.value:.9g}"]
    return "\n".join(lines) + "\n"
