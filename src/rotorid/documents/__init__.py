"""What the JSON files hold, and their schemas; models that were saved are loaded here."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
