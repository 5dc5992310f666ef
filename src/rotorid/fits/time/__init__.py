"""Fits of time histories."""
