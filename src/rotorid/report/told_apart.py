"""Which parameters the data hardly tell apart: correlations in words and as a picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.pipeline.document import CorrelationDocument
from rotorid.plot.correlation import correlation_map
from rotorid.report.picture import Picture

HIGH = 0.9
_LEAST_DRAWN = 5
_MOST_TOLD = 8


@dataclass(frozen=True, kw_only=True, slots=True)
class Together:
    """Two parameters and how their estimates go together."""

    first: str
    second: str
    correlation: float

    @property
    def words(self) -> str:
        """The pair in words."""
        return f"{self.first} and {self.second}: {self.correlation:.2f}".replace("-", "−")


def correlation_sentence(correlation: CorrelationDocument | None) -> str:
    """Pairs of parameters that are correlated by more than 0.9, or else the highest correlation of all.

    Examples
    --------
    >>> correlation_sentence(CorrelationDocument(names=["M_q", "M_u"], matrix=[[1.0, -0.93], [-0.93, 1.0]]))
    'Correlated by more than 0.9, so that an error of one is an error of the other: M_q and M_u: −0.93.'
    """
    pairs = _pairs(correlation) if correlation else []
    if not pairs:
        return ""
    high = [pair for pair in pairs if abs(pair.correlation) > HIGH]
    if not high:
        return f"No two parameters are correlated by more than {HIGH:g}; the highest is {pairs[0].words}."
    told = "; ".join(pair.words for pair in high[:_MOST_TOLD])
    more = f"; and {len(high) - _MOST_TOLD} more" if len(high) > _MOST_TOLD else ""
    return f"Correlated by more than {HIGH:g}, so that an error of one is an error of the other: {told}{more}."


def correlation_picture(correlation: CorrelationDocument | None, *, key: str) -> Picture | None:
    """The map of correlations; none of up to four parameters, for which words do."""
    if correlation is None or len(correlation.names) < _LEAST_DRAWN:
        return None
    return Picture(
        key=key,
        description="Correlation of every two parameters as a map",
        figure=correlation_map(correlation.names, np.array(correlation.matrix, dtype=np.float64)),
    )


def _pairs(correlation: CorrelationDocument) -> list[Together]:
    """Every two parameters, the strongest first; a correlation that is no number is left out."""
    names = correlation.names
    pairs = [
        Together(first=names[column], second=name, correlation=row[column])
        for number, (name, row) in enumerate(zip(names, correlation.matrix, strict=True))
        for column in range(number)
        if np.isfinite(row[column])
    ]
    return sorted(pairs, key=lambda pair: -abs(pair.correlation))
