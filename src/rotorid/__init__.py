"""System identification for multirotors: flight log in, identified model out."""

from __future__ import annotations

__version__ = "0.1.0"
