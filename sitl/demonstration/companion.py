"""The companion service on a faster clock: `python -m sitl.demonstration.companion`.

The service's own command line has no such switch: on an aircraft a second is a second.
"""

from __future__ import annotations

import argparse
import sys

from moar_companion.errors import InputError, LinkError
from moar_companion.service.app import run_service
from moar_companion.settings.config import CompanionConfig


def main() -> int:
    """Run the service until it is stopped; the exit status is the service's."""
    parser = argparse.ArgumentParser(prog="companion")
    parser.add_argument("--config", required=True)
    parser.add_argument("--speed", type=float, default=1.0)
    arguments = parser.parse_args()
    try:
        return run_service(CompanionConfig.load(arguments.config), speed=arguments.speed)
    except (InputError, LinkError) as error:
        sys.stderr.write(f"companion: {error}\n")
        return 2 if isinstance(error, InputError) else 1


if __name__ == "__main__":
    sys.exit(main())
