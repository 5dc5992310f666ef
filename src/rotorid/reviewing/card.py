"""A card of a review, and the numbers with limits that cards judge by."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, NamedTuple, TypeAlias

from rotorid.data.base import Immutable
from rotorid.data.quantities import QUANTITIES, FigureOfMerit, Judgment
from rotorid.data.quantity import Quantity
from rotorid.results.summary import Color

State: TypeAlias = Literal["good", "look", "part", "cannot"]
"""Good; look here; what was measured is good, and a part was not measured; not enough data."""

STATES: Mapping[State, tuple[str, Color]] = MappingProxyType(
    {
        "good": ("good", "green"),
        "look": ("look here", "yellow"),
        "part": ("good in part", "gray"),
        "cannot": ("not enough data", "gray"),
    }
)
"""Word and color of a state, on every page and line: what is unknown is gray."""


@dataclass(frozen=True, kw_only=True)
class Card(Immutable):
    """One judgment.

    Parameters
    ----------
    key, title
        Name, and the question.
    state
        Whether it is good, needs a look, is good as far as it was measured, or was not measured.
    headline
        The answer in one sentence that a pilot could say to a friend.
    number, scale
        The one number behind it with its unit, and what is usual; empty where there is none.
    quantity
        Name of that number in :data:`rotorid.data.quantities.QUANTITIES`; empty where it is none of them.
    details
        What else to know.
    remedy
        What to fly, set or log for an answer, as a command; empty where the answer is known.
    """

    key: str
    title: str
    state: State
    headline: str
    number: str = ""
    scale: str = ""
    quantity: str = ""
    details: str = ""
    remedy: str = ""

    @property
    def word(self) -> str:
        """The state in words."""
        return STATES[self.state][0]

    @property
    def color(self) -> Color:
        """The state for the eye."""
        return STATES[self.state][1]

    @property
    def measured(self) -> str:
        """The number with its scale."""
        return f"{self.number} ({self.scale})" if self.scale else self.number

    @property
    def action(self) -> str:
        """What to do for an answer, as a sentence."""
        return f"To measure it: {lower_first(self.remedy)}" if self.remedy else ""

    @property
    def sentence(self) -> str:
        """All that the card says, without its number."""
        return together(self.headline, self.details, self.action)


def together(*sentences: str) -> str:
    """The sentences that there are, in one text."""
    return " ".join(sentence for sentence in sentences if sentence)


def lower_first(sentence: str) -> str:
    """A sentence as it goes on behind a colon."""
    ended = sentence if sentence.endswith(".") else f"{sentence}."
    return ended if ended[1:2].isupper() else f"{ended[:1].lower()}{ended[1:]}"


class LimitedNumber(NamedTuple):
    """A number of an axis that a card judges by, with its row; ``per`` is what its limit is a share of."""

    axis: str
    name: str
    figure: FigureOfMerit
    quantity: Quantity
    per: float = 1.0

    @property
    def verdict(self) -> Judgment:
        """Good or not over the whole 95 % interval; else there is not enough data."""
        return self.figure.judged(self.quantity, self.per)

    @property
    def sure_end(self) -> float:
        """The better end of the interval over its limit: above one it is surely bad, and the worse the larger."""
        return self._over_limit(self.quantity.upper, self.quantity.lower)

    @property
    def bad_end(self) -> float:
        """The worse end of the interval over its limit: up to one it is surely good."""
        return self._over_limit(self.quantity.lower, self.quantity.upper)

    def _over_limit(self, of_high: float, of_low: float) -> float:
        limit = self.per * self.figure.limit
        if math.isnan(self.figure.good_above):
            return of_low / limit
        return limit / of_high if of_high > 0.0 else math.inf

    @property
    def shown(self) -> str:
        """The number with its axis, in one line."""
        return f"{self.axis} {self.figure.before} {self.figure.shown(self.quantity)}"

    @property
    def shown_alone(self) -> str:
        """The number without an axis, in one line."""
        return f"{self.figure.before} {self.figure.shown(self.quantity)}"

    @property
    def scale(self) -> str:
        """What is usual, for a pilot who does not know the number."""
        return self.figure.scale(self.verdict, self.per)

    @property
    def trouble(self) -> tuple[str, str]:
        """What it means beyond its limit: the sentence for a headline, and the rest."""
        first, _, rest = self._filled(self.figure.trouble).partition(". ")
        return f"{first.rstrip('.')}.", rest

    @property
    def doubt(self) -> str:
        """Why it gives no verdict."""
        return f"Unclear whether {self._filled(self.figure.whether)}."

    def bad(self, key: str, title: str, number: str = "") -> Card:
        """The card of a number beyond its limit."""
        headline, details = self.trouble
        return Card(
            key=key,
            title=title,
            state="look",
            headline=headline,
            number=number or self.shown,
            scale=self.scale,
            quantity=self.name,
            details=details,
        )

    def doubtful(self, key: str, title: str, *, number: str = "", details: str = "", remedy: str = "") -> Card:
        """The card of a number whose interval contains its limit."""
        return Card(
            key=key,
            title=title,
            state="cannot",
            headline=self.doubt,
            number=number or self.shown,
            scale=self.scale,
            quantity=self.name,
            details=details,
            remedy=remedy or self.figure.surer,
        )

    def _filled(self, words: str) -> str:
        return words.format(axis=self.axis, Axis=self.axis.capitalize(), value=self.figure.shown(self.quantity))


def judged_numbers(card: str, numbers: Mapping[str, Quantity], axis: str = "") -> list[LimitedNumber]:
    """The numbers that a card judges by, in the order of their table; without an axis, their names begin with it."""
    return [
        LimitedNumber(
            axis=axis or name.partition("_")[0],
            name=name,
            figure=row,
            quantity=numbers[name],
            per=numbers[row.per].value if row.per else 1.0,
        )
        for name, row in QUANTITIES.items()
        if row.card == card and {name, row.per or name} <= numbers.keys()
    ]


def lacking_numbers(card: str, axes: Sequence[str], judged: Sequence[LimitedNumber]) -> list[str]:
    """Numbers of a card that some axes lack, in words."""
    known = {(number.axis, number.name) for number in judged}
    rows = {name: row for name, row in QUANTITIES.items() if row.card == card}
    return [f"{row.words} of {axis}" for axis in axes for name, row in rows.items() if (axis, name) not in known]


def bad_and_unsure(judged: Sequence[LimitedNumber]) -> tuple[list[LimitedNumber], list[LimitedNumber]]:
    """What is surely bad and what may be, each the worst first."""
    bad = sorted((number for number in judged if number.verdict == "look"), key=lambda number: -number.sure_end)
    unsure = sorted((number for number in judged if number.verdict == "cannot"), key=lambda number: -number.bad_end)
    return bad, unsure
