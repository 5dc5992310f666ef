"""What may be asked of a verb: options, their defaults, their words on the command line."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
