"""`python -m sitl`."""

import sys

from sitl.shell import main

sys.exit(main())
