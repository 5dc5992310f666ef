"""Controllers of autopilots as their parameters describe them: which names, which units, which order of blocks."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
