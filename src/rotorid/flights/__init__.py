"""Analysis of a log: its flights, channels, maneuvers and controllers, and the responses measured from them."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
