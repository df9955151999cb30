"""What a flight's .mcap has: the machine's calls, exact, and channels for people. No I/O."""
