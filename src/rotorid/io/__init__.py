"""Readers and writers: the only access to files of data."""

from rotorid.io.registry import read

__all__ = ["read"]
