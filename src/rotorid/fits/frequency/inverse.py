"""Points of a measured response that show the controller instead of the vehicle: taken out, or the fit refused."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rotorid.data.findings import Finding, Severity, warn
from rotorid.data.response import FrequencyResponse
from rotorid.data.trust import EXCELLENT_COST
from rotorid.errors import InsufficientDataError
from rotorid.fits.data_requirements import require_support
from rotorid.fits.frequency.fit import pose
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.inverse_controller import SubBand, inverse_controller
from rotorid.flights.controllers import LoggedController
from rotorid.flights.flights import Flight
from rotorid.flights.instruments import open_loop
from rotorid.flights.measure import Measured, logged_controllers
from rotorid.models.families import is_rate_model
from rotorid.models.structure import LinearStructure
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.measuring import MeasureSettings
from rotorid.typing import BoolArray, FloatArray

_FED_BACK: Mapping[str, tuple[str, float]] = {
    "roll_command": ("p", 1.0),
    "pitch_command": ("q", 1.0),
    "yaw_command": ("r", 1.0),
    # Thrust acts against gravity, and az points down.
    "thrust_command": ("az", -1.0),
}
"""Input to the output that its innermost loop feeds back, and the sign that makes this feedback negative."""

_VEHICLE_FROM_RAD_S = dict.fromkeys(("p", "q", "r"), 10.0)
"""Above it a rate follows its command by damping, lag and delay alone: below, drag and speed move the vehicle too."""

_NEEDED = "points that show the vehicle, with more excitation than gusts and noise"
_REMEDY = (
    "fly a sweep with the excitation logged (ArduPilot: SYSTEMID mode; PX4: the sticks), larger or in calmer "
    "air, and identify that maneuver"
)
_NOTHING_LEFT = "Nothing is left to fit."
_NOTHING_LEFT_TO_USE = "Nothing usable is left."


@dataclass(frozen=True, kw_only=True, eq=False)
class Screened:
    """A problem without the points that are the inverse of the controller.

    Parameters
    ----------
    problem
        The same problem with the points that are left.
    findings
        ``inverse_controller`` for each response that lost points.
    """

    problem: FrequencyProblem
    findings: tuple[Finding, ...]


class _InversePart(NamedTuple):
    """The part of one response that is the inverse of the controller."""

    output: int
    input: int
    inverse: BoolArray
    bands: tuple[SubBand, ...]


def pose_screened(
    structure: LinearStructure, measured: Measured, settings: IdentifySettings, flights: Sequence[Flight]
) -> Screened:
    """Pose a problem without the points that are the inverse of the controller and not the vehicle.

    Where gusts and not the excitation move the vehicle, an estimate goes to the inverse of the controller with high
    coherence. The response of each input's own rate (of ``az`` for thrust) is tested, direct and joint estimates
    alike: an instrument that contains feedback leads into the same trap. What is found there holds for all outputs of
    that input, because the command itself carries no excitation. Of the rest the longest stretch is kept.

    Parameters
    ----------
    structure
        What would be fitted.
    flights
        Records and maneuvers behind them; gains are read from the parameters of the records.

    Raises
    ------
    InsufficientDataError
        The trusted points, or what is left of them, cannot support the model. Its finding is ``inverse_controller``
        where that is the reason: also where the joint estimate is too poor, and the direct one shows why.
    """
    try:
        problem = pose(structure, measured, settings)
    except InsufficientDataError as error:
        _blame_controller(error, measured, settings, flights)
        raise
    traps = _traps(problem.data, problem.used, flights, measured)
    if not traps:
        return Screened(problem=problem, findings=())
    used = np.array(problem.used)
    for trap in traps:
        for output in range(used.shape[0]):
            used[output, trap.input] = _longest_rest(used[output, trap.input], trap.inverse)
        _require_rest(problem, measured, used, trap, settings)
    findings = tuple(_finding(problem.data, trap, "warning", "It was left out of the fit.") for trap in traps)
    return Screened(problem=replace(problem, used=used), findings=findings)


def without_inverse_controller(
    measured: Measured, used: BoolArray, settings: MeasureSettings, flights: Sequence[Flight]
) -> tuple[BoolArray, tuple[Finding, ...]]:
    """Used points without those that are the inverse of the controller, and the remarks on them.

    For responses without a model: nothing is refused here. A response that loses all of its points has an error among
    the findings. Where a joint estimate is left without any point, the direct one is asked for the reason.

    Parameters
    ----------
    used
        Points that can be trusted otherwise, shape ``(y, u, f)``.
    settings, flights
        See :func:`pose_screened`.
    """
    data = measured.response
    if not used.any() and measured.direct is not None:
        data = measured.direct
        limit = settings.least_coherence(joint=False)
        traps = _traps(data, measured.trusted_points(data, limit), flights, measured)
        return used, tuple(_finding(data, trap, "error", _NOTHING_LEFT_TO_USE) for trap in traps)
    kept, findings = np.array(used), []
    for trap in _traps(data, used, flights, measured):
        for output in range(used.shape[0]):
            kept[output, trap.input] = _longest_rest(used[output, trap.input], trap.inverse)
        gone = not kept[trap.output, trap.input].any()
        consequence = _NOTHING_LEFT_TO_USE if gone else "It was not counted as usable."
        findings.append(_finding(data, trap, "error" if gone else "warning", consequence))
    return kept, tuple(findings)


def require_vehicle(measured: Measured, settings: MeasureSettings, flights: Sequence[Flight]) -> None:
    """Refuse records in which all that a response shows is the inverse of the controller.

    For fits in time, which have no points that could be left out: a model that follows such records is one of the
    controller, whatever its order.

    Parameters
    ----------
    measured, settings, flights
        See :func:`without_inverse_controller`.

    Raises
    ------
    InsufficientDataError
        No usable point of the response of an input's own rate shows the vehicle.
    """
    response = measured.response
    limit = settings.least_coherence(joint=response.estimate == "joint")
    _, findings = without_inverse_controller(measured, measured.trusted_points(response, limit), settings, flights)
    gone = [finding for finding in findings if finding.severity == "error"]
    if gone:
        raise InsufficientDataError(gone[0].message, needed=_NEEDED, remedy=_REMEDY, findings=gone)


def _blame_controller(
    error: InsufficientDataError, measured: Measured, settings: MeasureSettings, flights: Sequence[Flight]
) -> None:
    """Raise the better reason for missing data: no excitation reached the axis, and the controller alone moved it."""
    direct = measured.direct or measured.response
    limit = settings.least_coherence(joint=direct.estimate == "joint")
    used = measured.trusted_points(direct, limit)
    for trap in _traps(direct, used, flights, measured):
        findings = (_finding(direct, trap, "error", _NOTHING_LEFT), *error.findings)
        came = f"{_sentence(direct, trap)} {_NOTHING_LEFT}"
        raise InsufficientDataError(came, needed=_NEEDED, remedy=_REMEDY, findings=findings) from error


def _traps(
    data: FrequencyResponse, used: BoolArray, flights: Sequence[Flight], measured: Measured
) -> list[_InversePart]:
    found = (_find_inverse(data, used, index, flights, measured) for index in range(len(data.inputs)))
    return [trap for trap in found if trap is not None]


def _find_inverse(
    data: FrequencyResponse, used: BoolArray, index: int, flights: Sequence[Flight], measured: Measured
) -> _InversePart | None:
    name = data.inputs[index]
    fed_back, sign = _FED_BACK.get(name, ("", 0.0))
    if fed_back not in data.outputs:
        return None
    output = data.outputs.index(fed_back)
    tested = used[output, index]
    verdict = inverse_controller(
        data.omega_rad_s[tested],
        sign * data.values[output, index, tested],
        data.coherence[output, index, tested],
        controllers=_controllers(flights, measured, name, fed_back),
        # An instrument keeps the controller out, unless it contains feedback itself: which only its own gains may show.
        unknown_gains=data.estimate == "direct",
        vehicle_from_rad_s=_VEHICLE_FROM_RAD_S.get(fed_back, np.inf)
        if data.estimate == "direct" and not open_loop(flights, name)
        else np.inf,
    )
    if not verdict.inverse.any():
        return None
    inverse = np.zeros_like(tested)
    inverse[tested] = verdict.inverse
    return _InversePart(output=output, input=index, inverse=inverse, bands=tuple(b for b in verdict.bands if b.inverse))


def _controllers(
    flights: Sequence[Flight], measured: Measured, name: str, fed_back: str
) -> tuple[LoggedController, ...]:
    """The controllers in the logs, with and without their angle loop: which one flew depends on the flight mode."""
    found = logged_controllers(flights, measured, name, fed_back)
    return tuple(dict.fromkeys(c for controller in found for c in (controller, controller.rate_loop)))


def _longest_rest(used: BoolArray, inverse: BoolArray) -> BoolArray:
    """Of the used points that are not inverse, the longest stretch without an inverse point in between."""
    index = np.flatnonzero(used & ~inverse)
    kept = np.zeros_like(used)
    if index.size:
        stretch = np.cumsum(inverse)[index]
        labels, counts = np.unique(stretch, return_counts=True)
        kept[index[stretch == labels[np.argmax(counts)]]] = True
    return kept


def _require_rest(
    problem: FrequencyProblem, measured: Measured, used: BoolArray, trap: _InversePart, settings: MeasureSettings
) -> None:
    """Refuse where the response that was tested is left with less than a fit needs."""
    data = problem.data
    rest = np.zeros_like(used)
    rest[trap.output, trap.input] = used[trap.output, trap.input]
    limit = settings.least_coherence(joint=data.estimate == "joint")
    rate_model = is_rate_model(problem.structure)
    try:
        require_support(measured, rest, least_coherence=limit, rate_model=rate_model)
    except InsufficientDataError as error:
        left = _left(data.omega_rad_s[rest[trap.output, trap.input]])
        came = f"{_sentence(data, trap)} {left}"
        finding = _finding(data, trap, "error", left)
        raise InsufficientDataError(came, needed=_NEEDED, remedy=_REMEDY, findings=[finding]) from error


def _left(omega_rad_s: FloatArray) -> str:
    if omega_rad_s.size == 0:
        return _NOTHING_LEFT
    return f"The rest, {omega_rad_s[0]:.2g} to {omega_rad_s[-1]:.3g} rad/s, is too little to fit."


def _sentence(data: FrequencyResponse, trap: _InversePart) -> str:
    """Description of the inverse controller, with the evidence."""
    omega, numbers = data.omega_rad_s[trap.inverse], _numbers(data, trap)
    what = "a mixture of the vehicle with the inverse" if all(band.mixed for band in trap.bands) else "the inverse"
    upward = " of the acceleration upward" if _sign(data, trap) < 0.0 else ""
    return (
        f"Between {omega[0]:.2g} and {omega[-1]:.3g} rad/s, {_name(data, trap)} is {what} of the controller "
        f"(about 1/{numbers['gain']:.3g}, phase{upward} {numbers['lowest_phase_deg']:.0f}° to "
        f"{numbers['highest_phase_deg']:.0f}°), not the vehicle: {_evidence(trap)}. Gusts and noise moved the "
        "vehicle there, not the excitation."
    )


def _finding(data: FrequencyResponse, trap: _InversePart, severity: Severity, consequence: str) -> Finding:
    message = f"{_sentence(data, trap)} {consequence} To measure the vehicle, {_REMEDY}."
    found = warn("inverse_controller", _name(data, trap), message, **_numbers(data, trap))
    return replace(found, severity=severity)


def _name(data: FrequencyResponse, trap: _InversePart) -> str:
    return f"{data.outputs[trap.output]}/{data.inputs[trap.input]}"


def _sign(data: FrequencyResponse, trap: _InversePart) -> float:
    return _FED_BACK[data.inputs[trap.input]][1]


def _numbers(data: FrequencyResponse, trap: _InversePart) -> Mapping[str, float]:
    omega, values = data.omega_rad_s[trap.inverse], data.values[trap.output, trap.input, trap.inverse]
    # The inverse of a controller lies around −180°: phases are cut half a turn away from there.
    phases = np.degrees(np.angle(-_sign(data, trap) * values)) - 180.0
    known, fitted = _costs(trap)
    numbers = {
        "low_rad_s": omega[0],
        "high_rad_s": omega[-1],
        "gain": 1.0 / np.median(np.abs(values)),
        "lowest_phase_deg": phases.min(),
        "highest_phase_deg": phases.max(),
        "known_cost": known,
        "fitted_cost": fitted,
    }
    return {name: float(number) for name, number in numbers.items() if np.isfinite(number)}


def _costs(trap: _InversePart) -> tuple[float, float]:
    """Least cost against the gains in the log and against fitted ones."""
    return min(band.known_cost for band in trap.bands), min(band.fitted_cost for band in trap.bands)


def _evidence(trap: _InversePart) -> str:
    known, fitted = _costs(trap)
    if min(known, fitted) >= EXCELLENT_COST:
        vehicle, controller = min(band.vehicle_cost for band in trap.bands), min(known, fitted)
        return f"no vehicle explains it (cost {vehicle:.0f}), but the controller almost does (cost {controller:.0f})"
    if known < EXCELLENT_COST:
        return f"it matches the logged gains (cost {known:.1f})"
    return f"a controller with P, I and D explains it (cost {fitted:.1f})"
