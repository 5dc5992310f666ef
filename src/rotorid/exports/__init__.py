"""An identified multirotor in the terms of other tools' vehicles."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
