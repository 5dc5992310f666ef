"""What a planned flight will be able to tell, before it is flown."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
