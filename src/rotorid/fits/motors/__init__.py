"""Fits of motors, propellers and inertia."""
