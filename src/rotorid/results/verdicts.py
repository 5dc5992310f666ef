"""One verdict of a fit, as a word, a color and a reason: every page, file and line of a terminal asks here.

A fit follows the data as well as its cost or its percent says (Tischler and Remple's guidelines of 50 and 100 for a
cost, 50 % for outputs in time). Following is not enough: where the structure misses a response, or the solver did not
come to rest, a low cost belongs to values that mean nothing, and the verdict says so. Flights that were not fitted have
verdicts of their own (:mod:`rotorid.verification`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, Protocol, TypeAlias

from rotorid.data.display import listed
from rotorid.data.trust import ACCEPTABLE_COST, EXCELLENT_COST, MEANINGLESS_STRUCTURE_ERROR
from rotorid.results.summary import Color, Cost, Fit, FitVerdict, ParameterEstimate
from rotorid.verification.scores import GOOD_FIT_PERCENT

if TYPE_CHECKING:
    from rotorid.results.model import IdentifiedModel, Refused

Level: TypeAlias = Literal["good", "fair", "poor", ""]

LEVELS: tuple[Level, ...] = ("good", "fair", "poor")
"""From the best to the worst; what is not known has none."""

_COLORS: Mapping[Level, Color] = MappingProxyType({"good": "green", "fair": "yellow", "poor": "red", "": "gray"})
LEVEL_OF: Mapping[Color, Level] = MappingProxyType({color: level for level, color in _COLORS.items()})
"""Level of a color, as pages name it."""

DATA_ONLY = "follows the data only"
"""Of a fit whose structure misses a response: the values make the curve, and are no properties of the vehicle."""

_MOST_NAMED = 3
"""Responses that are named in a reason; more are counted."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """A level for the eye and words for everybody."""

    level: Level
    words: str


NOT_IDENTIFIED = "not identified"
"""Of a parameter whose value is where the search began: the data show only its product with others."""

_UNKNOWN = 100.0
"""Error over value from which a parameter that others compensate for has no value."""


class FindingLike(Protocol):
    """Fields of a finding used by a verdict, for values and documents."""

    @property
    def kind(self) -> str: ...

    @property
    def where(self) -> str: ...

    @property
    def severity(self) -> str: ...

    @property
    def message(self) -> str: ...

    @property
    def numbers(self) -> Mapping[str, float]: ...


def verdict(result: IdentifiedModel | Refused) -> FitVerdict:
    """The verdict of an identification.

    Parameters
    ----------
    result
        A model, or why there is none.
    """
    fit: Fit | None = getattr(result, "fit", None)
    if fit is None:
        return refused_verdict(result.findings)
    return fit_verdict(method=fit.method, cost=fit.cost, fit_percent=fit.fit_percent, findings=result.findings)


def refused_verdict(findings: Iterable[FindingLike]) -> FitVerdict:
    """The verdict where no number was stated: its color is neutral, for nothing is known of a model."""
    reason = next((finding.message for finding in findings if finding.severity == "error"), "Not enough data.")
    return FitVerdict(word="no model", color="gray", reason=reason)


def fit_verdict(
    *,
    method: str,
    cost: Cost | None,
    fit_percent: Mapping[str, float] | None,
    findings: Iterable[FindingLike],
) -> FitVerdict:
    """The verdict of a fit by its numbers and its findings.

    The worst output counts for a fit in time, the average cost for one in the frequency domain. A structure that
    misses a response, and a solver that did not come to rest, leave no more than a yellow verdict.

    Parameters
    ----------
    method
        How it was fitted.
    cost
        In the frequency domain.
    fit_percent
        Output to the share of its motion that is explained.
    findings
        Of the result.

    Examples
    --------
    >>> from rotorid.data.findings import warn
    >>> from rotorid.results.summary import Cost
    >>> cost = Cost(average=7.3, pairs={})
    >>> fit_verdict(method="frequency", cost=cost, fit_percent=None, findings=()).color
    'green'
    >>> missed = warn("structure_error", "p/roll_command", "It misses.", model_error_percent=18.0)
    >>> found = fit_verdict(method="frequency", cost=cost, fit_percent=None, findings=[missed])
    >>> found.word, found.color
    ('follows the data only', 'yellow')
    """
    findings = [finding for finding in findings if finding.severity != "info"]
    of_fit, number, reason = _measure(method, cost, fit_percent)
    doubts = list(_doubts(findings))
    if not doubts:
        return FitVerdict(word=of_fit.words, color=_COLORS[of_fit.level], reason=f"{reason}.", number=number)
    word = doubts[0][0] if of_fit.level in ("good", "fair", "") else of_fit.words
    level: Level = "fair" if of_fit.level in ("good", "fair", "") else of_fit.level
    clauses = "; ".join(clause for _, clause in doubts)
    joined = f"{reason}, but {clauses}." if reason else f"{clauses[:1].upper()}{clauses[1:]}."
    return FitVerdict(word=word, color=_COLORS[level], reason=joined, number=number)


def _measure(method: str, cost: Cost | None, fit_percent: Mapping[str, float] | None) -> tuple[Verdict, str, str]:
    """Fit to the data: verdict, number and explanation."""
    if fit_percent and (method != "frequency" or cost is None):
        name = min(fit_percent, key=lambda name: fit_percent[name])
        percent = fit_percent[name]
        level = percent_level(percent)
        words = {"good": "good", "fair": "weak", "poor": "poor"}[level]
        worst = "" if len(fit_percent) == 1 else ", its worst output"
        reason = f"The model explains {percent:.1f} % of {name}{worst} ({GOOD_FIT_PERCENT:g} % and more is good)"
        return Verdict(level, words), f"{percent:.1f} %", reason
    if cost is not None:
        found = cost_verdict(cost.average)
        words = {"good": "good", "fair": "acceptable", "poor": "poor"}[found.level]
        several = "average cost" if len(cost.pairs) > 1 else "cost"
        guide = f"up to {EXCELLENT_COST:g} is good, up to {ACCEPTABLE_COST:g} acceptable"
        return Verdict(found.level, words), f"cost {cost.average:.3g}", f"The {several} is {cost.average:.3g} ({guide})"
    if fit_percent is not None and method == "equation_error":
        return Verdict("", "not judged"), "", "The outputs barely moved, so a percentage would only judge their noise"
    return Verdict("", "not judged"), "", "The fit has neither a cost nor a percentage"


def _doubts(findings: Iterable[FindingLike]) -> Iterator[tuple[str, str]]:
    """Reasons to doubt a low cost, the most serious first: a word, and a clause to follow "but"."""
    by_kind: dict[str, list[FindingLike]] = {}
    for finding in findings:
        by_kind.setdefault(finding.kind, []).append(finding)
    if "not_converged" in by_kind:
        yield "not settled", "the solver did not converge"
    if "impossible_physics" in by_kind:
        yield "not physical", f"no vehicle can have such values ({_named(by_kind['impossible_physics'])})"
    missed = by_kind.get("structure_error", [])
    sized = [finding for finding in missed if "model_error_percent" in finding.numbers]
    uncertain = [finding for finding in sized if "log_likelihood" in finding.numbers]
    sized = [finding for finding in sized if finding not in uncertain]
    if meaningless := [
        one for one in sized if one.numbers["model_error_percent"] > 100.0 * MEANINGLESS_STRUCTURE_ERROR
    ]:
        most = max(finding.numbers["model_error_percent"] for finding in meaningless)
        of_several = " at most" if len(meaningless) > 1 else ""
        yield (
            DATA_ONLY,
            f"the model misses {_named(meaningless)} by {most:.0f} %{of_several}: its values follow the data but "
            "have no physical meaning",
        )
    if smaller := [one for one in sized if one not in meaningless]:
        most = max(finding.numbers["model_error_percent"] for finding in smaller)
        yield "partly valid", f"the model misses {_named(smaller)} by {most:.1f} %: it lacks dynamics"
    if uncertain:
        most = max(finding.numbers["model_error_percent"] for finding in uncertain)
        yield "partly valid", f"the model may miss {_named(uncertain)} by {most:.0f} %, which the data cannot decide"
    if others := [finding for finding in missed if "model_error_percent" not in finding.numbers]:
        yield "partly valid", f"the model does not describe {_named(others)}"


def _named(findings: Iterable[FindingLike]) -> str:
    places = list(dict.fromkeys(finding.where for finding in findings))
    more = len(places) - _MOST_NAMED
    return listed(places) if more <= 0 else f"{', '.join(places[:_MOST_NAMED])} and {more} more"


def badge(found: FitVerdict) -> Verdict:
    """A verdict of a fit with its number, as pages show it.

    Examples
    --------
    >>> badge(FitVerdict(word="good", color="green", reason="", number="cost 0.2"))
    Verdict(level='good', words='good, cost 0.2')
    """
    return Verdict(LEVEL_OF[found.color], ", ".join(part for part in (found.word, found.number) if part))


def cost_verdict(cost: float) -> Verdict:
    """Verdict on one frequency-domain cost, by Tischler and Remple's guidelines of 50 and 100."""
    if cost <= EXCELLENT_COST:
        return Verdict("good", "practically indistinguishable from the flight")
    if cost <= ACCEPTABLE_COST:
        return Verdict("fair", "acceptable")
    return Verdict("poor", "the model misses the measurement")


def response_verdict(pair: str, cost: float, findings: Iterable[FindingLike]) -> Verdict:
    """Verdict on one fitted response: its cost, unless a finding says that the model misses it.

    Examples
    --------
    >>> from rotorid.data.findings import warn
    >>> missed = warn("structure_error", "p/roll_command", "It misses.", model_error_percent=18.0)
    >>> response_verdict("p/roll_command", 7.3, [missed])
    Verdict(level='fair', words='the model misses it by 18 %')
    """
    by_cost = cost_verdict(cost)
    for finding in findings:
        # A note says only that the data cannot judge the structure.
        missed = finding.kind == "structure_error" and finding.severity != "info"
        if missed and finding.where == pair and by_cost.level != "poor":
            percent = finding.numbers.get("model_error_percent")
            misses = "may miss" if "log_likelihood" in finding.numbers else "misses"
            return Verdict("fair", f"the model {misses} it{'' if percent is None else f' by {percent:.2g} %'}")
    return by_cost


def percent_level(percent: float) -> Level:
    """Level of how much of an output is explained: 50 % and more are good, below 0 % the mean would do better.

    Examples
    --------
    >>> percent_level(83.2), percent_level(31.0), percent_level(-4.0)
    ('good', 'fair', 'poor')
    """
    return "good" if percent >= GOOD_FIT_PERCENT else "fair" if percent > 0.0 else "poor"


def has_value(name: str, found: ParameterEstimate, findings: Iterable[FindingLike]) -> bool:
    """Whether a value of a parameter means anything; not where others compensate for any change of it.

    Parameters
    ----------
    name, found
        The parameter.
    findings
        Of the fit; the one on parameters that cannot be separated counts.

    Examples
    --------
    >>> from rotorid.data.findings import warn
    >>> said = [warn("not_identifiable", "J_x, K_f", "The data show only K_f/J_x = 2.")]
    >>> has_value("J_x", ParameterEstimate(value=0.1, std=4000.0, unit="kg m^2", status="free"), said)
    False
    """
    if found.std is None or found.std <= _UNKNOWN * abs(found.value):
        return True
    return not any(each.kind == "not_identifiable" and name in each.where.split(", ") for each in findings)


_FITTED_FIRST = ("speed_damping_first", "speed_damping_biased")


def error_of(name: str, found: ParameterEstimate, findings: Iterable[FindingLike]) -> float | None:
    """Standard deviation of a parameter; of a speed damping that was fitted first and then fixed, that of its fit.

    Examples
    --------
    >>> from rotorid.data.findings import remark
    >>> fixed = ParameterEstimate(value=-0.23, std=None, unit="1/s", status="fixed")
    >>> error_of("X_u", fixed, [remark("speed_damping_first", "X_u", "X_u = -0.23 was fitted first.", std=0.04)])
    0.04
    """
    if found.std is not None or found.status != "fixed":
        return found.std
    first = (each.numbers for each in findings if each.kind in _FITTED_FIRST and each.where == name)
    return next((numbers["std"] for numbers in first if "std" in numbers), None)
