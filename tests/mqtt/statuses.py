"""Statuses as the service makes them."""

from __future__ import annotations

import functools

from moar_companion.companion.status import LatestDecisions

from ..companion.desk import Desk


def status_of(desk):
    latest = LatestDecisions()
    latest.note(desk.decisions, desk.companion.telemetry.link)
    return latest.status_of(desk.companion, desk.now_s, clock_offset_s=1e9, recorder=None)


@functools.cache
def flying():
    """A desk in flight; not to be changed."""
    return Desk().come_to("flying", then_s=1.0)
