"""A flight whose sources are received ten times a second until they are silenced."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from moar_companion.mavlink.radio import Radio
from moar_companion.mavlink.telemetry import (
    Attitude,
    AutopilotStatus,
    Battery,
    Estimator,
    Gnss,
    Home,
    Landed,
    LandedState,
    LinkStatistics,
    LocalPosition,
    MotorOutputs,
    PeerHeartbeat,
    RemoteControl,
    Telemetry,
    Wind,
)
from moar_companion.risk import IndexReport, InputReport, RiskEstimate, update
from moar_companion.risk.power import Demands, PowerModel
from moar_companion.settings.risk_model import RiskModel
from moar_companion.types import PX4, GeodeticPoint

Source = Callable[[float], Any]

HEALTHY: dict[str, Source] = {
    "autopilot": lambda t: AutopilotStatus(
        received_s=t,
        system_id=1,
        component_id=1,
        kind=PX4,
        armed=True,
        custom_mode=0,
        mode="OFFBOARD",
        ours=True,
        homeward=False,
        multirotor=True,
        failsafe=False,
    ),
    "landed": lambda t: Landed(received_s=t, state=LandedState.IN_AIR),
    "attitude": lambda t: Attitude(received_s=t, roll_rad=0.0, pitch_rad=0.0, yaw_rad=0.0),
    "local_position": lambda t: LocalPosition(
        received_s=t,
        boot_s=t,
        position_ned_m=(30.0, 0.0, -10.0),
        velocity_ned_mps=(0.0, 0.0, 0.0),
    ),
    "home": lambda t: Home(
        received_s=t,
        point=GeodeticPoint(latitude_deg=45.0, longitude_deg=-72.0, altitude_amsl_m=200.0),
        position_ned_m=(0.0, 0.0, 0.0),
    ),
    "batteries": lambda t: {
        0: Battery(received_s=t, remaining=0.9, voltage_v=16.0, current_a=15.0, charge_state=1)
    },
    "gnss": lambda t: Gnss(
        received_s=t,
        receiver_s=t,
        fix_type=3,
        satellites=14,
        hdop=0.7,
        vdop=1.1,
        horizontal_accuracy_m=0.9,
        vertical_accuracy_m=1.8,
    ),
    "estimator": lambda t: Estimator(
        received_s=t, flags=0x37F, horizontal_position_ok=True, horizontal_accuracy_m=0.3
    ),
    "wind": lambda t: Wind(received_s=t, velocity_ned_mps=(1.0, 0.0, 0.0)),
    "radio": lambda t: Radio(
        received_s=t,
        rssi=180,
        remote_rssi=175,
        noise=40,
        remote_noise=45,
        receive_errors=0,
        transmit_buffer_percent=95,
    ),
    "remote_control": lambda t: RemoteControl(received_s=t, rssi=0.9),
    "motors": lambda t: MotorOutputs(received_s=t, pulse_us=(1500, 1510, 1490, 1505)),
    "ground_station": lambda t: PeerHeartbeat(received_s=t, system_id=255),
    "link": lambda t: LinkStatistics(
        received_s=t, packets_received=round(100.0 * t), packets_lost=0
    ),
}


class Flight:
    """Risk estimate of an aircraft whose `sources` are received at every step."""

    def __init__(self, *, model: RiskModel | None = None, **sources: Source) -> None:
        self.model = model if model is not None else RiskModel()
        self.sources = dict(sources)
        self.telemetry = Telemetry()
        self.tracking_error_m: float | None = None
        self.estimate = RiskEstimate.unknown(self.model)
        self.power: PowerModel | None = None
        self.demands: Demands | None = None
        self.now_s = 100.0

    @classmethod
    def healthy(cls, *, model: RiskModel | None = None) -> Flight:
        return cls(model=model, **HEALTHY)

    def fly(self, duration_s: float, *, step_s: float = 0.1) -> RiskEstimate:
        for _ in range(round(duration_s / step_s)):
            self.now_s += step_s
            received = {name: source(self.now_s) for name, source in self.sources.items()}
            self.telemetry = replace(self.telemetry, **received)
            self.estimate = update(
                self.estimate,
                self.telemetry,
                self.now_s,
                model=self.model,
                cruise_mps=5.0,
                tracking_error_m=self.tracking_error_m,
                power=self.power,
                demands=self.demands,
            )
        return self.estimate

    def handle(self, name: str, **changes: Any) -> None:
        """Changes the values of a source from now on."""
        before = HEALTHY[name]
        self.sources[name] = lambda t: replace(before(t), **changes)

    def silence(self, *names: str) -> None:
        """Silences these sources from now on; their last values stay."""
        for name in names:
            self.sources.pop(name, None)

    def input(self, index: str, name: str) -> InputReport:
        report: IndexReport = getattr(self.estimate.report, index)
        return next(found for found in report.inputs if found.name == name)


@pytest.fixture
def healthy() -> dict[str, Source]:
    return dict(HEALTHY)


@pytest.fixture(scope="session")
def settled() -> Flight:
    flight = Flight.healthy()
    flight.fly(60.0)
    return flight


@pytest.fixture
def flight(settled: Flight) -> Flight:
    """A healthy flight whose indices have settled."""
    twin = copy.copy(settled)
    twin.sources = dict(settled.sources)
    return twin


@pytest.fixture(scope="session")
def new_flight() -> type[Flight]:
    return Flight
