"""Findings: what a careful engineer would remark on, with the numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from rotorid.data.immutable import Immutable

Severity: TypeAlias = Literal["info", "warning", "error"]


@dataclass(frozen=True, kw_only=True)
class Finding(Immutable):
    """One remark about data, a response, a model or a check.

    Parameters
    ----------
    kind
        A snake_case word that scripts may rely on: ``no_excitation``, ``low_coherence``, ``uncertain_parameter``, ...
    severity
        ``info`` explains, ``warning`` limits the trust, ``error`` says that there is no answer.
    where
        What the remark is about: a channel, a topic, a response ``y/u``, a parameter.
    message
        One sentence for a person.
    numbers
        The same for a program; the unit is in the name.
    """

    kind: str
    severity: Severity
    where: str
    message: str
    numbers: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(numbers={name: float(value) for name, value in self.numbers.items()})
