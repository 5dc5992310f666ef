"""Time responses: a linear model on given inputs, and a hover flight in closed loop."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
