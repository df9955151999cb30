"""Surveys to site files, and sites to map features; without I/O."""
