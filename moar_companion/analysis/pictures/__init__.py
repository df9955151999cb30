"""Pictures of plans, flights, recordings and surveys (matplotlib, an extra)."""
