"""How the fit went, in words and as a small curve."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rotorid.pipeline.document import FitDocument
from rotorid.report.numbers import significant

_WEIGHTS = {
    "cifer": "Errors were weighed as CIFER does, by coherence alone.",
    "covariance": (
        "Errors were weighed by their measured covariance, over frequencies and outputs together, after a fit with "
        "CIFER's weights."
    ),
}
_WIDTH, _HEIGHT, _MARGIN = 120.0, 26.0, 3.0


def fit_sentences(fit: FitDocument) -> tuple[str, ...]:
    """What was weighed how, how the solver ended, and what its residuals say about the standard deviations."""
    outcome = fit.outcome.rstrip(".")
    count = "1 evaluation" if fit.evaluations == 1 else f"{fit.evaluations} evaluations"
    sentences = [_WEIGHTS[fit.weights], f"The solver ended after {count}: {outcome[:1].lower()}{outcome[1:]}."]
    if len(fit.trace) > 1:
        steps = "1 step" if len(fit.trace) == 2 else f"{len(fit.trace) - 1} steps"
        first, last = significant(fit.trace[0]), significant(fit.trace[-1])
        sentences.append(f"In {steps} the cost of all responses together went from {first} to {last}.")
    if fit.inflation > 1.0:
        sentences.append(
            f"Residuals are {significant(fit.inflation, digits=2)} times as large as the errors of the data explain; "
            "standard deviations were raised by that factor."
        )
    return tuple(sentences)


def sparkline(trace: Sequence[float]) -> str:
    """Corners of a small curve of the cost on a logarithmic scale, as an SVG polyline of 120 by 26 takes them.

    Empty where there is nothing to draw: fewer than three positive costs.

    Examples
    --------
    >>> sparkline([100.0, 10.0, 1.0])
    '3.0,3.0 60.0,13.0 117.0,23.0'
    """
    levels = [math.log(cost) for cost in trace if math.isfinite(cost) and cost > 0.0]
    if len(levels) < 3:
        return ""
    low, high = min(levels), max(levels)
    across = (_WIDTH - 2.0 * _MARGIN) / (len(levels) - 1)
    down = (_HEIGHT - 2.0 * _MARGIN) / (high - low) if high > low else 0.0
    corners = [(_MARGIN + across * at, _MARGIN + down * (high - level)) for at, level in enumerate(levels)]
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
