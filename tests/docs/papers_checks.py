"""How a line of ``docs/papers.md`` is proved: numbers against the truth of a twin or against print, and facts.

A number is compared with the truth of the vehicle that flew, as its simulator states it, or where no truth exists
with what the paper prints. Its own interval decides, three standard deviations wide, unless a tolerance is given; a
tolerance states where it comes from: the digits of the print, the paper's own error, or the rule that is checked. Among
hundreds of intervals some miss by chance: a single number may be three deviations off, and of all a tenth two.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

from tests.docs.papers_page import Runs

from rotorid.data.quantity import with_error

WIDE, USUAL = 3.0, 1.96
"""Standard deviations that a single number, and nine of ten, may be off."""


class Estimate(NamedTuple):
    """A number with its standard deviation, and with its range where that is not symmetric."""

    value: float
    std: float | None = None


Get: TypeAlias = "Callable[[Runs], Estimate | float] | float"


@dataclass(frozen=True)
class Number:
    """A number of a run: against truth, else print, by its own interval or within a tolerance.

    Parameters
    ----------
    what
        Name and unit.
    ours, truth, paper
        The number, what the simulator says, what is printed.
    within, because
        Tolerance about the truth, else the print, and where it comes from.
    most, least
        Bounds of a rule, in place of a comparison.
    """

    what: str
    ours: Get
    truth: Get | None = None
    paper: float | None = None
    within: float | None = None
    most: float | None = None
    least: float | None = None
    because: str = ""

    def row(self, runs: Runs) -> Row:
        ours, truth = _found(self.ours, runs), None if self.truth is None else _found(self.truth, runs).value
        reference = self.paper if truth is None else truth
        off: float | None = None
        if self.most is not None or self.least is not None:
            low = -float("inf") if self.least is None else self.least
            holds = low <= ours.value <= (float("inf") if self.most is None else self.most)
        elif self.within is not None:
            assert reference is not None, f"{self.what} has nothing to be compared with"
            holds = abs(ours.value - reference) <= self.within
        else:
            assert reference is not None, f"{self.what} has nothing to be compared with"
            assert ours.std is not None, f"{self.what} has neither an interval nor a tolerance"
            off = abs(ours.value - reference) / ours.std
            holds = off <= WIDE
        return Row(self.what, self.paper, truth, ours, self._rule(), bool(holds), off)

    def _rule(self) -> str:
        if self.most is not None or self.least is not None:
            bounds = [
                f"≥ {self.least:g}" if self.least is not None else "",
                f"≤ {self.most:g}" if self.most is not None else "",
            ]
            return " ".join(filter(None, bounds))
        return "interval" if self.within is None else f"± {self.within:.2g}"


@dataclass(frozen=True)
class Fact:
    """What a run must show that is no number: content of a figure, a printed equation, a kind of finding."""

    what: str
    holds: Callable[[Runs], object]


class Row(NamedTuple):
    """A number that was compared."""

    what: str
    paper: float | None
    truth: float | None
    ours: Estimate
    rule: str
    holds: bool
    off: float | None

    @property
    def said(self) -> str:
        return f"{self.what}: ours {shown(self.ours)}, truth {self.truth}, paper {self.paper}, rule {self.rule}"


class Line:
    """An item of the page and what proves it.

    Parameters
    ----------
    run
        Folder or short command, as on the page.
    item
        How the text of the item begins.
    checks
        Numbers and facts.
    pending
        Why it does not hold yet; then it must not.
    """

    def __init__(self, run: str, item: str, *checks: Number | Fact, pending: str = "") -> None:
        assert checks, f"{run}: {item} has no check"
        self.run, self.item, self.checks, self.pending = run, item, checks, pending

    @property
    def numbers(self) -> Sequence[Number]:
        return [one for one in self.checks if isinstance(one, Number)]

    def rows(self, runs: Runs) -> list[Row]:
        return [one.row(runs) for one in self.numbers]

    def prove(self, runs: Runs) -> None:
        """Assert all of it."""
        wrong = [row.said for row in self.rows(runs) if not row.holds]
        wrong += [one.what for one in self.checks if isinstance(one, Fact) and not one.holds(runs)]
        assert wrong == [], wrong


def _found(get: Get, runs: Runs) -> Estimate:
    found = get(runs) if callable(get) else get
    return found if isinstance(found, Estimate) else Estimate(float(found))


def shown(estimate: Estimate) -> str:
    return f"{estimate.value:.4g}" if estimate.std is None else with_error(estimate.value, estimate.std)


def of(found: Callable[..., Any], *given: Any) -> Callable[[Runs], Any]:
    """A function of runs and more, with what is given."""
    return lambda runs: found(runs, *given)


def parameter(run: str, name: str) -> Callable[[Runs], Estimate]:
    """A parameter of a result with its standard deviation."""

    def found(runs: Runs) -> Estimate:
        one = runs[run].document["parameters"][name]
        return Estimate(one["value"], one["std"])

    return found


def truth(run: str, name: str) -> Callable[[Runs], float]:
    """What a simulation says about the vehicle that flew."""
    return lambda runs: float(runs[run].json("simulation.json")["truth"][name]["value"])


def field(run: str, *path: Any) -> Callable[[Runs], Any]:
    """A field of the document of a run."""

    def found(runs: Runs) -> Any:
        value = runs[run].document
        for step in path:
            value = value[step]
        return value

    return found


def has_kind(run: str, kind: str) -> Fact:
    """A kind of finding that a run must report."""
    return Fact(f"{run} reports {kind}", lambda runs: kind in runs[run].kinds)


def no_kind(run: str, *kinds: str) -> Fact:
    """Kinds of findings that a run must not report."""
    return Fact(f"{run} does not report {', '.join(kinds)}", lambda runs: not set(kinds) & set(runs[run].kinds))


def printed(command: str, *words: str) -> Fact:
    """Text that a command must print."""
    return Fact(
        f"{command} prints {words}",
        lambda runs: all(" ".join(word.split()) in " ".join(runs[command].printed.split()) for word in words),
    )


def drawn(run: str, figure: str, *labels: str, panels: int = 1, curves: int = 1, bands: int = 0) -> Fact:
    """A figure that must have so many panels, curves and bands, and these words in its labels."""

    def holds(runs: Runs) -> bool:
        axes = runs[run].figure(figure)
        lines = [line for axis in axes for line in axis["lines"] if line["points"] > 1]
        words = [str(axis[key]) for axis in axes for key in ("x", "y", "title")]
        words += [line["label"] for line in lines] + [
            text for axis in axes for text in (*axis["labels"], *axis["texts"])
        ]
        seen = " ".join(words)
        return (
            len(axes) >= panels
            and len(lines) >= curves
            and sum(axis["bands"] for axis in axes) >= bands
            and all(label in seen for label in labels)
        )

    return Fact(f"{run}/figures/{figure} shows {labels}", holds)
