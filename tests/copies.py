"""Copies of machines that fly: what many flights begin with is flown once."""

from __future__ import annotations

import copy
import copyreg
import functools
import struct

# A codec has compiled formats, which are copied by what they were made of.
copyreg.pickle(struct.Struct, lambda compiled: (struct.Struct, (compiled.format,)))


def copy_of(machine):
    """The same, to be moved on by itself."""
    return copy.deepcopy(machine)


def flown_once(fly):
    """A function that makes a machine: made once for each choice of arguments, and then copied."""
    made = {}

    @functools.wraps(fly)
    def copied(*args, **options):
        key = repr((args, sorted(options.items())))
        if key not in made:
            made[key] = fly(*args, **options)
        return copy_of(made[key])

    return copied
