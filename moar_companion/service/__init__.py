"""The shell, the only package with sockets, threads, files and clocks."""
