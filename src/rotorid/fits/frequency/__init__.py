"""Fits of frequency responses."""
