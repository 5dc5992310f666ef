"""Delays of one output behind one input."""
