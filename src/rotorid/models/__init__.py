"""Structures and their parameters."""
