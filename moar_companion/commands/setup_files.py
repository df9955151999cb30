"""The files that `setup` writes: a vehicle of answers, a configuration with a link. Pure."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass

from ..mavlink.autopilots import profile
from ..mavlink.autopilots.parameter_names import Parameters
from ..mavlink.telemetry import Telemetry
from ..risk.power.cells import is_of_cells, is_powered
from ..settings.config import Authority, CompanionConfig
from ..settings.link_config import LinkRole
from ..settings.yaml_edit import with_values
from ..types import AutopilotKind

LEAST_MPS = 0.5
"""v_MIN of the shipped vehicles."""
CAUTIOUS_SPEEDS_MPS = (2.0, 1.0, 1.0)
"""Cruising speeds level, up and down where the autopilot reports none."""
_NOMINAL_V = 3.7
"""Voltage of a lithium cell by which its charge in Ah becomes energy."""
_MOST_CELLS = 14
_SINE_45 = math.sin(math.radians(45.0))
_STRAY_M = 0.5
"""Distance from its setpoint that an accelerating aircraft may have."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleAnswers:
    """What is asked of a vehicle, or read from its autopilot."""

    name: str
    autopilot: AutopilotKind
    radius_m: float
    speeds_mps: tuple[float, float, float]
    """Cruising speeds level, up and down."""
    speeds_from: str
    cells: int | None = None
    capacity_mah: float | None = None


def speeds_of(
    kind: AutopilotKind, parameters: Parameters
) -> tuple[tuple[float, float, float] | None, str]:
    """The autopilot's own cruising speeds level, up and down, and their parameters for texts.

    None unless all three are reported and fast enough to fly.
    """
    keys = profile(kind).speed_parameters
    values = tuple(parameters.get(key) or 0.0 for key in keys)
    if len(values) != 3 or min(values) < LEAST_MPS:
        return None, ""
    level_mps, up_mps, down_mps = (round(value, 2) for value in values)
    return (level_mps, up_mps, down_mps), ", ".join(parameters.shown(keys))


def cells_of(kind: AutopilotKind, parameters: Parameters, telemetry: Telemetry) -> int | None:
    """Cells of the battery: of a parameter, as reported, or the only number of its voltage."""
    key = profile(kind).cells_parameter
    value = None if key is None else parameters.get(key)
    if value:
        return int(value)
    batteries = [item for item in telemetry.batteries.values() if is_powered(item)]
    reported = {item.cells for item in batteries if item.cells is not None}
    if len(reported) == 1:
        return reported.pop()
    volts = [item.voltage_v for item in batteries if item.voltage_v is not None]
    fitting = [
        count
        for count in range(2, _MOST_CELLS + 1)
        if volts and all(is_of_cells(voltage_v, count) for voltage_v in volts)
    ]
    return fitting[0] if len(fitting) == 1 else None


def capacity_of(kind: AutopilotKind, parameters: Parameters) -> float | None:
    """Capacity of the battery in mAh; None where the autopilot has none."""
    key = profile(kind).capacity_parameter
    value = None if key is None else parameters.get(key)
    return value if value is not None and value > 0.0 else None


def vehicle_text(answers: VehicleAnswers) -> str:
    """The text of a vehicle file."""
    level_mps, up_mps, down_mps = answers.speeds_mps
    diagonals = [
        max(LEAST_MPS, math.floor(min(level_mps, vertical_mps) / _SINE_45 * 10.0) / 10.0)
        for vertical_mps in (up_mps, down_mps)
    ]
    lines = [
        "# Written by moar-companion setup. configs/reference.md has all keys.",
        f"name: {json.dumps(answers.name, ensure_ascii=False)}",
        f"autopilot: {answers.autopilot}",
        "",
        "# Half the distance between opposite motors, and half a propeller.",
        f"geometry: {{radius_m: {answers.radius_m:g}}}",
        "",
        "# Distances and weights of the paper.",
        "safety:",
        "  d_min_m: 1.2",
        "  d_max_m: 3.0",
        "  weights: {collision: 0.3, insertion: 0.2, damage: 0.5}",
        "",
        f"# Level, up and down: {answers.speeds_from}. Along a diagonal the slower of both rules.",
        "speed:",
        f"  min_mps: {LEAST_MPS:g}",
        f"  horizontal_mps: {level_mps:g}",
        f"  up_mps: {up_mps:g}",
        f"  down_mps: {down_mps:g}",
        f"  diagonal_up_mps: {diagonals[0]:g}",
        f"  diagonal_down_mps: {diagonals[1]:g}",
        "",
        "weights:",
        "  inspection: {safety: 0.4, time: 0.5, energy: 0.1}",
        "  exit: {safety: 0.33, time: 0.33, energy: 0.33}",
        "  evacuation: {safety: 0.6, time: 0.2, energy: 0.2}",
    ]
    known = profile(answers.autopilot)
    if known.stray_s2 > 0.0:
        acceleration_mps2 = math.floor(_STRAY_M / known.stray_s2 * 10.0) / 10.0
        lines += ["", f"# {known.name} strays {known.stray_s2:g} m per m/s² of its setpoints."]
        lines += [f"guidance: {{acceleration_mps2: {acceleration_mps2:g}}}"]
    if answers.cells is not None:
        lines += ["", f"risk: {{cells: {answers.cells}}}"]
        if answers.capacity_mah is not None:
            energy_wh = answers.capacity_mah * 1e-3 * answers.cells * _NOMINAL_V
            lines += [f"# {answers.capacity_mah:g} mAh at {_NOMINAL_V:g} V a cell."]
            lines += [f"power: {{capacity_wh: {energy_wh:.0f}}}"]
    return "\n".join(lines) + "\n"


def config_text(
    text: str,
    source: str,
    *,
    before: CompanionConfig | None,
    url: str,
    vehicle: str,
    site: str | None,
    authority: Authority,
) -> str:
    """The text of a configuration with the link, vehicle, site and authority of `setup`.

    before: the configuration that it replaces, whose links to operators stay, as does the signing
    of its link to the autopilot.
    """
    links = [] if before is None else before.links
    signed = any(link.signed for link in links if link.role is LinkRole.AUTOPILOT)
    kept: list[Mapping[str, object]] = [{"url": url, "role": "autopilot", "signed": signed}]
    kept += [
        {"url": link.url, "role": link.role.value, "signed": link.signed}
        for link in links
        if link.role is LinkRole.OPERATOR
    ]
    values = {
        "vehicle": json.dumps(vehicle, ensure_ascii=False),
        "site": "null" if site is None else json.dumps(site, ensure_ascii=False),
        "links": json.dumps(kept, ensure_ascii=False),
        "authority": authority.value,
    }
    return with_values(text, source, values)
