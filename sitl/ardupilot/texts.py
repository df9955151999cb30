"""ArduPilot's texts: STATUSTEXT to every link, those of a start by the clock.

Texts and times as recorded from ArduCopter 4.6.3.
"""

from typing import Final

from sitl.links import Router
from sitl.wire import layout, status_texts
from sitl.world import World

CRITICAL: Final = 2
WARNING: Final = 4
NOTICE: Final = 5
INFO: Final = 6
_BOOT_TEXTS: Final = (
    (1_920_000, "Barometer 1 calibration complete"),
    (1_920_000, "Barometer 2 calibration complete"),
    (2_450_000, "ArduPilot Ready"),
    (2_450_000, "AHRS: DCM active"),
    (2_750_000, "RC7: SaveWaypoint MIDDLE"),
    (4_450_000, "EKF3 IMU0 initialised"),
    (4_450_000, "EKF3 IMU1 initialised"),
    (4_460_000, "AHRS: EKF3 active"),
    (5_800_000, "EKF3 IMU0 tilt alignment complete"),
    (5_800_000, "EKF3 IMU1 tilt alignment complete"),
    (5_900_000, "EKF3 IMU0 MAG0 initial yaw alignment complete"),
    (5_900_000, "EKF3 IMU1 MAG0 initial yaw alignment complete"),
    (9_810_000, "GPS 1: probing for u-blox at 230400 baud"),
    (9_830_000, "GPS 1: detected u-blox"),
)
"""Texts by time after the start; later texts depend on the estimator."""


class TextSender:
    """Sends texts on all links."""

    def __init__(self, world: World, router: Router, boot_us: int) -> None:
        """Start without a text."""
        self._world = world
        self._router = router
        self._boot_us = boot_us
        self._text_id = 0
        self._boot_texts = list(_BOOT_TEXTS)

    def step(self) -> None:
        """Send the texts of the start that are due."""
        while self._boot_texts and self._since_boot_us >= self._boot_texts[0][0]:
            self.send(INFO, self._boot_texts.pop(0)[1])

    @property
    def _since_boot_us(self) -> int:
        return self._world.now_us - self._boot_us

    def send(self, severity: int, text: str) -> None:
        """Send a text to all links, also to companions."""
        self._text_id = self._text_id % 65535 + 1
        kind = layout("STATUSTEXT")
        payloads = status_texts(severity, text, self._text_id)
        for link in self._router.links.values():
            for payload in payloads:
                link.send(kind, payload)
