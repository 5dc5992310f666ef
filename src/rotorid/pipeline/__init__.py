"""Deprecated: these names are in the packages that ``__init__.pyi`` gives."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__, removed_in="0.3")
