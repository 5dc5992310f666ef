"""The physics of flight from records of flights, and the flights that do not carry it.

:func:`fit_flight_data` fits (:mod:`rotorid.fitting.flight`), and refuses what no vehicle does: a mean force that the
model misses by a fifth, and fast flight of which the log shows neither velocity nor attitude.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rotorid.data.findings import Finding, refusal
from rotorid.data.quantity import Quantity
from rotorid.errors import InsufficientDataError, ModelError
from rotorid.fits.flight.fitted import FittedFlight, fitted_bounds, fitted_parameters
from rotorid.fitting.flight.fit import FlightChoices, FlightFit, fit_flight
from rotorid.fitting.flight.ladder import LINE
from rotorid.flights.flight_data import FlightMotion, given_spans
from rotorid.flights.tilt_drag import tilt_drag_of
from rotorid.models.flight import FLIGHT_PARAMETERS
from rotorid.models.motors import check_mean_force
from rotorid.settings.motors import MotorSettings
from rotorid.signal.airborne import airborne
from rotorid.uncertainty.flight_error import with_errors
from rotorid.units import STANDARD_GRAVITY_M_S2

_PROGRESS = logging.getLogger("rotorid.progress")

_REMARKABLE_FORCE = 0.06
"""How far the mean thrust of a flight may lie from mass times measured specific force: six flights of up to 2.4 g lay
within 5 %."""

_HEAVIEST_BLIND = 1.15
"""Mean load factor up to which a flight of which neither velocity nor attitude is known counts as one about hover."""


def fit_flight_data(data: FlightMotion, choices: MotorSettings) -> FittedFlight:
    """Fit the physics of flight, and bound it.

    Raises
    ------
    InsufficientDataError
        The flights do not show the thrust of the rotors, the model misses the mean force by a fifth, or the vehicle
        flew fast and neither velocity nor attitude was logged.
    """
    _require_motion(data)
    _PROGRESS.info("fitting force and moment of flight")
    known = {name: value for name, value in choices.known.items() if name != "m"}
    asked = FlightChoices(
        values=known, skews_s=data.skews_s, predictor=choices.predictor, straight=data.motors.straightened
    )
    fit = _fitted(data, asked)
    drag = _drag_by_tilt(data, fit)
    if drag is not None:
        _PROGRESS.info("fitting with the drag that the tilt shows")
        known = {**known, "k_d": coefficient_of(drag, fit).value}
        fit = _fitted(data, replace(asked, values=known))
    by_tilt = None if drag is None else coefficient_of(drag, fit)
    parameters = fitted_parameters(data, fit, choices.known, by_tilt=by_tilt is not None)
    fitted = FittedFlight(
        data=data,
        fit=fit,
        parameters=parameters,
        bounds=fitted_bounds(fit, parameters, by_tilt),
        by_tilt=drag,
    )
    _require_physics(fitted)
    return fitted


def _drag_by_tilt(data: FlightMotion, fit: FlightFit) -> Quantity | None:
    """Drag over mass with the tilt as instrument, where the flights are too slow for a plain fit; else ``None``."""
    if "k_d" not in fit.missing or data.velocity != "measured":
        return None
    try:
        # Of whole flights, as a review has them.
        spans = [(log, spans or airborne(log).intervals) for log, spans in given_spans(data.flights)]
        return tilt_drag_of(spans).drag
    except InsufficientDataError:
        return None


def coefficient_of(drag: Quantity, fit: FlightFit) -> Quantity:
    r"""The coefficient that gives a drag over mass in hover.

    .. math:: k_d = m D / (n \Omega_h)
    """
    factor = fit.airframe.mass_kg / (fit.airframe.rotors * fit.hover.speed)
    return Quantity.normal(factor * drag.value, factor * drag.std, "")


def _fitted(data: FlightMotion, choices: FlightChoices) -> FlightFit:
    """The fit with a curve of outputs, or where that is none of a rotor, with a line of demands or a square of outputs.

    Thrust that falls with the output, or is none at full output, is of a flight whose thrust hardly moved.
    """
    with contextlib.suppress(ModelError):
        fit = _bounded(data, choices)
        if _rises(data, fit):
            return fit
    if choices.straight:
        # The parameters of the autopilot say more of the curve than such a flight.
        with contextlib.suppress(ModelError):
            fit = _bounded(data, replace(choices, values={**LINE, **choices.values}))
            if _rises(data, fit):
                return fit
    square = replace(choices, terms=tuple(name for name in FLIGHT_PARAMETERS if name != "c_1"))
    try:
        return _bounded(data, square)
    except ModelError as error:
        # Rotors that cannot carry the weight.
        message = f"The motors do not explain the force of the flight: {error.came}."
        raise InsufficientDataError(
            error.came,
            needed="motors that explain the measured specific force",
            remedy="check the mass, the layout and the time stamps of the motors",
            findings=[refusal("impossible_physics", "thrust", message), *data.findings],
        ) from error


def _rises(data: FlightMotion, fit: FlightFit) -> bool:
    """Whether thrust rises with the outputs that were flown, and falls with inflow; both are so of every rotor."""
    linear, square = fit.values.get("c_1", 0.0), fit.values.get("c_2", 0.0)
    if linear == 0.0:
        return True
    flown = np.percentile(np.concatenate([record.outputs.ravel() for record in data.records]), (1.0, 99.0))
    rising = bool(np.all(linear + 2.0 * square * flown > 0.0))
    return rising and fit.values.get("c_lambda", 0.0) >= 0.0


def _bounded(data: FlightMotion, choices: FlightChoices) -> FlightFit:
    return with_errors(fit_flight(data.records, data.given.airframe, choices), data.records, choices)


def _require_motion(data: FlightMotion) -> None:
    """Refuse fast flight of which nothing says where it went."""
    if data.velocity != "none":
        return
    loads = np.concatenate([-record.force[2] for record in data.records]) / STANDARD_GRAVITY_M_S2
    load = float(loads.mean())
    if load <= _HEAVIEST_BLIND:
        return
    message = (
        f"The vehicle flew at {load:.2f} g on average, and neither velocity nor attitude is logged: inflow and drag "
        "cannot be separated from thrust."
    )
    raise InsufficientDataError(
        message.rstrip("."),
        needed="velocity or attitude, or flight about hover",
        remedy="log the attitude, or name a calm stretch with --segment",
        findings=[refusal("missing_channel", "velocity, attitude", message, load_factor=load)],
    )


def mean_force_findings(fitted: FittedFlight) -> list[Finding]:
    """Whether the model makes the mean specific force that was measured; remarks from 6 %."""
    total = sum(flown.flight.record.samples for flown in fitted.predicted)
    modeled, measured = (
        -sum(float(rows[2].sum()) for rows in both) / total
        for both in zip(*((flown.modeled, flown.measured) for flown in fitted.predicted), strict=True)
    )
    mass = fitted.data.given.airframe.mass_kg
    return check_mean_force(mass * modeled, mass * measured, mass, tolerance=_REMARKABLE_FORCE)


def _require_physics(fitted: FittedFlight) -> None:
    wrong = list(_impossible(fitted))
    if wrong:
        names = ", ".join(dict.fromkeys(fitted.fit.records))
        raise InsufficientDataError(
            f"the values identified from {names} are not physical: {wrong[0].message.rstrip('.')}",
            needed="motors, gyro and accelerometer on one clock, and the mass and layout of the vehicle that flew",
            remedy="check the mass, the layout and the time stamps of the motors",
            findings=[*wrong, *fitted.data.findings],
        )


def _impossible(fitted: FittedFlight) -> Iterator[Finding]:
    values = fitted.parameters.values
    for name in ("I_xx", "I_yy", "I_zz", "kappa", "J_r"):
        # Spin-up that no flight shows is bounded by zero.
        if values.get(name, 1.0) < 0.0 or (values.get(name) == 0.0 and name != "J_r"):
            message = f"{name} = {values[name]:.3g} {fitted.parameters[name].unit} is not positive."
            yield refusal("impossible_physics", name, message, value=values[name])
    for finding in mean_force_findings(fitted):
        if finding.kind == "impossible_physics":
            yield replace(finding, severity="error")
