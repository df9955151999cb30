"""Texts for pilots and for the service's operators, and how values appear in them."""
