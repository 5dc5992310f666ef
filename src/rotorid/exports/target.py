"""What an export is: files of another tool, and the numbers that these hold beside the identified ones.

A target writes nothing. It answers with the contents of its files and a round trip: its own equations, linearized at
hover, beside what was identified. What a target holds exactly may not differ by more than :data:`EXACT_PERCENT`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding
from rotorid.data.quantity import with_error
from rotorid.errors import ModelError
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from rotorid.flying.vehicle_numbers import VehicleNumber

Fidelity: TypeAlias = Literal["exact", "approximated", "not"]

EXACT_PERCENT = 1.0
"""Beyond this difference of a quantity that a target holds exactly, the export is wrong."""


@dataclass(frozen=True, kw_only=True)
class Compared(Immutable):
    """One quantity of the round trip.

    Parameters
    ----------
    name
        For people, such as ``roll acceleration per output``.
    unit
        Of both values.
    identified
        As it was identified or given.
    exported
        By the target's own equations, linearized at hover.
    held
        Whether the target holds it exactly, as well as its form allows, or not at all.
    size
        What a difference is measured by, where not the identified value: for quantities that may be zero.
    identified_std
        One standard deviation of the identified value; ``None`` where none is stated.

    Examples
    --------
    >>> Compared(name="motor lag", unit="s", identified=0.05, exported=0.0504, held="exact").difference_percent
    0.8
    """

    name: str
    unit: str
    identified: float
    exported: float
    held: Fidelity
    size: float | None = None
    identified_std: float | None = None

    @property
    def difference_percent(self) -> float:
        """Exported over identified in percent, minus 100; infinite where zero became another value."""
        difference, size = self.exported - self.identified, abs(self.size or self.identified)
        if difference == 0.0:
            return 0.0
        away = math.copysign(1.0, self.identified) * difference
        return round(100.0 * away / size, 9) if size > 0.0 else math.copysign(math.inf, away)


@dataclass(frozen=True, kw_only=True)
class KeptDelays(Immutable):
    """What became of the delays of a linear model.

    Parameters
    ----------
    longest_s
        The longest of a response.
    kept
        As ``states``, as a ``lag``, or ``none``.
    pade_order
        Of the approximations; ``None`` where there are none.
    phase_error_deg, up_to_rad_s
        Their largest error, and up to which frequency: the highest crossover, or the end of the band.
    """

    longest_s: float
    kept: Literal["states", "lag", "none"]
    pade_order: int | None = None
    phase_error_deg: float | None = None
    up_to_rad_s: float | None = None


@dataclass(frozen=True, kw_only=True)
class Exported(Immutable):
    """A vehicle in the files of another tool.

    Parameters
    ----------
    target
        Name of the target.
    files
        Relative names to contents, text or bytes.
    compared
        The round trip.
    defaults
        Numbers that were taken from the defaults of the target.
    left_out
        Sentences: what the target does not hold.
    start
        How to start the other tool with the files.
    findings
        Remarks.
    delays
        Of linear models, by their names.

    Raises
    ------
    ModelError
        A quantity that the target keeps exactly is different in its files.
    """

    target: str
    files: Mapping[str, str | bytes]
    compared: tuple[Compared, ...]
    defaults: Mapping[str, VehicleNumber] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()
    start: str = ""
    findings: tuple[Finding, ...] = ()
    delays: Mapping[str, KeptDelays] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(files=self.files, defaults=self.defaults, delays=self.delays)
        for compared in self.compared:
            if compared.held == "exact" and not abs(compared.difference_percent) <= EXACT_PERCENT:
                raise ModelError(
                    f"{compared.name} is {compared.exported:.5g} {compared.unit} in the files for {self.target}, and "
                    "was identified as "
                    f"{compared.identified:.5g}",
                    needed=f"a difference of at most {EXACT_PERCENT:g} %",
                )

    def write(self, folder: str | Path) -> None:
        """Write the files into a folder, which is made when missing; files of the same names are replaced.

        Parameters
        ----------
        folder
            Where they go.
        """
        from rotorid.io.files import write_atomically

        for name, content in self.files.items():
            place = Path(folder) / name
            place.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(place, content)


_WORDS: Mapping[Fidelity, str] = {"exact": "exact", "approximated": "approximated", "not": "lost"}


def table_lines(compared: Sequence[Compared]) -> list[str]:
    """The round trip as lines of plain text, for a comment in a file.

    Parameters
    ----------
    compared
        Rows of the round trip.

    Examples
    --------
    >>> row = Compared(name="motor lag", unit="s", identified=0.05, exported=0.0504, held="exact")
    >>> table_lines([row])[1]
    'motor lag  0.05 s      0.0504 s  +0.80 %     exact'
    """
    rows = [("quantity", "identified", "exported", "difference", "held")]
    for item in compared:
        unit = "" if item.unit in ("", "1") else f" {item.unit}"
        was = identified_text(item.identified, item.identified_std)
        difference = difference_text(item)
        rows.append((item.name, f"{was}{unit}", f"{item.exported:.5g}{unit}", difference, _WORDS[item.held]))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def identified_text(value: float, std: float | None) -> str:
    """A value with its standard deviation, where one is stated.

    Examples
    --------
    >>> identified_text(0.363352, 0.00412), identified_text(0.05, None)
    ('0.363 ± 0.004', '0.05')
    """
    return with_error(value, std, digits=5)


def difference_text(compared: Compared) -> str:
    """The difference of a row in words; where nothing is held there is none."""
    percent = compared.difference_percent
    return "" if compared.held == "not" or not math.isfinite(percent) else percent_text(percent)


def percent_text(percent: float) -> str:
    """A difference in percent with two digits, and a sign where it is more than rounding.

    Examples
    --------
    >>> percent_text(-0.0001), percent_text(1.5)
    ('0.00 %', '+1.50 %')
    """
    return "0.00 %" if abs(percent) < _SHOWN_PERCENT else f"{percent:+.2f} %"


_SHOWN_PERCENT = 0.005
"""A smaller difference is rounding, and is written without a sign."""


URDF_INERTIA: Mapping[str, tuple[int, int]] = MappingProxyType(
    {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
)
"""Attribute of a URDF's inertia to its place in the matrix."""


def number_text(value: float) -> str:
    """A number in a file of XML, with as many digits as single precision keeps."""
    return f"{value:.9g}"


def vector_text(values: Sequence[float] | FloatArray) -> str:
    """Numbers in an attribute of XML; zero has no sign."""
    return " ".join(number_text(float(value) + 0.0) for value in values)


def vector_of(text: str | None) -> FloatArray:
    """The numbers in an attribute of XML."""
    return np.array((text or "").split(), dtype=np.float64)


def xml_comment(head: Sequence[str]) -> list[str]:
    """Lines as a comment of XML; two hyphens would end it too early."""
    return ["<!--", *(f"  {line}".rstrip().replace("--", "- -") for line in head), "-->"] if head else []
