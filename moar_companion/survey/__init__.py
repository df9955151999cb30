"""Surveys to site files, and sites back on a map; without I/O."""
