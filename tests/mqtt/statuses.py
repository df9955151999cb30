"""Statuses as the service makes them."""

from __future__ import annotations

import functools

from moar_companion.companion.status import LatestDecisions

from ..companion.watched import Watched, conductor


def status_of(desk):
    latest = LatestDecisions()
    latest.note(desk.decisions, desk.companion.telemetry.link)
    return latest.status_of(desk.companion, desk.now_s, clock_offset_s=1e9, recorder=None)


@functools.cache
def flying():
    """A desk in flight, with a sensor and views; not to be changed."""
    desk = Watched(views=True)
    desk.conductors = (conductor(40.0, 18.0),)
    return desk.fly(1.0)
