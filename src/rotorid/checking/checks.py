"""Scores and verdicts of a model on unseen flights, from verifications with their signals."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rotorid.results.model import FrequencyCheck, Verifications
from rotorid.results.summary import (
    Ahead,
    AheadScore,
    AxisLoads,
    Checks,
    ClosedLoopScores,
    FlightScores,
    ManeuverCheck,
    SignalScore,
    StepError,
    StepsAhead,
    SweepCheck,
    Trim,
    finite,
)
from rotorid.verification.closed_loop import ClosedLoop
from rotorid.verification.flight import FlightJudgement
from rotorid.verification.multistep import StepErrors
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
        flight=flight_scores(check.flight) if check.flight else None,
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


_SHOWN_STEPS = 5
"""Horizons that a document holds: the first and the last, and some between."""


def flight_scores(judged: FlightJudgement) -> FlightScores:
    """A physical model on a stretch, or on several, in numbers."""
    return FlightScores(
        force_rms_n=judged.errors.force_rms_n,
        moment_rms_nm=judged.errors.moment_rms_nm,
        axes={axis: AxisLoads(**error._asdict()) for axis, error in judged.errors.axes.items()},
        outside_percent=judged.outside_percent,
        outside=dict(judged.outside),
        ahead=_steps(judged.ahead) if judged.ahead else None,
        wind_m_s=judged.wind,
        skew_s=judged.skew_s,
        center_m=dict(judged.center),
    )


def _steps(ahead: StepErrors) -> StepsAhead:
    last = ahead.horizons_s.size - 1
    shown = sorted({round(last * share / (_SHOWN_STEPS - 1)) for share in range(_SHOWN_STEPS)})
    return StepsAhead(
        horizon_s=float(ahead.horizons_s[-1]),
        steps=last + 1,
        starts=ahead.starts,
        errors={
            name: tuple(
                StepError(
                    horizon_s=float(ahead.horizons_s[step]),
                    model=float(row[step]),
                    naive=float(ahead.naive[name][step]),
                )
                for step in shown
            )
            for name, row in ahead.model.items()
        },
        ratios={name: ratio for name, ratio in ahead.ratios.items() if math.isfinite(ratio)},
    )
