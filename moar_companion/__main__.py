"""`python -m moar_companion`: the command line."""

import sys

from .cli import main

sys.exit(main())
