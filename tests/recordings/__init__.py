"""Recorded flights as regression tests: decisions and packets of the companion on recorded inputs.

    python -m tests.recordings compare [NAME ...]      first difference of each, with both values
    python -m tests.recordings renew [NAME ...]        after an intended change: new answers
    python -m tests.recordings take FLIGHT.mcap NAME [--seconds N]
    python -m tests.recordings fly STORY ...           stories of tests.traces, in lockstep

The files, in tests/data/recordings, are .mcap with the channel of calls alone: recordings of the
service, beside real and fake autopilots, and of flights in lockstep. `compare` prints the changes;
read them before you commit new references. `renew` keeps the inputs and computes new answers and
plans: the aircraft moves as before. `fly` flies again.

Floating-point results are the same only on one kind of processor with one version of Python, numpy
and numba: `compare` names both. The same holds for reference traces (`tests.traces`), which also
fly the aircraft.
"""
