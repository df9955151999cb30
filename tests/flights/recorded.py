"""A flight in lockstep as the service records it: a folder with its `.mcap`, and its statuses."""

from __future__ import annotations

import json
from pathlib import Path

from moar_companion.companion.planning.site_maps import SiteMaps
from moar_companion.companion.status import LatestDecisions
from moar_companion.service.recorder import NO_LIMITS, Recorder
from moar_companion.service.recording.calls import START, Call
from moar_companion.service.recording.channels import CycleSampler
from moar_companion.service.recording.flight_log import FlightLog
from tests.flights.lockstep import hovering
from tests.flights.operator import INSPECTION

OFFSET_S = 1_700_000_000.0
"""The wall clock at 0 s of the machine's."""


def recorded_flight(folder: Path, *, cycles: int, hold_from_s: float | None = None):
    """The recording's folder, and its statuses by the wall clock.

    An inspection from hover; hold_from_s: when a hold is ordered, in seconds of the recording.
    """
    flight = hovering(vehicle="x500")
    sampler, latest = CycleSampler(), LatestDecisions()
    started = next(call for call in flight.calls if call.method == START)
    site_maps = SiteMaps(site=flight.flown_site, maps=flight.planner.maps)
    flight.calls[:] = [started, Call(method="take_ground", arguments=(site_maps,))]
    flight.decisions.clear()
    flight.operator.mission(INSPECTION)
    began_s = flight.now_s
    source = FlightLog(OFFSET_S)
    recorder = Recorder(folder, OFFSET_S, began_s, source=source, limits=NO_LIMITS)
    statuses = {}
    for _ in range(cycles):
        if flight.state == "ready" and flight.now_s % 1.0 < 0.02:
            flight.operator.mode("ours")
        if hold_from_s is not None and flight.now_s - began_s > hold_from_s:
            flight.operator.pause()
            hold_from_s = None
        flight.step()
        companion, now_s = flight.companion, flight.now_s
        latest.note(flight.decisions, companion.telemetry.link)
        status = None
        if sampler.status_is_due(now_s):
            status = latest.status_of(companion, now_s, clock_offset_s=OFFSET_S, recorder=None)
            statuses[round(OFFSET_S + now_s, 3)] = json.loads(json.dumps(status))
        calls, flight.calls, flight.decisions = flight.calls, [], []
        recorder.write([], [], sampler.cycle(companion, calls, status, now_s), now_s)
    recorder.close()
    return recorder.folder, statuses
