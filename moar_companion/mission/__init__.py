"""The mission: what the companion is doing, on whose word, and what may be streamed now."""
