"""What a verb answers: an identified model with its uncertainty, its verdict and its history."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
