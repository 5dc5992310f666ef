"""Uncertainty of what was identified."""
