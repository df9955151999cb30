"""PX4's texts and events: STATUSTEXT to ground stations, EVENT to every link.

Event numbers, log levels and arguments as recorded from PX4 v1.17.0.
"""

import struct
from typing import Final

from sitl.links import Link, Router
from sitl.px4.failsafe import Cause, Charge
from sitl.px4.modes import Mode
from sitl.wire import layout, status_texts
from sitl.world import World

CRITICAL: Final = 2
EMERGENCY: Final = 0
INFO: Final = 6
_FIRST_SEQUENCE: Final = 65526

LOG_FILE, ARMED, DISARMED = 17980399, 26266355, 32794487
TAKEOFF_DETECTED, LANDING_DETECTED = 21054825, 26622124
RETURN_START, RETURN_LAND = 22161044, 16962474
FAILSAFE, FAILSAFE_CAUSED, FAILSAFE_HOLD = 31382480, 26528394, 30481910
FAILSAFE_DISENGAGED = 29547634
PILOT_TOOK_OVER, MODE_UNAVAILABLE = 18523838, 27280279
BATTERY = {
    Charge.LOW: (CRITICAL, "Low battery", 21826980, 0x22),
    Charge.CRITICAL: (CRITICAL, "Critical battery", 19404811, 0x22),
    Charge.EMERGENCY: (EMERGENCY, "Emergency battery level", 28121863, 0x00),
}
"""By charge state: severity and text; number and log levels of the event."""
ARMING_SUMMARY, NO_LOCAL_POSITION, NO_GLOBAL_POSITION = 27825120, 30612409, 26788467
NO_MISSION, NO_OFFBOARD_SIGNAL, NO_STICKS = 17154777, 19865031, 17231145
HEALTH_SUMMARY = 18691879
_ACTIONS: Final = {
    Mode.POSCTL: 2,
    Mode.ALTCTL: 3,
    Mode.MANUAL: 4,
    Mode.HOLD: 5,
    Mode.RTL: 6,
    Mode.LAND: 7,
    Mode.DESCEND: 8,
}
"""PX4's numbers of failsafe actions, as its events carry them."""


class TextSender:
    """Sends texts and events on the links that get them."""

    def __init__(self, world: World, router: Router, boot_us: int) -> None:
        """Number the first event as PX4 does."""
        self._world = world
        self._router = router
        self._boot_us = boot_us
        self._sequence = _FIRST_SEQUENCE - 1
        self._text_id = 0
        self.muted = True

    @property
    def sequence(self) -> int:
        """The last event's number."""
        return self._sequence & 0xFFFF

    def send(self, severity: int, text: str) -> None:
        """Send a text, with PX4's closing tab, to the links of ground stations."""
        if self.muted:
            return
        self._text_id = self._text_id % 65535 + 1
        payloads = status_texts(severity, f"{text}\t", self._text_id)
        kind = layout("STATUSTEXT")
        for link in self._router.links.values():
            if receives_texts(link):
                for payload in payloads:
                    link.send(kind, payload)

    def event(self, identifier: int, levels: int, arguments: bytes = b"") -> None:
        """Send an event to every link."""
        self._sequence += 1
        if self.muted:
            return
        kind = layout("EVENT")
        payload = kind.payload(
            id=identifier,
            event_time_boot_ms=(self._world.now_us - self._boot_us) // 1000,
            sequence=self._sequence & 0xFFFF,
            destination_component=0,
            destination_system=0,
            log_levels=levels,
            arguments=arguments,
        )
        for link in self._router.links.values():
            link.send(kind, payload)

    def health(self, *, position: bool, offboard: bool) -> None:
        """Send PX4's group of health events, with the arguments it sends in these three states."""
        if not position:
            arming, summary = "000000120180000000803a0180803a0180", "00020c0238"
        elif not offboard:
            arming, summary = "000000100080000000b03a7f80b03a7f80", "000a1c0238"
        else:
            arming, summary = "000000000080000000b07a7f80b07a7f80", "000a1c0238"
        self.event(ARMING_SUMMARY, 0x88, bytes.fromhex(arming))
        if not position:
            self.event(NO_LOCAL_POSITION, 0x33, bytes.fromhex("7c007e0011"))
            self.event(NO_GLOBAL_POSITION, 0x33, bytes.fromhex("3800000018"))
        self.event(NO_MISSION, 0x66, bytes.fromhex("0800000014"))
        if not offboard:
            self.event(NO_OFFBOARD_SIGNAL, 0x33, bytes.fromhex("0040000014"))
        self.event(NO_STICKS, 0x44, bytes.fromhex("ffffffff07"))
        self.event(HEALTH_SUMMARY, 0x88, bytes.fromhex(summary))

    def failsafe(
        self, *, mode: Mode, intended: Mode, final: Mode, cause: Cause, hold_s: int | None
    ) -> None:
        """Report that a failsafe flies `mode`, not the intended one, or holds before `final`."""
        if hold_s is not None:
            self.send(CRITICAL, f"Failsafe activated: entering Hold for {hold_s} seconds")
            arguments = struct.pack(
                "<IBHB", intended.custom_mode, _ACTIONS[final], hold_s, cause.value
            )
            self.event(FAILSAFE_HOLD, 0x42, arguments)
            return
        self.send(CRITICAL, "Failsafe activated")
        arguments = struct.pack("<IB", intended.custom_mode, _ACTIONS.get(mode, 0))
        if cause > 0:
            self.event(FAILSAFE_CAUSED, 0x42, arguments + bytes((cause.value,)))
        elif mode is Mode.ALTCTL:
            self.event(FAILSAFE_DISENGAGED, 0x42, arguments)
        else:
            self.event(FAILSAFE, 0x42, arguments)

    def unavailable(self, mode: Mode) -> None:
        """Report that a mode is not available now."""
        self.send(CRITICAL, f"Switching to {mode.title} is currently not available")
        self.event(MODE_UNAVAILABLE, 0x62, struct.pack("<IB", mode.custom_mode, 2))

    def return_start(self, altitude_amsl_m: float, above_home_m: float) -> None:
        """Report the altitude of the return."""
        altitude, above = round(altitude_amsl_m), round(above_home_m)
        self.send(INFO, f"RTL: start return at {altitude} m ({above} m above destination)")
        self.event(RETURN_START, 0x66, struct.pack("<ii", altitude, above))


def receives_texts(link: Link) -> bool:
    """Return True for links that get PX4's texts: of ground stations, or one was received there."""
    return link.profile == "normal" or link.ground_station_received
