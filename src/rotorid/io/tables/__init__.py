"""Tables and arrays of any source, whose channels a mapping names."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
