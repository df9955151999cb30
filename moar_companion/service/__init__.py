"""The shell of the machine: sockets, threads, files and clocks of a flight."""
