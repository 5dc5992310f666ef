"""Maneuvers that the fit had not seen, each measured and predicted."""

from __future__ import annotations

from dataclasses import dataclass

from rotorid.plot.quantity import quantity
from rotorid.plot.time import verification
from rotorid.plot.unseen import ahead, closed_loop
from rotorid.report.numbers import significant
from rotorid.report.picture import Picture
from rotorid.report.tables import ManeuverRow, maneuver_row
from rotorid.report.unseen_rows import ScoreRow, horizons, score_rows
from rotorid.report.wording import Verdict, maneuver_verdict
from rotorid.verify.closed_loop import ClosedLoop
from rotorid.verify.verdict import verdict
from rotorid.verify.verification import Verification


@dataclass(frozen=True, kw_only=True, slots=True)
class Check:
    """One unseen maneuver on the page."""

    maneuver: ManeuverRow
    verdict: Verdict | None
    scores: tuple[ScoreRow, ...]
    horizons: tuple[str, ...]
    j_rms: str
    picture: Picture
    ahead: Picture | None
    loop: Picture | None
    loop_words: str

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All of its figures."""
        return tuple(one for one in (self.picture, self.ahead, self.loop) if one is not None)


def check_section(check: Verification, *, key: str) -> Check:
    """Everything that the page says about one unseen maneuver.

    Parameters
    ----------
    check
        Measured and predicted.
    key
        Identifier of its picture.
    """
    moved = [name for name in check.output_names if name in (check.moved or check.output_names)]
    what = f"of a {check.maneuver.kind} in {check.record}"
    return Check(
        maneuver=maneuver_row(check.record, check.maneuver),
        verdict=maneuver_verdict(verdict(check)) if check.scores else None,
        scores=score_rows(check),
        horizons=horizons(check),
        j_rms=significant(check.j_rms, digits=2),
        picture=Picture(key=key, description=f"Measured and predicted outputs {what}", figure=verification(check)),
        ahead=Picture(
            key=f"{key}-ahead",
            description=f"Outputs {what}, measured and predicted a little ahead",
            figure=ahead(check.ahead, moved, of=check.output_names),
        )
        if check.ahead
        else None,
        loop=Picture(
            key=f"{key}-loop",
            description=f"Outputs and commands {what}, in flight and of the model under the same controller",
            figure=closed_loop(check.closed_loop, moved),
        )
        if check.closed_loop
        else None,
        loop_words=_loop_words(check.closed_loop) if check.closed_loop else "",
    )


def _loop_words(flown: ClosedLoop) -> str:
    """What drove the controllers, and how well they are known."""
    driven = [
        f"the {quantity(command).words} by {quantity(channel).words} "
        f"(its controller alone has a TIC of {significant(flown.controller_tic[command], digits=2)})"
        for command, channel in flown.setpoints.items()
    ]
    return f"Driven: {', '.join(driven)}."
