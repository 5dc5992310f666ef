"""The sentences of a reduction: why a parameter was dropped, kept or protected."""

from __future__ import annotations

import math
from collections.abc import Iterable

from rotorid.reduce.elimination import LARGEST_RISE
from rotorid.reduce.evidence import Evidence
from rotorid.uncertainty.bounds import CRAMER_RAO_GUIDELINE_PERCENT, INSENSITIVITY_GUIDELINE_PERCENT

SIGNIFICANT_STDS = 3.0
"""A value further from zero, or a parameter moved further, is no chance."""


def dropped_because(
    suspect: Evidence, before: Iterable[Evidence], after: Iterable[Evidence], cost_before: float, cost_after: float
) -> tuple[str, bool]:
    """Why a parameter was dropped, and whether the drop moved another one by more than chance.

    Parameters
    ----------
    suspect
        The dropped parameter.
    before, after
        Evidence on the free parameters with and without it.
    cost_before, cost_after
        Mean costs with and without it.
    """
    sentences = [f"{_case(suspect)}.", f"Without it the mean cost goes from {cost_before:.2f} to {cost_after:.2f}, "]
    sentences[-1] += "so it was dropped."
    distance = _stds(suspect.value, suspect.std)
    if distance > SIGNIFICANT_STDS:
        sentences.append(
            f"It lies {distance:.1f} of its standard deviations from zero all the same: by these data it is real, "
            "though it hardly matters to the cost."
        )
    moves = _moves(before, after)
    doubtful = bool(moves) and moves[0][0] > SIGNIFICANT_STDS
    if doubtful:
        distance, old, new = moves[0]
        sentences.append(
            f"Caution: {old.name} moved by {distance:.1f} of its standard deviations to take its place, from "
            f"{old.value:.4g} to {new.value:.4g} {old.unit}."
        )
    return " ".join(sentences), doubtful


def kept_because_of_cost(suspect: Evidence, cost_before: float, cost_after: float) -> str:
    """Why a parameter was kept without which the cost rises."""
    return (
        f"{_case(suspect)}. It is kept, because without it the mean cost rises from {cost_before:.2f} to "
        f"{cost_after:.2f}, by more than {LARGEST_RISE:g}."
    )


def kept_because_certain(suspect: Evidence, distance: float) -> str:
    """Why a parameter was kept that the cost would not miss."""
    return (
        f"{_case(suspect)}. It is kept, because it lies {distance:.0f} standard deviations from zero where errors are "
        "weighed by their covariance: it is there, and dropping it would bias the others."
    )


def kept_because_of_obstacle(suspect: Evidence, obstacle: str) -> str:
    """Why a parameter was kept without which there is no model."""
    return f"{_case(suspect)}. It is kept, because {obstacle}; {_remedy(suspect)}."


def protected_because(suspect: Evidence) -> str:
    """Why a parameter that the data hardly show is not dropped."""
    return f"{_case(suspect)}. It is kept, because it is essential physics of this model; {_remedy(suspect)}."


def _remedy(suspect: Evidence) -> str:
    if suspect.insensitive or suspect.partner is None:
        return "give its value if it is known, or excite what shows it"
    return f"give its value or that of {suspect.partner} if one is known, or excite what tells them apart"


def _case(suspect: Evidence) -> str:
    """What speaks against a parameter, as the beginning of a sentence."""
    name, value = suspect.name, f"{suspect.value:.4g} {suspect.unit}".removesuffix(" 1")
    if math.isinf(suspect.std):
        return f"{name} changes nothing in the fitted responses"
    if suspect.value == 0.0:
        return f"The best value of {name} is zero"
    if suspect.insensitive:
        return (
            f"The cost hardly depends on {name}: its insensitivity is {_percent(suspect.insensitivity_percent)} of the "
            f"value {value} (guideline {INSENSITIVITY_GUIDELINE_PERCENT:g} %)"
        )
    uncertain = (
        f"its Cramér–Rao bound is {_percent(suspect.cramer_rao_percent)} of the value {value} (guideline "
        f"{CRAMER_RAO_GUIDELINE_PERCENT:g} %)"
    )
    if suspect.partner is None:
        return f"{name} is uncertain: {uncertain}"
    return (
        f"{name} is seen, but not apart from {suspect.partner}, with which it is correlated most: {uncertain}, its "
        f"insensitivity only {_percent(suspect.insensitivity_percent)}"
    )


def _percent(number: float) -> str:
    if number >= 1000.0:
        return "more than 1000 %"
    return f"{number:.0f} %" if number >= 100.0 else f"{number:.1f} %"


def _moves(before: Iterable[Evidence], after: Iterable[Evidence]) -> list[tuple[float, Evidence, Evidence]]:
    """How far each parameter moved, in its standard deviations before, furthest first."""
    old = {item.name: item for item in before}
    pairs = [(old[item.name], item) for item in after if item.name in old]
    moves = [(_stds(new.value - was.value, was.std), was, new) for was, new in pairs]
    return sorted(moves, key=lambda move: -move[0])


def _stds(change: float, std: float) -> float:
    """Change in standard deviations; zero where none is known."""
    return abs(change) / std if 0.0 < std < math.inf else 0.0
