"""Which outputs of an unseen maneuver tell about a model: those that it moved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rotorid.models.state_space import StateSpace
from rotorid.pipeline.identification import Segment
from rotorid.pipeline.measure import Measured
from rotorid.pipeline.verify_model import Candidate
from rotorid.typing import FloatArray
from rotorid.verify.matching import band_pass
from rotorid.verify.verification import Verification

SHARE = 0.25
"""An output that the model does not connect with a maneuver tells something from this share of its usual motion: what
moves less is noise, or a coupling that is no part of a model of each axis."""

_UNCONNECTED = 1e-9


def usual_motion(measured: Measured, band_rad_s: tuple[float, float]) -> dict[str, float]:
    """Largest standard deviation of each output in the fitted maneuvers, within the fitted band.

    Parameters
    ----------
    measured
        With the maneuvers that were fitted.
    band_rad_s
        The fitted band.
    """
    largest = dict.fromkeys(measured.response.outputs, 0.0)
    for segment in measured.segments:
        for name in largest:
            largest[name] = max(largest[name], _motion(segment, name, band_rad_s))
    return largest


def telling(
    checks: Sequence[Verification], candidate: Candidate, usual: Mapping[str, float]
) -> tuple[Verification, ...]:
    """Verifications with those outputs as ``moved`` that tell about the model; those without any are left out.

    An output tells where it moves clearly more than before the maneuver, see
    :func:`rotorid.verify.time_domain.verify_in_time`, and where it should move or does: the model connects it with the
    input of the maneuver, or it moves by a quarter of its usual motion. The latter shows a coupling that the model
    lacks.

    Parameters
    ----------
    checks
        Maneuvers of one log, measured and predicted.
    candidate
        The model.
    usual
        Output to its largest standard deviation where the model was fitted, see :func:`usual_motion`; that in the other
        maneuvers counts too.
    """
    largest = dict(usual)
    for check in checks:
        for name, values in zip(check.output_names, check.measured, strict=True):
            largest[name] = max(largest.get(name, 0.0), float(values.std()))
    told = (replace(check, moved=_telling(check, candidate, largest)) for check in checks)
    return tuple(check for check in told if check.moved)


def _telling(check: Verification, candidate: Candidate, largest: Mapping[str, float]) -> tuple[str, ...]:
    expected = _connected(check, candidate.system_of(check.output_names))
    return tuple(
        name
        for name, values in zip(check.output_names, check.measured, strict=True)
        if name in check.moved and (name in expected or values.std() >= SHARE * largest[name])
    )


def _connected(check: Verification, system: StateSpace) -> tuple[str, ...]:
    """Outputs that the model connects with the input of a maneuver; all, where that is none of its inputs."""
    command = f"{check.maneuver.axis}_command"
    if command not in check.input_names:
        return check.output_names
    rows = _gain(system)
    own = rows[:, check.input_names.index(command)]
    return tuple(
        name
        for name, gain, row in zip(check.output_names, own, rows, strict=True)
        if gain > _UNCONNECTED * row.max(initial=0.0)
    )


def _gain(system: StateSpace) -> FloatArray:
    """Largest magnitude of each response over three decades, shape ``(y, u)``."""
    return np.asarray(np.abs(system.response(np.geomspace(0.1, 100.0, 7))).max(axis=-1))


def _motion(segment: Segment, name: str, band_rad_s: tuple[float, float]) -> float:
    history, maneuver = segment.history, segment.maneuver
    inside = (history.time_s >= maneuver.start_s) & (history.time_s <= maneuver.stop_s)
    if name not in history.names or not inside.any():
        return 0.0
    filtered = band_pass(band_rad_s, history.sample_rate_hz, history.duration_s)(history[name])
    return float(filtered[inside].std())
