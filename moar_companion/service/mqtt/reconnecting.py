"""Times of the attempts to connect, and log lines of a connection. Pure."""

from __future__ import annotations

_FIRST_S, _LONGEST_S = 1.0, 30.0
_STEADY_S = 30.0
"""Length of a connection after which the pauses begin again with the shortest."""


class Backoff:
    """Pauses between attempts: doubled each time, up to 30 s, each shortened at random."""

    def __init__(self) -> None:
        self._next_s = _FIRST_S

    def pause_s(self, random: float, connected_s: float) -> float:
        """Pause after an attempt.

        random: in [0, 1); the pause is between its half and the whole, so that a hundred vehicles
        do not return to a restarted broker at once. connected_s: length of the connection.
        """
        if connected_s >= _STEADY_S:
            self._next_s = _FIRST_S
        pause_s = self._next_s * (0.5 + 0.5 * random)
        self._next_s = min(_LONGEST_S, 2.0 * self._next_s)
        return pause_s


class ConnectionLog:
    """One line per change: connected, lost with its reason, another reason of the outage."""

    def __init__(self, broker: str) -> None:
        self._broker = broker
        self._reasons: set[str] = set()
        self._connected = False

    def connected(self) -> str:
        """The line of a new connection."""
        self._reasons.clear()
        self._connected = True
        return f"MQTT: connected to {self._broker}"

    def lost(self, reason: str) -> str | None:
        """Line of a failed attempt, or of a connection's end; None if already written."""
        how = "lost" if self._connected else "no connection"
        self._connected = False
        if reason in self._reasons:
            return None
        self._reasons.add(reason)
        return f"MQTT: {how}: {self._broker}: {reason}; flying on, trying again"
