"""The commands of `moar-companion`, one module each.

A command has `add_arguments(parser)`, which describes its options, and `run(arguments)`, which
does the work and returns the exit status. Heavy imports (numpy, numba, matplotlib) belong into
`run`, so that `--help` answers at once.
"""
