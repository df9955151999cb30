"""Command line of `tests.fuzz`."""

from __future__ import annotations

import argparse
import sys

from . import __doc__ as usage

COUNTS = {"bytes": 10**7, "messages": 2 * 10**6, "services": 10**6, "coverage": 900}


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="tests.fuzz", description=usage, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=COUNTS)
    parser.add_argument("count", nargs="?", type=int)
    parser.add_argument("--lives", default="0:8", help="seeds; the count is shared among all eight")
    options = parser.parse_args()
    count = options.count or COUNTS[options.what]
    if options.what == "coverage":
        from . import coverage

        return coverage.run(count)
    if options.what == "services":
        from . import services

        served = services.run(count)
        sys.stdout.write(str(served))
        return int(bool(served.found))
    from . import flights

    first, end = map(int, options.lives.split(":"))
    report = flights.run(options.what, count // 8, range(first, end))
    sys.stdout.write(str(report))
    return int(bool(report.found))


if __name__ == "__main__":
    sys.exit(main())
