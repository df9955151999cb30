"""Growth of the position's uncertainty: how fast it rises, steadily, and its forecast. Pure.

Inputs: the reported uncertainty at each moment. Outputs: its rate, and the next value.
"""

from __future__ import annotations

from typing import NamedTuple

_WINDOW_S = 1.5
"""Growth counts that lasts for two of these: a step, as of a worse dilution, is no growth. The
slowest report, PX4's ESTIMATOR_STATUS, comes once a second."""
_PERIOD_S = 0.25
AHEAD_S = 8.0
"""Forecast: braking, a leg of some metres, and the time in which its need is recognised."""


class UncertaintyGrowth(NamedTuple):
    """Samples of the last seconds: time and value in metres, the oldest first."""

    samples: tuple[tuple[float, float], ...] = ()

    def followed(self, value_m: float | None, now_s: float) -> UncertaintyGrowth:
        """Returns the growth after a report; an unknown value begins anew."""
        if value_m is None:
            return UncertaintyGrowth()
        kept = [item for item in self.samples if now_s - item[0] <= 2.0 * _WINDOW_S + _PERIOD_S]
        if len(kept) > 1 and now_s - kept[-2][0] < _PERIOD_S:
            kept.pop()  # the newest value alone lies nearer to its predecessor
        return UncertaintyGrowth((*kept, (now_s, value_m)))

    @property
    def rate_mps(self) -> float:
        """The lesser rate of the last two windows; 0 while it does not grow in both."""
        if not self.samples:
            return 0.0
        now_s, now_m = self.samples[-1]
        middle_m, first_m = (self._before(now_s - count * _WINDOW_S) for count in (1, 2))
        if middle_m is None or first_m is None:
            return 0.0
        return max(0.0, min(now_m - middle_m, middle_m - first_m) / _WINDOW_S)

    def _before(self, time_s: float) -> float | None:
        """The last value until a time; None where it is older than the samples."""
        return next((value_m for at_s, value_m in reversed(self.samples) if at_s <= time_s), None)
