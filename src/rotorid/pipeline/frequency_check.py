"""What unseen sweeps say about a model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rotorid.data.findings import Finding
from rotorid.data.response import FrequencyResponse
from rotorid.typing import BoolArray, ComplexArray


@dataclass(frozen=True, kw_only=True, slots=True)
class PairCheck:
    """One response of unseen sweeps.

    Parameters
    ----------
    cost
        CIFER's cost of the model against it.
    band_rad_s
        Lowest and highest frequency that counted.
    points
        How many counted.
    """

    cost: float
    band_rad_s: tuple[float, float]
    points: int


@dataclass(frozen=True, kw_only=True, eq=False)
class FrequencyCheck:
    """What unseen sweeps say about a model.

    Parameters
    ----------
    pairs
        Each response that has usable points, by ``output/input``.
    findings
        Remarks on the sweeps and on the costs.
    records
        Names of the logs.
    response
        The measured responses, or ``None`` where there are none.
    model_response
        The model on the same grid, shape ``(y, u, f)``.
    used
        Points that counted, shape ``(y, u, f)``.
    """

    pairs: Mapping[str, PairCheck] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    records: tuple[str, ...] = ()
    response: FrequencyResponse | None = None
    model_response: ComplexArray | None = None
    used: BoolArray | None = None

    @property
    def costs(self) -> dict[str, float]:
        """Cost of each response that has usable points, by ``output/input``."""
        return {name: pair.cost for name, pair in self.pairs.items()}
