"""What an ordinary flight shows: ``inspect`` and ``review``."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
