"""What a log shows: its flights, channels, maneuvers, controllers, and the responses measured on them."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
