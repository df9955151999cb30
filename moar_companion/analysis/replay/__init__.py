"""Pure: recordings, decoded and assessed as in flight."""
