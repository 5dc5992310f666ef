"""Models out of logs: how each method prepares, fits and checks, and the verbs that ask it."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
