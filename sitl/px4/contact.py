"""Peers with a loss report of PX4 after a time without a heartbeat, and its texts.

Texts and severities are those of PX4 v1.17.0's Commander::dataLinkCheck.
"""

from sitl.parameters import Parameters
from sitl.px4.texts import INFO, TextSender
from sitl.world import World


class Contact:
    """The companion, or the ground station."""

    def __init__(
        self,
        world: World,
        text_sender: TextSender,
        parameters: Parameters,
        timeout: str,
        *,
        lost: tuple[int, str],
        regained: str,
    ) -> None:
        """Start without a heartbeat. timeout: a parameter in seconds; lost: severity and text."""
        self._world = world
        self._text_sender = text_sender
        self._parameters = parameters
        self._timeout = timeout
        self._text_lost = lost
        self._text_regained = regained
        self._received_us: int | None = None
        self._lost = False

    @property
    def there(self) -> bool:
        """True while the station has been received and is not lost."""
        return self._received_us is not None and not self._lost

    def receive_heartbeat(self) -> None:
        """Note a heartbeat."""
        self._received_us = self._world.now_us
        if self._lost:
            self._lost = False
            self._text_sender.send(INFO, self._text_regained)

    def judge(self) -> None:
        """Report the loss, once."""
        if self._received_us is None or self._lost:
            return
        silent_us = self._world.now_us - self._received_us
        self._lost = silent_us > self._parameters.value(self._timeout) * 1e6
        if self._lost:
            self._text_sender.send(*self._text_lost)
