"""The mission: its state, the orders behind it, and what may be streamed now."""
