"""Scores of unseen maneuvers as rows: open loop, ahead, closed loop."""

from __future__ import annotations

from dataclasses import dataclass

from rotorid.plot.quantity import quantity
from rotorid.report.numbers import MISSING, significant
from rotorid.report.wording import Verdict, prediction_verdict
from rotorid.verify.verification import Verification


@dataclass(frozen=True, kw_only=True, slots=True)
class ScoreRow:
    """How one output or command of an unseen maneuver was predicted.

    Parameters
    ----------
    output
        In words.
    moved
        Whether the maneuver moved it, so that it tells of the model.
    tic, fit, verdict, rms, shift
        Of the open loop; a command has none, for it drives it.
    ahead
        Theil coefficient and skill over each horizon; empty for a command.
    loop
        Theil coefficient in closed loop.
    """

    output: str
    moved: bool
    tic: str = MISSING
    fit: str = MISSING
    verdict: Verdict | None = None
    rms: str = MISSING
    shift: str = MISSING
    ahead: tuple[tuple[str, str], ...] = ()
    loop: str = MISSING


def score_rows(check: Verification) -> tuple[ScoreRow, ...]:
    """Rows of one verification, in the units of paper: outputs that moved, the others, then commands."""
    moved = check.moved or check.output_names
    ordered = sorted(check.scores, key=lambda name: name not in moved)
    return (*(_output(check, name, name in moved) for name in ordered), *_commands(check))


def horizons(check: Verification) -> tuple[str, ...]:
    """The horizons over which a maneuver was predicted ahead."""
    return tuple(f"{one.horizon_s:.2g} s" for one in check.ahead.horizons) if check.ahead else ()


def _output(check: Verification, name: str, moved: bool) -> ScoreRow:
    scores, paper = check.scores[name], quantity(name)
    return ScoreRow(
        output=paper.words,
        moved=moved,
        tic=significant(scores.tic, digits=2),
        fit=significant(scores.nrmse_fit_percent),
        verdict=prediction_verdict(scores.tic, scores.nrmse_fit_percent) if moved else None,
        rms=f"{significant(paper.factor * scores.rms)} {paper.unit}",
        shift=f"{significant(paper.factor * scores.reference_shift, digits=2)} {paper.unit}",
        ahead=_ahead(check, name),
        loop=_loop(check, name),
    )


def _commands(check: Verification) -> list[ScoreRow]:
    if check.closed_loop is None:
        return []
    names = check.closed_loop.names[check.closed_loop.outputs :]
    return [ScoreRow(output=quantity(name).words, moved=True, loop=_loop(check, name)) for name in names]


def _ahead(check: Verification, name: str) -> tuple[tuple[str, str], ...]:
    found = [one.scores[name] for one in check.ahead.horizons] if check.ahead else []
    return tuple((significant(scores.tic, digits=2), significant(scores.skill, digits=2)) for scores in found)


def _loop(check: Verification, name: str) -> str:
    flown = check.closed_loop
    return significant(flown.scores[name].tic, digits=2) if flown and name in flown.scores else MISSING
