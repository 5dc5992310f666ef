"""Results of the verbs: an identified model with its uncertainty, verdict and history."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
