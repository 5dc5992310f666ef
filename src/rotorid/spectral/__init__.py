"""Frequency responses from data."""
