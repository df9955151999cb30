"""Mean over a short time of a sampled value. Pure.

A jump of the setpoint takes the motors to their limit for one sample; wind holds them there. A
sample is valid until the next one, so that the last sample counts up to now.
"""

from __future__ import annotations

from typing import NamedTuple

WINDOW_S = 0.8
"""Window of the mean: four samples at 5 Hz, and less than the maximum age of motor samples."""


class Sample(NamedTuple):
    """A value, and the time of its reception."""

    received_s: float
    value: float


def then(samples: tuple[Sample, ...], latest: Sample, max_age_s: float) -> tuple[Sample, ...]:
    """Samples of the last `WINDOW_S`, the one valid before them, and the latest.

    The window restarts after a gap of more than `max_age_s`.
    """
    if samples and latest.received_s <= samples[-1].received_s:
        return samples
    if not samples or latest.received_s - samples[-1].received_s > max_age_s:
        return (latest,)
    begin_s = latest.received_s - WINDOW_S
    standing = sum(sample.received_s <= begin_s for sample in samples[1:])
    return (*samples[standing:], latest)


def mean(samples: tuple[Sample, ...], now_s: float) -> float | None:
    """Mean over the last `WINDOW_S`, or since the first of the samples; None without any."""
    if not samples:
        return None
    begin_s = max(samples[0].received_s, now_s - WINDOW_S)
    if now_s <= begin_s:
        return samples[-1].value
    ends_s = [*(sample.received_s for sample in samples[1:]), now_s]
    stood = (
        value * max(0.0, end_s - max(begin_s, received_s))
        for (received_s, value), end_s in zip(samples, ends_s, strict=True)
    )
    return sum(stood) / (now_s - begin_s)
