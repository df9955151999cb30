"""Growth of the position's uncertainty: how fast it rises, steadily, and its forecast. Pure.

Inputs: the reports of one source. Outputs: its rate, and its value at a later time.
"""

from __future__ import annotations

from typing import NamedTuple

_WINDOW_S = 1.5
"""Growth counts that lasts for two of these: a step, as of a worse dilution, is no growth. Each
begins and ends at a report, and is longer where reports are rare: PX4's ESTIMATOR_STATUS comes once
a second."""
_PERIOD_S = 0.25
_KEPT_S = 10.0
"""Two windows with two lost reports each, at one a second."""
AHEAD_S = 8.0
"""Forecast: braking, a leg of some metres, and the time in which its need is recognised."""


class UncertaintyGrowth(NamedTuple):
    """Reports of the last seconds: time and value in metres, the oldest first."""

    reports: tuple[tuple[float, float], ...] = ()

    def followed(self, value_m: float, received_s: float) -> UncertaintyGrowth:
        """Returns the growth after a report; unchanged without a newer one."""
        if self.reports and received_s <= self.reports[-1][0]:
            return self
        kept = [item for item in self.reports if received_s - item[0] <= _KEPT_S]
        if len(kept) > 1 and received_s - kept[-2][0] < _PERIOD_S:
            kept.pop()  # the newest report alone lies nearer to its predecessor
        return UncertaintyGrowth((*kept, (received_s, value_m)))

    @property
    def rate_mps(self) -> float:
        """The lesser rate of the last two windows; 0 while it does not grow in both."""
        newest = self.reports[-1] if self.reports else None
        middle = self._window_before(newest)
        first = self._window_before(middle)
        if newest is None or middle is None or first is None:
            return 0.0
        return max(0.0, min(_rate_mps(middle, newest), _rate_mps(first, middle)))

    def at_m(self, time_s: float) -> float:
        """Value at a time after the last report, at its rate."""
        if not self.reports:
            return 0.0
        newest_s, newest_m = self.reports[-1]
        return newest_m + max(0.0, time_s - newest_s) * self.rate_mps

    def _window_before(self, end: tuple[float, float] | None) -> tuple[float, float] | None:
        """The last report a window or more before another; None where there is none."""
        if end is None:
            return None
        earlier = (item for item in reversed(self.reports) if item[0] <= end[0] - _WINDOW_S)
        return next(earlier, None)


def _rate_mps(first: tuple[float, float], last: tuple[float, float]) -> float:
    return (last[1] - first[1]) / (last[0] - first[0])
