"""Content of a flight's .mcap: exact calls of the machine, and channels for viewers. No I/O."""
