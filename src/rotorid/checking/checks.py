"""Scores and verdicts of a model on unseen flights, from verifications with their signals."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rotorid.results.model import FrequencyCheck, Verifications
from rotorid.results.summary import (
    Ahead,
    AheadScore,
    Checks,
    ClosedLoopScores,
    ManeuverCheck,
    SignalScore,
    SweepCheck,
    Trim,
    finite,
)
from rotorid.verification.closed_loop import ClosedLoop
from rotorid.verification.prediction import Prediction
from rotorid.verification.verification import Scores, Verification, verdict


def checks_of(found: Verifications, states: Sequence[str]) -> Checks:
    """Scores by record and maneuver, and costs on unseen sweeps.

    Parameters
    ----------
    found
        Verifications with their signals.
    states
        Names of the states, for the biases.
    """
    return Checks(
        records={
            f"{check.record}: {check.maneuver.axis} {check.maneuver.kind} at {check.maneuver.start_s:.1f} s": _scores(
                check
            )
            for check in found.maneuvers
        },
        frequency=dict(found.frequency),
        maneuvers=tuple(maneuver_check(check, states) for check in found.maneuvers),
        sweeps=tuple(sweep_check(sweep) for sweep in found.sweeps),
    )


def maneuver_check(check: Verification, states: Sequence[str], trim: Trim | None = None) -> ManeuverCheck:
    """One maneuver in numbers.

    Parameters
    ----------
    check
        What was found.
    states
        Names of the states, for the biases.
    trim
        Trim before the maneuver, where it was seen.
    """
    return ManeuverCheck(
        record=check.record,
        axis=check.maneuver.axis,
        kind=check.maneuver.kind,
        start_s=check.maneuver.start_s,
        stop_s=check.maneuver.stop_s,
        verdict=verdict(check),
        scores=_scores(check),
        j_rms=check.j_rms,
        # In a steady wind a model may have the heading as a last state, which it did not have where it was fitted.
        biases=dict(zip(states, map(float, check.biases), strict=False)),
        growth_1_s=check.growth_1_s,
        low_pass_rad_s=check.low_pass_rad_s,
        moved=tuple(check.moved),
        ahead=_ahead(check.ahead) if check.ahead else (),
        holds_s=dict(check.ahead.holds_s) if check.ahead else {},
        closed_loop=_closed_loop(check.closed_loop) if check.closed_loop else None,
        trim=trim,
    )


def _scores(check: Verification) -> dict[str, Scores]:
    """Scores of the outputs that moved; the others do not test the model: their score is that of the noise."""
    outputs = check.moved or check.output_names
    return {
        name: scores
        for name, scores in check.scores.items()
        if name in outputs and math.isfinite(scores.nrmse_fit_percent)
    }


def _ahead(prediction: Prediction) -> tuple[Ahead, ...]:
    return tuple(
        Ahead(
            horizon_s=horizon.horizon_s,
            outputs={
                name: AheadScore(
                    nrmse_fit_percent=finite(scores.nrmse_fit_percent),
                    tic=scores.tic,
                    rms=scores.rms,
                    skill=scores.skill,
                    over_quiet=scores.over_quiet,
                )
                for name, scores in horizon.scores.items()
            },
        )
        for horizon in prediction.horizons
    )


def _closed_loop(flown: ClosedLoop) -> ClosedLoopScores:
    return ClosedLoopScores(
        setpoints=dict(flown.setpoints),
        controller_tic=dict(flown.controller_tic),
        scores={
            name: SignalScore(nrmse_fit_percent=finite(scores.nrmse_fit_percent), tic=scores.tic, rms=scores.rms)
            for name, scores in flown.scores.items()
        },
    )


def sweep_check(sweep: FrequencyCheck) -> SweepCheck:
    """Unseen sweeps in numbers."""
    return SweepCheck(records=tuple(sweep.records), pairs=dict(sweep.pairs))
