"""Fits of responses: what they can support, the fit with bounds, and whether a structure holds."""
