"""The service with a record of the position that each cycle uses: `served.py CONFIG AGES`.

For `starved`. It is run as a file, so that it serves the checkout that is first on the path. A line
of AGES is a cycle: its start, and the autopilot's time of the position (milliseconds).
"""

from __future__ import annotations

import sys
from pathlib import Path

from moar_companion.service.app import run_service
from moar_companion.settings.config import CompanionConfig

try:
    from moar_companion.companion.companion import Companion
except ImportError:  # checkouts before that package
    from moar_companion.service.companion import Companion


def main() -> None:
    tick = Companion.tick
    with Path(sys.argv[2]).open("w", buffering=1 << 16) as ages:

        def noting(self: Companion, now_s: float) -> None:
            tick(self, now_s)
            position = self.telemetry.local_position
            if position is not None:
                ages.write(f"{now_s!r} {round(1e3 * position.boot_s)}\n")

        Companion.tick = noting  # type: ignore[method-assign]
        run_service(CompanionConfig.load(sys.argv[1]))


if __name__ == "__main__":
    main()
