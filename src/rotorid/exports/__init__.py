"""An identified multirotor as a vehicle of other tools: their files as text, and what these hold of the vehicle."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
