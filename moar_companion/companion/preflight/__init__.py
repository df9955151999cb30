"""Preflight checks: findings on the files and the aircraft, and how to fix them."""
