"""What the numbers of a verification mean: a good model, a poor one, or an unstable airframe that diverges."""

from __future__ import annotations

from typing import Literal, TypeAlias

from rotorid.verify.prediction import HORIZONS_S, Horizon
from rotorid.verify.scores import GUIDELINES, guidelines_met
from rotorid.verify.verification import Verification

Verdict: TypeAlias = Literal["good", "poor", "diverges", "disturbed"]
"""``diverges``: in open loop the prediction leaves the measurement, as that of an unstable airframe must, while it is
good over a horizon in which errors have not grown yet. ``disturbed``: it is not good over that horizon either, but no
worse than before the maneuver, so gusts are as likely a cause as the model."""

_GROWTHS = 1.5


def shortest_horizon(growth_1_s: float) -> float:
    r"""Horizon over which an airframe is judged by prediction ahead, seconds.

    Half a second, or 1.5 times the time :math:`1/\sigma` in which an error grows e-fold if that is shorter: long enough
    that the dynamics show, short enough that noise and gusts have not been multiplied by more than five.

    Parameters
    ----------
    growth_1_s
        Largest real part of a pole.

    Examples
    --------
    >>> shortest_horizon(0.0), shortest_horizon(6.0)
    (0.5, 0.25)
    """
    return min(HORIZONS_S[0], _GROWTHS / growth_1_s) if growth_1_s > 0.0 else HORIZONS_S[0]


def judged_horizon(check: Verification) -> Horizon | None:
    """The prediction ahead that judges an unstable airframe; ``None`` for a stable one, or where there is none."""
    if check.ahead is None or not grows(check):
        return None
    return check.ahead.horizons[0]


def grows(check: Verification) -> bool:
    """Whether an error of the model grows e-fold within the maneuver."""
    duration_s = float(check.time_s[-1] - check.time_s[0])
    return check.growth_1_s * duration_s > 1.0


def poor_outputs(check: Verification) -> tuple[str, ...]:
    """Outputs that the maneuver moved and that the open loop misses."""
    return tuple(
        name
        for name, scores in check.scores.items()
        if name in (check.moved or check.output_names)
        and guidelines_met(scores.tic, scores.nrmse_fit_percent) < GUIDELINES
    )


def poor_ahead(check: Verification) -> tuple[str, ...]:
    """Outputs that the prediction ahead misses by more than gusts explain, where that is what judges."""
    horizon = judged_horizon(check)
    return () if horizon is None else tuple(n for n in _missed(check, horizon) if horizon.scores[n].above_gusts)


def disturbed_ahead(check: Verification) -> tuple[str, ...]:
    """Outputs that the prediction ahead misses by no more than before the maneuver."""
    horizon = judged_horizon(check)
    return () if horizon is None else tuple(n for n in _missed(check, horizon) if not horizon.scores[n].above_gusts)


def _missed(check: Verification, horizon: Horizon) -> list[str]:
    return [
        name
        for name, scores in horizon.scores.items()
        if name in (check.moved or check.output_names)
        and guidelines_met(scores.tic, scores.nrmse_fit_percent) < GUIDELINES
    ]


def verdict(check: Verification) -> Verdict:
    """Judge one maneuver.

    A stable model is judged by its open loop. An unstable one is judged by its prediction ahead: if that is poor, so is
    the model, however well a fitted initial state makes the open loop look; if it is good, an open loop that leaves
    the measurement only shows that the airframe is unstable.

    Parameters
    ----------
    check
        One maneuver, measured and predicted.
    """
    if judged_horizon(check) is None:
        return "poor" if poor_outputs(check) else "good"
    if poor_ahead(check):
        return "poor"
    if disturbed_ahead(check):
        return "disturbed"
    return "diverges" if poor_outputs(check) else "good"
