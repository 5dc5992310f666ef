"""Fits of the physics of flight to logs: numbers with their errors, refusals and remarks."""
