"""Gains from an identified plant: loops as flown, limits in closed form, proposals that hold for every likely plant."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
