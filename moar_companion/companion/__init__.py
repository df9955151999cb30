"""The companion: one machine without I/O. A cycle from inputs to effects."""
