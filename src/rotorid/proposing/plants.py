"""Plants of the axes with draws of their uncertainty, from identified models and their measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.autopilots.advice import move_stick
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

_NO_PLANT = {"starts", "search", "evaluations", "bootstrap", "reduce", "outputs"}
"""Choices of a search, of parameters and of intervals, which do not change the plant."""

_WIDEST = 0.15
_WITHOUT_SPEED_RAD_S = (3.0, 300.0)
_HZ = 2.0 * np.pi


def rate_model(axis: Axis, given: Sequence[IdentifiedModel], logs: Sequence[FlightRecord]) -> IdentifiedModel:
    """The result with the rate model of an axis: a given one, or identified from the logs."""
    name = rate_model_of(axis)
    if own := _with_rate(axis, given):
        return own[0]
    motors = next((model for model in given if model.motors is not None), None)
    if not logs and motors is not None:
        raise InsufficientDataError(
            f"{motors.name} has the torque of the motors, but not the delay from command to rate that margins need",
            remedy="give the log of that flight with the result",
        )
    if not logs:
        raise InsufficientDataError(
            f"no model of {name} was given",
            needed=f"{name}, or a model of axis.* or hover.* from {axis}_command to {RATE_OF[axis]}",
            remedy=f"run rotorid identify LOG --model {name}",
        )
    candidates = [record for record in logs if {f"{axis}_command", RATE_OF[axis]} <= set(record.channel_names)]
    if not candidates:
        raise unsupported(logs, name) or InsufficientDataError(
            f"no log contains {axis}_command and {RATE_OF[axis]}, which {name} needs"
        )
    try:
        return identify(candidates, name)
    except InsufficientDataError as error:
        # At low frequencies the vehicle's speed acts, which a rate model lacks; no margin is there.
        if not any(finding.kind == "poor_fit" for finding in error.findings):
            raise
        return identify(candidates, name, band_rad_s=_WITHOUT_SPEED_RAD_S)


def _with_rate(axis: Axis, given: Sequence[IdentifiedModel]) -> list[IdentifiedModel]:
    """Results with the rate of an axis by its command, rate models first, then those of fewest inputs."""
    name = rate_model_of(axis)
    found = [model for model in given if axis in model.rate_axes]
    return sorted(found, key=lambda model: (model.name != name, len(model.structure.inputs)))


def plant_remarks(axis: Axis, given: Sequence[IdentifiedModel], model: IdentifiedModel) -> list[Finding]:
    """Reasons why gains may differ from those of the logs alone: choices of ``identify``, or other results.

    Parameters
    ----------
    axis, given
        As for :func:`rate_model`.
    model
        Its answer.
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
            f"{model.name} does not fit over its usual band, so it was identified over "
            f"{' to '.join(f'{end:g}' for end in _WITHOUT_SPEED_RAD_S)} rad/s, the range of its margins."
        )
        message = (
            f"{model.name} was identified with {', '.join(changed)}; with default settings the gains of {axis} may "
            "differ."
            if any(item is model for item in given)
            else chosen_here
        )
        remarks.append(remark("plant_of_choice", axis, message))
    others = [item for item in _with_rate(axis, given) if item is not model]
    unused = [item for item in others if item.name == model.name]
    if unused:
        message = (
            f"{counted(len(unused) + 1, 'result')} of {model.name} were given; the first was used "
            f"({', '.join(model.provenance.inputs)}). To use all flights, give the logs alone."
        )
        remarks.append(remark("plant_of_choice", axis, message))
    if other := [item.name for item in others if item not in unused]:
        message = f"{model.name} was used for {axis}; {' and '.join(dict.fromkeys(other))} has its plant too."
        remarks.append(remark("plant_of_choice", axis, message))
    return remarks


def _in_words(value: Setting) -> str:
    """A choice as text."""
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
    r"""The plant with draws: measured inside the band, a fitted lag beyond.

    A result without a measured response has the response of its model, whose single delay stands for everything between
    command and logged rate. Known filters :math:`F`, with the delay :math:`\tau_F` at low frequency, are added beyond
    the band:

    .. math:: P = P_{model} F e^{j \omega \tau_F}

    Parameters
    ----------
    model, axis
        A result with the rate of the axis by its command.
    draws, seed
        Number of draws, and their seed.
    passed
        Filters on the logged rate, and so on the response of the model.
    measured
        The plant measured from logs; by default that of the result.
    """
    measured = measured or plant_of_result(axis, model, filters=passed)
    poles = model.system.poles()
    above_rad_s = float(np.abs(poles[poles.real > 0.0]).max(initial=0.0))
    if measured is not None:
        return replace(drawn_plant(measured, draws=draws, seed=seed), above_rad_s=above_rad_s)

    def response(omega_rad_s: FloatArray) -> ComplexArray:
        omega = np.atleast_1d(omega_rad_s)
        beyond_delay = combined_response(passed, omega) * np.exp(
            1j * omega * sum(known_filter.delay_s for known_filter in passed)
        )
        return np.asarray(model.rate_response(axis, omega) * beyond_delay)

    pair = model.fit.cost.pairs.get(f"{RATE_OF[axis]}/{axis}_command") if model.fit.cost else None
    if pair is None:
        raise InsufficientDataError(
            f"{model.name} was not fitted to the frequency response of {RATE_OF[axis]}",
            remedy="identify it with --method frequency",
        )
    plant = uncertain_plant(response, None, band_rad_s=pair.band_rad_s, draws=draws, seed=seed)
    return replace(plant, above_rad_s=above_rad_s)


def flight_by_stick(axis: Axis) -> str:
    """The flight by stick that shows an axis without a sweep, as part of a sentence.

    Simulated flights of roll and pitch with these flicks give gains; faster ones bring motors to their limits.
    """
    if axis == "yaw":
        return move_stick(axis)
    return f"fly 30 s in acro at a steady throttle with {axis} flicks of 0.25 s and 200°/s to each side"


def require_known(axis: Axis, plant: UncertainPlant, crossover_rad_s: float) -> None:
    """Refuse a plant whose gain is too uncertain at the crossover of its loop, or at the nearest end of its band.

    Raises
    ------
    InsufficientDataError
        The gain is more uncertain than 15 %, or the crossover is beyond the range of the plant.
    """
    low, high = plant.band_rad_s
    if crossover_rad_s > plant.reach_rad_s:
        raise InsufficientDataError(
            f"{axis} was measured up to {plant.reach_rad_s / _HZ:.1f} Hz only, below the crossover of its loop "
            f"({crossover_rad_s / _HZ:.1f} Hz)",
            needed="faster motion",
            remedy=f"fly a sweep of {axis} up to {BAND_OVER_CROSSOVER * crossover_rad_s / _HZ:.0f} Hz, or without "
            f"a sweep {flight_by_stick(axis)}",
        )
    at = np.array([float(np.clip(crossover_rad_s, low, high))])
    spread = float(np.std(np.log(np.abs(plant.drawn(at)))))
    if spread > _WIDEST:
        raise InsufficientDataError(
            f"the response of {axis} is uncertain by {100.0 * spread:.0f} % at {at[0] / _HZ:.1f} Hz",
            needed=f"{100.0 * _WIDEST:.0f} % or less",
            remedy=f"fly a longer sweep of {axis}, or without a sweep {flight_by_stick(axis)}",
        )
