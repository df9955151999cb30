"""Content of a flight's .mcap: the machine's calls, exact, and channels for people. No I/O."""
