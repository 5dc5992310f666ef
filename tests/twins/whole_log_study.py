"""Was it flying, was it in control? 400 logs from the ground to the ground, or into it, against their truth.

``python -m tests.twins.whole_log_study`` flies them all and writes the table of ``docs/accuracy.md`` anew.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.twins.whole_logs import BOOT_S, Case, Kind, MadeLog, Truth, cases, fly, write

import rotorid
from rotorid.data.record import Intervals
from rotorid.errors import InsufficientDataError
from rotorid.reviewing.cards import cards
from rotorid.signal.airborne import airborne
from rotorid.signal.control import Control

RIGHT_S = 0.5
PAGE = Path(__file__).resolve().parents[2] / "docs" / "accuracy.md"
BEGIN, END = "<!-- whole logs -->", "<!-- end of whole logs -->"


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What is said of one log, beside its truth."""

    case: Case
    truth: Truth
    flights: Intervals
    control: Control | None
    green: tuple[str, ...] = ()
    """Cards that are green; looked for on benches only."""

    @property
    def window_is_right(self) -> bool:
        """Whether both ends of the flight are right to 0.5 s, without a hole; a bench has no flight."""
        if self.truth.flight is None:
            return not self.flights
        if not self.flights:
            return False
        holes = [b[0] - a[1] for a, b in zip(self.flights, self.flights[1:], strict=False)]
        ends = (self.flights[0][0] - self.truth.flight[0], self.flights[-1][1] - self.truth.flight[1])
        return all(abs(error) <= RIGHT_S for error in (*ends, *holes))

    @property
    def loss_is_said(self) -> bool:
        return self.control is not None and self.control.lost_at_s is not None

    @property
    def late_s(self) -> float:
        """Of a loss that was found, how late."""
        assert self.control is not None
        assert self.control.lost_at_s is not None
        assert self.truth.lost_s is not None
        return self.control.lost_at_s - self.truth.lost_s


def examined(made: MadeLog, folder: Path) -> Answer:
    """Write a log, read it, and ask."""
    path = write(made, folder)
    record = rotorid.read(path)
    path.unlink()
    try:
        found = airborne(record, margin_s=0.0)
        flights, control = found.intervals, found.control
    except InsufficientDataError:
        flights, control = (), None
    green: tuple[str, ...] = ()
    if made.truth.flight is None:
        reviewed = rotorid.review(record, models=False)
        green = tuple(card.key for card in cards(reviewed) if card.color == "green")
    return Answer(case=made.case, truth=made.truth, flights=flights, control=control, green=green)


def study(chosen: Iterable[Case]) -> Iterator[Answer]:
    with tempfile.TemporaryDirectory() as folder:
        for case in chosen:
            yield examined(fly(case), Path(folder))


NAMES: dict[Kind, str] = {
    "flight": "flights: sticks, steps, doublets, full throttle, zero throttle, gusts, flips",
    "landed": "hovers with 10 to 60 s on the ground, some with hard landings",
    "bench": "benches: disarmed or armed idle, still or carried by hand",
    "crash": "crashes: one motor (or two) dead or weak, collision, power cut, brown-out",
}


def rows(answers: Sequence[Answer]) -> Iterator[str]:
    """The table of the page."""
    yield "| logs | number | window right to 0.5 s | control lost, said | of these within 0.5 s | green cards |"
    yield "|---|---|---|---|---|---|"
    for kind, words in NAMES.items():
        own = [answer for answer in answers if answer.case.kind == kind]
        right = sum(answer.window_is_right for answer in own)
        said = [answer for answer in own if answer.loss_is_said]
        late = [answer for answer in said if answer.truth.lost_s is not None]
        near = sum(abs(answer.late_s) <= RIGHT_S for answer in late)
        green = str(sum(bool(answer.green) for answer in own)) if kind == "bench" else "–"
        yield f"| {words} | {len(own)} | {right} | {len(said)} | {near if late else '–'} | {green} |"


def write_table(answers: Sequence[Answer]) -> None:
    text = PAGE.read_text(encoding="utf-8")
    table = "\n".join(rows(answers))
    PAGE.write_text(re.sub(f"{BEGIN}.*{END}", f"{BEGIN}\n{table}\n{END}", text, flags=re.DOTALL), encoding="utf-8")


def wrong(answer: Answer) -> str:
    """One line about a log that is read wrongly."""
    truth, lost = answer.truth, answer.control.lost_at_s if answer.control else None
    flags = f"{answer.case.flags} flags, {answer.case.log_hz:g} Hz, from {BOOT_S:g} s"
    return f"{answer.case.file} ({flags}): flight {truth.flight}, found {answer.flights}; lost {truth.lost_s}, {lost}"


if __name__ == "__main__":
    found = list(study(cases()))
    for answer in found:
        if not answer.window_is_right or answer.loss_is_said != (answer.truth.lost_s is not None) or answer.green:
            print(wrong(answer))
    print("\n".join(rows(found)))
    write_table(found)
