"""Conditioning of signals: one clock, excitations."""
