"""Reference traces: packets and decisions of the companion in many flights in lockstep.

    python -m tests.traces make|compare [--only PATTERN] [--workers N] [--renamed OLD=NEW,...]
                                        [--exact]

`make` flies all flights and stores a trace of each in tests/data/traces; `compare` flies them again
and prints, for each channel, the first difference of a flight from its trace: the time, the old
value and the new one. Exit status of `compare`: 1 when anything differs. Channels:

- setpoints: SET_POSITION_TARGET_LOCAL_NED packets with their times;
- packets: all other packets of the companion but STATUSTEXT;
- decisions: the records of decisions without their free texts;
- texts: STATUSTEXT packets, and the free texts of decisions.

A channel has a digest of everything in it, one of each second, and lines with rounded numbers: of
the last setpoint of each second, of commands, decisions (but `status`) and texts. Packets are taken
without sequence number, checksum and signature: one text more changes no setpoint.

--exact: each flight is also replayed exactly (`replay.exact`); the first difference is printed.

--renamed: words of decisions and texts that have changed on purpose. NEW as a whole word counts as
OLD.

Digests are exact on one processor, with one version of Python, numpy and numba; each trace names
them. On another one numbers may differ by less than the lines are rounded to: `compare` says so.
"""
