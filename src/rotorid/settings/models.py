"""Names of models that a person may ask for."""

from collections.abc import Iterable

ALL = "all"
"""Stands for every model of the library that the logs may support."""


def asks_all(models: object) -> bool:
    """Whether :data:`ALL` stands in place of names, alone or as the only one."""
    return models in (ALL, [ALL], (ALL,))


def models_known() -> Iterable[str]:
    """Models of the library that need no more than their name."""
    from rotorid.models.families import known_names

    return (*known_names(), ALL)
