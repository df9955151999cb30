"""Outputs of plans and flights: pictures, recordings, pages, views in a terminal."""
