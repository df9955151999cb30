"""Recorded flights, as regression tests: what the companion decided and sent on recorded inputs.

    python -m tests.recordings compare [NAME ...]      where each parts, with both values
    python -m tests.recordings renew [NAME ...]        after a change on purpose: answers of today
    python -m tests.recordings take FLIGHT.mcap NAME [--seconds N]
    python -m tests.recordings fly STORY ...           stories of tests.traces, in lockstep

The files, in tests/data/recordings, are .mcap with the channel of calls alone: recordings of the
service, beside real and fake autopilots, and of flights in lockstep. `compare` prints what has
changed; who commits new references has read it. `renew` keeps the inputs and makes the answers
anew, with plans of today: the aircraft moves as it did. `fly` flies anew.

As of reference traces (`tests.traces`), which fly the aircraft, too, floating point is the same on
one kind of processor and one version of Python, numpy and numba: `compare` names both.
"""
