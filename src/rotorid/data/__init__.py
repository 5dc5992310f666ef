"""Value objects: frozen, keyword-only, arrays copied in and read-only."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
