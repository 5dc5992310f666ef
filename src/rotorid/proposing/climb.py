r"""The plant of the climb loop: vertical velocity by the acceleration that its controller asks for.

Velocity by throttle, :math:`V = -P_{az} / (j\omega)` with the response :math:`P_{az}` of the vertical specific force,
is measured as the plants of the rates are: over sweeps of the thrust, else while the throttle stick moves, with the lag
that explains it beyond the band. Without such a log it is that of a given model, ``rate.vertical`` or ``hover.*``. The
firmware makes throttle of the acceleration :math:`a` that is asked for (:mod:`rotorid.models.autopilots.climb`):

.. math:: P_{climb} = V T_h / g \quad \text{(PX4)}, \qquad
    P_{climb} = \frac{V C_r}{1 + j \omega V C_a F_a} \quad \text{(ArduPilot)}

The hover thrust :math:`T_h` moves in flight with battery and wind: every draw has one of the flown ones.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.autopilots.filters import combined_response
from rotorid.data.base import cached_by_value
from rotorid.data.display import listed
from rotorid.data.record import FlightRecord
from rotorid.data.response import FrequencyResponse
from rotorid.data.trust import REFUSED_PEAK
from rotorid.errors import InsufficientDataError
from rotorid.flights.hover import hover_throttle
from rotorid.flights.measure import measure
from rotorid.flights.segments import source_of
from rotorid.flights.selection import by_stick, select_maneuvers
from rotorid.loops.plants import MeasuredPlant, drawn_plant, random_errors_at
from rotorid.models.autopilots.climb import AccelerationLoop, acceleration_loop
from rotorid.results.model import IdentifiedModel
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.measuring import MeasureSettings
from rotorid.signal.airborne import airborne, in_air
from rotorid.signal.autopilot_filters import known_filters
from rotorid.signal.excitations import rich_excitations
from rotorid.spectral.derived import corrected, multiplied
from rotorid.tuning.loops import frequency_grid, loop_figures
from rotorid.tuning.plant import UncertainPlant, uncertain_plant
from rotorid.typing import BoolArray, ComplexArray, FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

_COMMAND, _FORCE, _CLIMB = "thrust_command", "az", "w"
_FEWEST_POINTS = 8
_LEAST_PASSED = 0.1
_FLOWN = (0.05, 0.95)
"""Quantiles of the hover thrust in flight between which the draws lie."""

_UNLOGGED = 0.1
"""Half width of the hover thrust, over itself, where PX4 estimates it and does not log it."""

_REMEDY = "fly a sweep of the thrust that logs throttle and accelerometer, and give that log too"


class HoverThrust(NamedTuple):
    """Hover thrust that PX4 scaled by: its middle, and the ends of what flew."""

    usual: float
    low: float
    high: float


def velocity_by_throttle(
    given: Sequence[IdentifiedModel], logs: Sequence[FlightRecord], *, draws: int, seed: int
) -> UncertainPlant:
    """Vertical velocity, upward, by the logged throttle, in m/s.

    Parameters
    ----------
    given
        Results of the same vehicle; used where no log moves the thrust.
    logs
        The first that moves the thrust counts.
    draws, seed
        Of the plant.

    Raises
    ------
    InsufficientDataError
        Nothing shows it.
    """
    why = ""
    for record in logs:
        missing = [name for name in (_COMMAND, _FORCE) if name not in record.channel_names]
        if missing:
            why = why or f"{record.source.name} lacks {listed(missing)}"
            continue
        try:
            return drawn_plant(_measured(record), draws=draws, seed=seed)
        except InsufficientDataError as error:
            why = why or error.came
    for model in given:
        if (found := _of_model(model, draws=draws, seed=seed)) is not None:
            return found
    raise InsufficientDataError(
        f"how the vehicle climbs by its throttle is not known{f' ({why})' if why else ''}",
        needed="a flight in which the thrust moved, or a result of rate.vertical",
        remedy=_REMEDY,
    )


@cached_by_value
def _measured(record: FlightRecord) -> MeasuredPlant:
    """Velocity by throttle over the sweeps of a log, else while its throttle stick moves."""
    if rich_excitations(record, "thrust"):
        flights = list(select_maneuvers([record], ("thrust",), IdentifySettings()).fitted)
    else:
        flights = by_stick([record], ("thrust",))
    if not flights:
        raise InsufficientDataError("the thrust was not moved", remedy=_REMEDY)
    settings = MeasureSettings(correct_filters=False)
    measured = measure(flights, inputs=(_COMMAND,), outputs=(_FORCE,), settings=settings)
    response = measured.response
    if response.estimate != "joint":
        raise InsufficientDataError("nothing separates the throttle from gusts", remedy=_REMEDY)
    source = source_of(measured.segments[0], _FORCE)
    filters = known_filters(record, source)
    trusted = measured.trusted_points(response, settings.least_coherence(joint=True))[0, 0]
    # Where a filter of the accelerometer leaves little, nothing is left to correct.
    used = np.flatnonzero(trusted & (np.abs(combined_response(filters, response.omega_rad_s)) > _LEAST_PASSED))
    if used.size < _FEWEST_POINTS:
        raise InsufficientDataError("the throttle explains the vertical force at too few frequencies", remedy=_REMEDY)
    # The estimated velocity passes no filter of the accelerometer.
    force = corrected(random_errors_at(response, used), {_FORCE: filters})
    return MeasuredPlant(
        axis="thrust",
        response=_velocity(force),
        instrument="excitation",
        channel=response.instruments[0],
        source=source,
        sample_rate_hz=measured.segments[0].history.sample_rate_hz,
    )


def _velocity(force: FrequencyResponse) -> FrequencyResponse:
    """Upward velocity of the specific force along z, which points down."""
    return multiplied(force, np.asarray(-1.0 / (1j * force.omega_rad_s))[None])


def _of_model(model: IdentifiedModel, *, draws: int, seed: int) -> UncertainPlant | None:
    """Velocity by throttle of a linear model; ``None`` where it has none."""
    structure = model.structure
    if _COMMAND not in structure.inputs or model.fit.cost is None:
        return None
    column = structure.inputs.index(_COMMAND)
    names = [name for name in (_FORCE, _CLIMB) if name in model.fit.outputs]
    pair = next((model.fit.cost.pairs.get(f"{name}/{_COMMAND}") for name in names), None)
    if pair is None:
        return None
    name = names[0]
    row = list(model.fit.outputs).index(name)

    def response(omega_rad_s: FloatArray) -> ComplexArray:
        omega = np.atleast_1d(omega_rad_s)
        downward = model.system.response(omega)[row, column]
        return np.asarray(-downward / (1j * omega) if name == _FORCE else -downward)

    return uncertain_plant(response, None, band_rad_s=pair.band_rad_s, draws=draws, seed=seed)


def hover_thrust_of(record: FlightRecord, parameters: Mapping[str, float]) -> HoverThrust:
    """Hover thrust by which PX4 scales, over the flight.

    Raises
    ------
    InsufficientDataError
        It is neither logged nor set.
    """
    fixed = parameters.get("MPC_THR_HOVER", 0.0)
    if parameters.get("MPC_USE_HTE", 1.0) < 1.0 and fixed > 0.0:
        return HoverThrust(fixed, fixed, fixed)
    try:
        flights = airborne(record).intervals
    except InsufficientDataError:
        flights = ()
    _, values = in_air(record, "hover_thrust", flights)
    values = values[values > 0.0]
    if values.size:
        low, usual, high = np.quantile(values, (_FLOWN[0], 0.5, _FLOWN[1]))
        return HoverThrust(float(usual), float(low), float(high))
    flown = hover_throttle(record, flights) if flights else None
    if flown is not None:
        return HoverThrust(flown.value, (1.0 - _UNLOGGED) * flown.value, (1.0 + _UNLOGGED) * flown.value)
    if fixed > 0.0:
        return HoverThrust(fixed, (1.0 - _UNLOGGED) * fixed, (1.0 + _UNLOGGED) * fixed)
    raise InsufficientDataError(
        "the hover thrust of the vehicle is not known, and the climb loop scales by it",
        needed="hover_thrust_estimate in the log, or MPC_THR_HOVER",
        remedy="log hover_thrust_estimate, or give a log with all parameters",
    )


def climb_plant(
    velocity: UncertainPlant, record: FlightRecord, parameters: Mapping[str, float], *, seed: int, judged: bool = False
) -> UncertainPlant:
    """Upward velocity by the acceleration that the climb controller asks for.

    Parameters
    ----------
    velocity
        By the throttle.
    record
        The log whose climb loop is meant.
    parameters
        With which it will fly; of the loop around the acceleration, and the hover thrust.
    seed
        Of the hover thrusts of PX4.
    judged
        Whether the parameters are foreign: a loop of the acceleration with little margin is part of the verdict then.

    Raises
    ------
    InsufficientDataError
        The hover thrust is not known, or the flown loop of the acceleration has too little margin.
    """
    inner = acceleration_loop(parameters)
    if inner is not None:
        found = _through(velocity, inner.closed)
        bad = _oscillating(inner, velocity)
        if not judged and float(np.mean(bad)) > _SHARE:
            raise InsufficientDataError(
                "the loop of the vertical acceleration has little margin, so no climb loop can be built on it",
                needed=f"a peak sensitivity below {REFUSED_PEAK} of that loop",
                remedy="lower PSC_ACCZ_P and PSC_ACCZ_I (PSC_D_ACC_ since 4.7) together and fly again",
            )
        # No gains around an unstable loop are stable: with the other sign none are.
        return replace(found, misfits=found.misfits + 1j * np.pi * bad[:, None])
    hover = hover_thrust_of(record, parameters)
    usual = hover.usual / STANDARD_GRAVITY_M_S2
    thrusts = np.random.default_rng(seed).uniform(hover.low, hover.high, velocity.draws) / hover.usual
    scaled = _through(velocity, lambda plants, _: usual * plants)
    return UncertainPlant(
        model=scaled.model,
        band_rad_s=scaled.band_rad_s,
        knots=scaled.knots,
        mean=scaled.mean,
        misfits=scaled.misfits + np.log(thrusts)[:, None],
        goes_on=scaled.goes_on,
    )


def _through(velocity: UncertainPlant, law: Callable[[ComplexArray, FloatArray], ComplexArray]) -> UncertainPlant:
    """A plant behind what turns its command into throttle."""

    def response(omega_rad_s: FloatArray) -> ComplexArray:
        omega = np.atleast_1d(omega_rad_s)
        return np.asarray(law(velocity.response(omega)[None], omega)[0])

    knots = np.exp(velocity.knots)
    misfits = np.log(law(velocity.drawn(knots), knots) / response(knots)[None])
    return UncertainPlant(
        model=response,
        band_rad_s=velocity.band_rad_s,
        knots=velocity.knots,
        mean=np.zeros(velocity.knots.size, dtype=np.complex128),
        misfits=misfits,
        goes_on=velocity.goes_on,
    )


_SHARE = 0.1
"""Largest share of the likely plants on which the loop of the acceleration may have too little margin."""


def _oscillating(inner: AccelerationLoop, velocity: UncertainPlant) -> BoolArray:
    """Likely plants on which the loop of the acceleration is unstable, or near it, shape ``(draws,)``."""
    omega = frequency_grid(inner.controller)
    loops = inner.loop(velocity.drawn(omega), omega)
    found = loop_figures(omega, loops, from_rad_s=velocity.known_from_rad_s)
    return np.asarray((found.stable == 0.0) | (found.sensitivity_peak > REFUSED_PEAK))
