"""Outputs of plans and flights besides the autopilot: pictures, recordings, messages, pages."""
