"""Maneuvers that the fit had not seen, each measured and predicted."""

from __future__ import annotations

from dataclasses import dataclass

from rotorid.plot.time import verification
from rotorid.report.picture import Picture
from rotorid.report.tables import ManeuverRow, ScoreRow, maneuver_row, score_rows
from rotorid.report.wording import Verdict, worst_prediction
from rotorid.verify.verification import Verification


@dataclass(frozen=True, kw_only=True, slots=True)
class Check:
    """One unseen maneuver on the page."""

    maneuver: ManeuverRow
    verdict: Verdict | None
    scores: tuple[ScoreRow, ...]
    picture: Picture


def check_section(check: Verification, *, key: str) -> Check:
    """Everything that the page says about one unseen maneuver.

    Parameters
    ----------
    check
        Measured and predicted.
    key
        Identifier of its picture.
    """
    return Check(
        maneuver=maneuver_row(check.record, check.maneuver),
        verdict=worst_prediction(list(check.scores.values())) if check.scores else None,
        scores=score_rows(check),
        picture=Picture(
            key=key,
            description=f"Measured and predicted outputs of a {check.maneuver.kind} in {check.record}",
            figure=verification(check),
        ),
    )
