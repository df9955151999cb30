"""One process of `compiling`: kernels, named `module:function`, are compiled into the cache.

It imports no more than these need.
"""

from __future__ import annotations

import gc
import importlib
import sys
from collections.abc import Iterable


def main(names: Iterable[str]) -> None:
    """Compile what is not in the cache yet."""
    gc.disable()  # a tenth of the time, in a process that soon ends
    for name in names:
        module, _, function = name.partition(":")
        _ = getattr(importlib.import_module(module), function).ready


if __name__ == "__main__":
    main(sys.argv[1:])
