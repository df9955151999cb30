"""The command line: one module for each subcommand, and what some of them share.

In: arguments and files. Out: text, files, pictures, and an exit status; 2 with one line for a
wrong file or option. Read first: `cli` (the subcommands), `service` (the default, which flies),
`options`.

A subcommand has `add_arguments(parser)`, which describes its options, and `run(arguments)`, which
does the work and returns the exit status. Heavy imports (numpy, numba, matplotlib) belong into
`run`, so that `--help` answers at once.
"""
