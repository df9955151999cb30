"""The fake autopilot and its operator (a ground station, 255/190), in steps of one clock."""

from __future__ import annotations

import copy
from dataclasses import replace

from sitl.autopilot import DEFAULT_LINKS, FakeAutopilot, Options, Truth
from sitl.px4.streams import IDS
from sitl.signing import SignOptions

from ..copies import flown_once
from .operator import READ, Manner, Operator

STEP_S = 0.02


def set_unread_streams(autopilot: FakeAutopilot, interval_us: int) -> None:
    """Of PX4's 400 messages a second to a ground station, an operator here reads three.

    interval_us: of all others; -1: off, 0: PX4's own.
    """
    if autopilot.options.autopilot == Manner.PX4.value:
        schedule = autopilot.manner._schedule("gcs")
        for message_id in IDS.keys() - READ:
            schedule.set(message_id, interval_us, autopilot.manner._boot_us)


class Aircraft:
    """Autopilot and operator, and the bytes between them. secret: key of all signed links."""

    def __init__(self, options: Options, *, secret: bytes | None = None) -> None:
        if secret is not None:
            signed = SignOptions(key=secret)
            options = replace(
                options, links=tuple(replace(link, signing=signed) for link in DEFAULT_LINKS)
            )
        self.autopilot = FakeAutopilot(options)
        self.operator = Operator(self.autopilot, Manner(options.autopilot))
        if secret is not None:
            self.operator.sign(secret)
        self.set_unread_streams(-1)
        self.now_s = 0.0

    def set_unread_streams(self, interval_us: int) -> None:
        set_unread_streams(self.autopilot, interval_us)

    def __deepcopy__(self, memo):
        """Independent copy; constants and past data are shared."""
        memo |= {id(item): item for item in self._constants()}
        twin = memo[id(self)] = copy.copy(self)
        for name, value in vars(self).items():
            past = isinstance(value, list)
            setattr(twin, name, list(value) if past else copy.deepcopy(value, memo))
        return twin

    def _constants(self) -> list:
        return [self.autopilot.options, *self.operator.received]

    @property
    def truth(self) -> Truth:
        return self.autopilot.truth

    @property
    def status(self) -> str:
        """Text for the message of a failing test."""
        return f"mode {self.truth.mode}, texts {self.operator.texts()[-5:]}"

    def move(self) -> list[bytes]:
        """A step of time; returns the autopilot's packets for the companion."""
        self.now_s += STEP_S
        self.operator.tick(self.now_s)
        self.autopilot.step(self.now_s)
        sent = []
        for link, data in self.autopilot.data_to_send():
            if link == "gcs":
                self.operator.receive(data)
            else:
                sent.append(data)
        return sent

    def step(self) -> None:
        self.move()

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.step()

    def run_until(self, condition, timeout_s: float) -> None:
        """Runs until a condition holds; fails when it does not within the time."""
        end_s = self.now_s + timeout_s
        while not condition():
            if self.now_s >= end_s:
                raise AssertionError(f"not within {timeout_s:g} s: {self.status}")
            self.step()

    def land(self) -> None:
        """The operator gives LAND; runs until the aircraft is on the ground, disarmed."""
        self.operator.mode("land")
        self.run_until(lambda: self.truth.on_ground and not self.truth.armed, 60.0)
        self.run(1.0)

    def take_off(self, height_m: float = 3.0) -> None:
        """Boot, arm, take off and hover, as an operator would."""
        if self.operator.manner is Manner.PX4:
            self.run(8.0)
            self.operator.take_off(height_m)
            self.run(0.1)
            self.operator.arm()
            hovering_in = "hold"
        else:
            self.run_until(lambda: self.operator.has_received("EKF3 IMU0 is using GPS"), 60.0)
            self.operator.mode("ours")
            self.run(0.1)
            self.operator.arm()
            self.run(2.5)
            self.operator.take_off(height_m)
            self.autopilot.move_sticks()
            hovering_in = "ours"
        self.run_until(
            lambda: (
                self.truth.landed_state == 2
                and self.operator.in_mode(hovering_in)
                and abs(self.truth.velocity_ned_mps[2]) < 0.1
            ),
            30.0,
        )
        self.run(0.5)  # until a companion has received it, too


@flown_once
def in_the_air(options: Options, secret: bytes | None, height_m: float) -> Aircraft:
    """An aircraft that hovers after `take_off`, with the operator only."""
    aircraft = Aircraft(options, secret=secret)
    aircraft.take_off(height_m)
    return aircraft
