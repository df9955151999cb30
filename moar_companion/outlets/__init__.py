"""Where plans and flights go besides the autopilot: pictures, recordings, messages, pages."""
