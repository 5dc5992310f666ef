"""Plants of the axes, with draws of what is not known of them, out of identified models and their measurements."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.data.axes import RATE_OF
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.pipeline.identification import identify
from rotorid.pipeline.preparation.supports import unsupported
from rotorid.pipeline.results import IdentifiedModel
from rotorid.tuning.plant import MeasuredRatio, UncertainPlant, uncertain_plant
from rotorid.typing import Axis, ComplexArray, FloatArray

_WIDEST = 0.15
_WITHOUT_SPEED_RAD_S = (3.0, 300.0)


def rate_model(axis: Axis, given: Sequence[IdentifiedModel], logs: Sequence[FlightRecord]) -> IdentifiedModel:
    """The rate model of an axis: one that came, else one of the logs."""
    name = f"rate.{axis}"
    own = next((one for one in given if one.name == name), None)
    if own is not None:
        return own
    if not logs:
        raise InsufficientDataError(f"no result of {name} came", needed=f"one of rotorid identify --model {name}")
    held = [one for one in logs if {f"{axis}_command", RATE_OF[axis]} <= set(one.channel_names)]
    if not held:
        raise unsupported(logs, name) or InsufficientDataError(f"no log holds what {name} needs")
    try:
        return identify(held, name)
    except InsufficientDataError as error:
        # Below some rad/s the speed of the vehicle acts, which a rate model lacks; no margin lies there.
        if not any(finding.kind == "poor_fit" for finding in error.findings):
            raise
        return identify(held, name, band_rad_s=_WITHOUT_SPEED_RAD_S)


def plant_of(model: IdentifiedModel, axis: Axis, *, draws: int, seed: int) -> UncertainPlant:
    """The plant with draws, from the model and what was measured beside it."""
    command, rate = f"{axis}_command", RATE_OF[axis]
    structure = model.structure
    row, column = structure.outputs.index(rate), structure.inputs.index(command)
    values = structure.parameters.values

    def response(omega_rad_s: FloatArray) -> ComplexArray:
        return np.asarray(structure.response(values, np.atleast_1d(omega_rad_s))[row, column])

    band = model.band_rad_s
    if band is None:
        raise InsufficientDataError(f"{model.name} was not fitted to responses", needed="--method frequency")
    measured = model.data.response
    ratio = None
    if measured.omega_rad_s.size and rate in measured.outputs and command in measured.inputs:
        y, u = measured.outputs.index(rate), measured.inputs.index(command)
        used = np.asarray(model.data.used[y, u], dtype=bool)
        if used.sum() >= 3:
            omega, seen = measured.omega_rad_s[used], measured.values[y, u, used]
            relative = measured.covariance[y, u][np.ix_(used, used)] / np.outer(seen, seen.conj())
            ratio = MeasuredRatio(omega_rad_s=omega, ratio=seen / response(omega), covariance=relative)
    return uncertain_plant(response, ratio, band_rad_s=band, draws=draws, seed=seed)


def require_known(axis: Axis, plant: UncertainPlant, crossover_rad_s: float) -> None:
    """Refuse a plant whose gain is not known where its loop acts, or at the end of its band below that.

    Raises
    ------
    InsufficientDataError
        It is known to no better than 15 % there.
    """
    low, high = plant.band_rad_s
    at = np.array([float(np.clip(crossover_rad_s, low, high))])
    spread = float(np.std(np.log(np.abs(plant.drawn(at)))))
    if spread > _WIDEST:
        raise InsufficientDataError(
            f"the plant of {axis} is known to {100.0 * spread:.0f} % only at {at[0]:.0f} rad/s",
            needed=f"{100.0 * _WIDEST:.0f} %",
            remedy=f"fly a longer sweep of {axis}",
        )
