"""Plants of the axes, with draws of what is not known of them, out of identified models and their measurements."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.autopilots.filters import KnownFilter, combined_response
from rotorid.data.axes import RATE_OF
from rotorid.data.display import counted
from rotorid.data.findings import Finding, remark
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.flights.supports import unsupported
from rotorid.identifying.identification import identify
from rotorid.loops.plants import MeasuredPlant, drawn_plant, plant_of_result
from rotorid.models.families import rate_model_of
from rotorid.results.model import IdentifiedModel
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.option import Setting
from rotorid.tuning.bands import BAND_OVER_CROSSOVER
from rotorid.tuning.plant import UncertainPlant, uncertain_plant
from rotorid.typing import Axis, ComplexArray, FloatArray

_NO_PLANT = {"starts", "search", "evaluations", "bootstrap"}
"""Choices of a search and of intervals, by which no plant becomes another one."""

_WIDEST = 0.15
_WITHOUT_SPEED_RAD_S = (3.0, 300.0)


def rate_model(axis: Axis, given: Sequence[IdentifiedModel], logs: Sequence[FlightRecord]) -> IdentifiedModel:
    """The rate model of an axis: one that came, else one of the logs."""
    name = rate_model_of(axis)
    own = next((model for model in given if model.name == name), None)
    if own is not None:
        return own
    if not logs:
        raise InsufficientDataError(f"no result of {name} came", needed=f"one of rotorid identify --model {name}")
    candidates = [record for record in logs if {f"{axis}_command", RATE_OF[axis]} <= set(record.channel_names)]
    if not candidates:
        raise unsupported(logs, name) or InsufficientDataError(f"no log holds what {name} needs")
    try:
        return identify(candidates, name)
    except InsufficientDataError as error:
        # Below some rad/s the speed of the vehicle acts, which a rate model lacks; no margin lies there.
        if not any(finding.kind == "poor_fit" for finding in error.findings):
            raise
        return identify(candidates, name, band_rad_s=_WITHOUT_SPEED_RAD_S)


def plant_remarks(axis: Axis, given: Sequence[IdentifiedModel], model: IdentifiedModel) -> list[Finding]:
    """Why gains of an axis may differ from those of its logs alone: other choices of ``identify``, or other results.

    Parameters
    ----------
    axis, given
        As for :func:`rate_model`.
    model
        What it answered.
    """
    remarks = []
    usual = IdentifySettings().as_json()
    changed = [
        f"{name} = {_in_words(value)}"
        for name, value in model.provenance.settings.items()
        if name not in _NO_PLANT and value != usual.get(name)
    ]
    if changed:
        chosen_here = (
            f"{model.name} does not fit over its usual band, where identify and review refuse it: it was identified "
            f"over {' to '.join(f'{end:g}' for end in _WITHOUT_SPEED_RAD_S)} rad/s, where its margins lie."
        )
        message = (
            f"{model.name} was identified with {', '.join(changed)}: with the usual choices the gains of {axis} may be "
            "others."
            if any(item is model for item in given)
            else chosen_here
        )
        remarks.append(remark("plant_of_choice", axis, message))
    unused = [item for item in given if item.name == model.name and item is not model]
    if unused:
        message = (
            f"{counted(len(unused) + 1, 'result')} of {model.name} came, and the first was used, of "
            f"{', '.join(model.provenance.inputs)}. Give the logs alone to use all flights."
        )
        remarks.append(remark("plant_of_choice", axis, message))
    return remarks


def _in_words(value: Setting) -> str:
    """A choice in one short piece of text."""
    values = value if isinstance(value, list) else [value]
    return ", ".join(f"{value:g}" if isinstance(value, float) else str(value) for value in values)


def plant_of(
    model: IdentifiedModel,
    axis: Axis,
    *,
    draws: int,
    seed: int,
    passed: Sequence[KnownFilter] = (),
    measured: MeasuredPlant | None = None,
) -> UncertainPlant:
    r"""The plant with draws: as measured, and beyond the band a lag that explains it.

    A result that holds no measured response has the response of its model. That has one delay for all that lies between
    command and logged rate. Filters that are known, :math:`F`, with the delay :math:`\tau_F` at low frequency, are more
    than that beyond the band:

    .. math:: P = P_{model} F e^{j \omega \tau_F}

    Parameters
    ----------
    model, axis
        A rate model of the axis.
    draws, seed
        How many, and of which seed.
    passed
        Filters that the logged rate has passed, and the response of the model with it.
    measured
        The plant as logs show it; what the result holds of it when not given.
    """
    measured = measured or plant_of_result(axis, model, filters=passed)
    if measured is not None:
        return drawn_plant(measured, draws=draws, seed=seed)
    structure = model.structure
    row, column = structure.outputs.index(RATE_OF[axis]), structure.inputs.index(f"{axis}_command")
    values = structure.parameters.values

    def response(omega_rad_s: FloatArray) -> ComplexArray:
        omega = np.atleast_1d(omega_rad_s)
        beyond_delay = combined_response(passed, omega) * np.exp(
            1j * omega * sum(known_filter.delay_s for known_filter in passed)
        )
        return np.asarray(structure.response(values, omega)[row, column] * beyond_delay)

    if model.band_rad_s is None:
        raise InsufficientDataError(f"{model.name} was not fitted to responses", needed="--method frequency")
    return uncertain_plant(response, None, band_rad_s=model.band_rad_s, draws=draws, seed=seed)


def require_known(axis: Axis, plant: UncertainPlant, crossover_rad_s: float) -> None:
    """Refuse a plant whose gain is not known where its loop acts, or at the end of its band below that.

    Raises
    ------
    InsufficientDataError
        It is known to no better than 15 % there, or the loop acts beyond all that is said of the plant.
    """
    low, high = plant.band_rad_s
    if crossover_rad_s > plant.reach_rad_s:
        raise InsufficientDataError(
            f"the plant of {axis} is known up to {plant.reach_rad_s:.0f} rad/s only, and its loop crosses one near "
            f"{crossover_rad_s:.0f} rad/s",
            needed="a flight that shows the plant there",
            remedy=f"fly a sweep of {axis} up to {BAND_OVER_CROSSOVER * crossover_rad_s:.0f} rad/s",
        )
    at = np.array([float(np.clip(crossover_rad_s, low, high))])
    spread = float(np.std(np.log(np.abs(plant.drawn(at)))))
    if spread > _WIDEST:
        raise InsufficientDataError(
            f"the plant of {axis} is known to {100.0 * spread:.0f} % only at {at[0]:.0f} rad/s",
            needed=f"{100.0 * _WIDEST:.0f} %",
            remedy=f"fly a longer sweep of {axis}",
        )
