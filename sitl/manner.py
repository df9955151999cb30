"""What an autopilot's manner is to the machine around it."""

from typing import Any, Protocol


class Manner(Protocol):
    """The behaviour of one kind of autopilot: it answers messages, flies and emits telemetry."""

    @property
    def running(self) -> bool:
        """Whether its links work; not while it boots."""

    @property
    def armed(self) -> bool:
        """Whether the motors may turn."""

    @property
    def mode_name(self) -> str:
        """The autopilot's own word for its flight mode."""

    @property
    def landed_state(self) -> int:
        """MAV_LANDED_STATE as the autopilot believes it."""

    def receive(self, link: str, message: Any) -> None:
        """Take one decoded message that arrived on a link."""

    def control(self) -> None:
        """Decide and write the demand of the airframe; before the physics of each tick."""

    def emit(self) -> None:
        """Send whatever telemetry is due; after the physics of each tick."""
