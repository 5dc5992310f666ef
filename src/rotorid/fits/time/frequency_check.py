"""Comparison of a fit in time with the responses of the same data: start values and agreement.

Its covariance is none for the fit in time: it weighs frequencies otherwise. Where the two contradict each other, that
is a finding, and the interval reaches as far as the other value: it is unknown which of them is right.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.data.findings import Finding, refusal, warn
from rotorid.data.quantity import significant, with_error
from rotorid.data.trust import CERTAIN_SIGN
from rotorid.errors import InsufficientDataError, ModelError
from rotorid.fits.data_requirements import require_known_gain
from rotorid.fits.frequency.fit import FrequencyFit, fit_with_bounds
from rotorid.fits.frequency.inverse import pose_screened, require_vehicle
from rotorid.fits.scatter import widened
from rotorid.fits.time.fit import TimeFit
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.flights.flights import Flight
from rotorid.flights.measure import Measured, measure
from rotorid.flights.segments import TimeRecords
from rotorid.models.structure import LinearStructure
from rotorid.results.summary import Compared
from rotorid.settings.identifying import IdentifySettings
from rotorid.typing import ComplexArray, FloatArray

_PROGRESS = logging.getLogger("rotorid.progress")


class FrequencySide(NamedTuple):
    """Result of the frequency domain for the same data.

    Parameters
    ----------
    measured
        Responses, or ``None`` where they could not be estimated.
    fitted
        The fit in the frequency domain, or ``None`` where there is none.
    why_not
        Why there is no fit, in words; empty where there is one.
    """

    measured: Measured | None = None
    fitted: FrequencyFit | None = None
    why_not: str = ""


def frequency_side(
    structure: LinearStructure,
    flights: Sequence[Flight],
    settings: IdentifySettings,
    *,
    fits: bool = True,
    searches: bool = False,
) -> FrequencySide:
    """Measure responses and fit them, if the data support that.

    Parameters
    ----------
    structure, flights, settings
        As for :func:`rotorid.identifying.identification.identify`.
    fits
        Whether to fit the structure; one without start values of its own cannot be.
    searches
        Whether the search that the settings ask for belongs here, and not to the fit in time.

    Raises
    ------
    InsufficientDataError
        All that a response shows is the inverse of the controller.
    """
    try:
        measured = measure(flights, inputs=structure.inputs, outputs=structure.outputs, settings=settings)
    except (InsufficientDataError, ModelError) as error:
        return FrequencySide(None, None, error.came.rstrip("."))
    require_vehicle(measured, settings, flights)
    if not fits:
        return FrequencySide(measured)
    try:
        _PROGRESS.info(f"fitting {structure.name} in the frequency domain")
        problem = pose_screened(structure, measured, settings, flights).problem
        own = settings if searches else replace(settings, search=None, evaluations=None, starts="default")
        return FrequencySide(measured, fit_with_bounds(problem, measured, own))
    except (InsufficientDataError, ModelError) as error:
        return FrequencySide(measured, None, error.came.rstrip("."))


def hold_response(omega_rad_s: FloatArray, records: TimeRecords) -> ComplexArray:
    r"""Response of the hold of the inputs, :math:`(1 - e^{-j \omega T}) / (j \omega T)`, shape ``(f,)``.

    It is one for inputs that were joined by lines. Responses between samples contain it. A simulation with held inputs
    has it apart from the model.
    """
    if records.hold == "first":
        return np.ones(omega_rad_s.size, dtype=np.complex128)
    half = 0.5 * omega_rad_s / records.data[0].sample_rate_hz
    return np.asarray(np.sinc(half / np.pi) * np.exp(-1j * half), dtype=np.complex128)


_DISTINCT_SIGMAS = 3.0
"""Combined standard deviations beyond which two methods disagree."""

_CHANCE_SIGMAS = 2.0
"""Those that chance explains."""


def responses_without_hold(
    fitted: TimeFit, frequency: FrequencyFit, records: TimeRecords
) -> tuple[FrequencyProblem, FloatArray]:
    """Responses as a fit in time sees them, without the hold of the inputs, and the values that it found."""
    problem = frequency.problem
    values = {name: fitted.parameters[name].value for name in problem.parameters.free}
    measured = problem.data
    without_hold = replace(measured, values=measured.values / hold_response(measured.omega_rad_s, records))
    return replace(problem, data=without_hold), problem.parameters.with_values(values).pack()


def compare_with(
    frequency: FrequencyFit, structure: LinearStructure, fitted: TimeFit, records: TimeRecords
) -> dict[str, Compared]:
    """Parameters of the frequency-domain fit that the time-domain fit has too.

    A response between samples contains the hold of the inputs, half a step of delay, which a simulation with held
    inputs has apart. That much of a delay is no disagreement.
    """
    half_s = 0.5 / records.data[0].sample_rate_hz if records.hold == "zero" else 0.0
    delays = {str(entry) for entry in structure.input_delays}
    std = frequency.bounds.stds
    return {
        parameter.name: Compared(
            value=parameter.value, std=std.get(parameter.name), hold_s=half_s * (parameter.name in delays)
        )
        for parameter in frequency.parameters
        if parameter.name in fitted.parameters.names and parameter.status != "dropped"
    }


def require_one_gain(fitted: TimeFit, frequency: FrequencyFit | None) -> None:
    """Refuse a model whose gain could as well have the other sign, its distance to that of the responses counted.

    Raises
    ------
    InsufficientDataError
        The gain lies within two standard deviations of zero.
    """
    gain = fitted.problem.structure.gain
    if gain is None or gain not in fitted.bounds.names:
        return
    if frequency is None or gain not in frequency.bounds.names:
        require_known_gain(gain, fitted.parameters, fitted.bounds)
        return
    here, there = fitted.parameters[gain], frequency.parameters[gain]
    std = fitted.bounds.stds[gain]
    if abs(here.value) >= CERTAIN_SIGN * std:
        return
    sentence = (
        f"{gain} is {with_error(here.value, std)} {here.unit} in the time domain but "
        f"{significant(there.value, digits=4)} {here.unit} in the frequency domain"
    )
    others = " or ".join(name for name in ("frequency", "output_error") if name != fitted.method)
    raise InsufficientDataError(
        f"{sentence} of the same flights",
        needed="methods that agree within half of the value",
        remedy=f"try --method {others}, or fix a correlated parameter with --fix NAME=VALUE",
        findings=[
            refusal("not_identifiable", gain, f"{sentence}.", value=here.value, std=std, by_responses=there.value)
        ],
    )


def with_distance(fitted: TimeFit, others: Mapping[str, Compared]) -> TimeFit:
    r"""The fit with intervals that reach to the frequency domain where that contradicts them, and with findings on it.

    Of a distance :math:`d` between values with the combined deviation :math:`\sigma`, chance explains
    :math:`2 \sigma`; the deviation grows by :math:`\sqrt{d^2 - 4 \sigma^2}` in squares, without a jump.

    Parameters
    ----------
    others
        Parameters in the frequency domain, see :func:`compare_with`.
    """
    added = {}
    for name, other in others.items():
        if name in fitted.bounds.names and other.std is not None:
            distance = fitted.parameters[name].value + other.hold_s - other.value
            chance = _CHANCE_SIGMAS**2 * (fitted.bounds.stds[name] ** 2 + other.std**2)
            added[name] = math.sqrt(max(distance**2 - chance, 0.0))
    findings = (*fitted.findings, *judge_agreement(fitted, others))
    return replace(fitted, bounds=widened(fitted.bounds, added), findings=findings)


def judge_agreement(fitted: TimeFit, others: Mapping[str, Compared]) -> tuple[Finding, ...]:
    """A warning for each parameter that time and frequency domain know, and know differently."""
    std = fitted.bounds.stds
    findings = []
    for name, other in others.items():
        if name not in std or other.std is None:
            continue
        value, combined = fitted.parameters[name].value, math.hypot(std[name], other.std)
        distance = abs(value + other.hold_s - other.value) / combined if combined > 0.0 else 0.0
        if distance > _DISTINCT_SIGMAS:
            unit = fitted.parameters[name].unit
            hold_note = (
                f" Of that, {1e3 * other.hold_s:.3g} ms come from the sample-and-hold of the input, which the "
                "response includes."
                if other.hold_s
                else ""
            )
            findings.append(
                warn(
                    "methods_disagree",
                    name,
                    f"{name} is {with_error(value, std[name])} {unit} in the time domain but "
                    f"{with_error(other.value, other.std)} {unit} in the frequency domain, {distance:.1f} "
                    f"standard deviations apart.{hold_note} The two methods weigh missing dynamics differently, "
                    "or feedback biases one of them.",
                    time=value,
                    frequency=other.value,
                    distance_std=distance,
                    hold_s=other.hold_s,
                )
            )
    return tuple(findings)
