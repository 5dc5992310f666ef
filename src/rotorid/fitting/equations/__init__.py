"""Regression of equations of motion on measured motion."""
