r"""Predicted standard deviations of every parameter, before the flight.

The expected response goes the way of a measured one: the structure is fitted to it at the points that will be usable,
with the weights that will be used. What an identification will state, random and model error, its own functions say
(:mod:`rotorid.planning.systematic`). Two numbers stand beside
each standard deviation: how far estimates of the same plan scatter from flight to flight, which leaves out what is the
same in all of them, and what no estimate from the same test inputs can fall below (Cramér and Rao),

.. math:: F_{ij} = 4 \int \mathrm{Re} \left[ \left(\frac{\partial G}{\partial \theta_i} U\right)^H S_{vv}^{-1}
    \frac{\partial G}{\partial \theta_j} U \right] df, \qquad U = T E R

over the fitted band, with the transforms R of the whole records and the one-sided density of the disturbances.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.findings import Finding
from rotorid.data.flight_plan import FlightPlan
from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.fitting.frequency.problem import FrequencyProblem, residual_errors
from rotorid.fitting.least_squares import Solution
from rotorid.fitting.problem import ResidualErrors
from rotorid.models.structure import LinearStructure, connected
from rotorid.planning.expected import (
    ExpectedFit,
    FitSettings,
    Planned,
    as_planned,
    excited_channels,
    expected_fit,
    expected_response,
    loop_rows,
    usable,
)
from rotorid.planning.loop import LoopModel
from rotorid.planning.remarks import remarks, require_inside, require_octave
from rotorid.planning.systematic import KnownErrors, stated_bounds
from rotorid.spectral.windows import grid_rad_s
from rotorid.typing import Axis, BoolArray, ComplexArray, FloatArray
from rotorid.uncertainty.cramer_rao import Bounds, Weights

_LEAST_NOISE = 1e-12
"""Of the noise of all outputs: one that is the integral of another errs alike."""

_LEAST_DENSITY = 1e-20
"""In units of an output squared and per Hz: no sensor is quieter, and a loop without noise has an answer too."""


def fisher_information(problem: FrequencyProblem, theta: FloatArray, loop: LoopModel, planned: Planned) -> FloatArray:
    r"""Information about the free parameters that the test inputs bring into the records, shape ``(p, p)``.

    .. math:: F_{ij} = 4 \int \mathrm{Re} \left[ \left(\frac{\partial G}{\partial \theta_i} U\right)^H S_{vv}^{-1}
        \frac{\partial G}{\partial \theta_j} U \right] df

    over the fitted band, with the transforms U of the commands without noise over whole records. What gusts and noise
    move the commands by is not counted: no instrument sees it.

    Parameters
    ----------
    problem, theta
        Structure, free parameters and points, and where to take the derivatives.
    loop, planned
        What will fly, and what.
    """
    omega = problem.data.omega_rad_s[problem.used.any(axis=(0, 1))]
    parameters = problem.parameters.unpack(theta)
    total = np.zeros((theta.size, theta.size))
    for record in planned.records():
        count = record.values.shape[1]
        line_hz = record.sample_rate_hz / count
        bins = 2.0 * np.pi * line_hz * np.arange(count // 2 + 1)
        inside = (bins >= omega[0]) & (bins <= omega[-1])
        flown = np.fft.rfft(record.values - record.values.mean(axis=1, keepdims=True), axis=1) / record.sample_rate_hz
        excited = excited_channels(loop, planned, bins[inside], problem.data.inputs)
        commands = np.einsum("usf,sf->uf", excited, flown[:, inside])
        _, slopes = problem.structure.response_and_jacobian(parameters.values, bins[inside], parameters.directions)
        moved = np.einsum("pyuf,uf->fyp", slopes, commands)
        noise = open_loop_noise(loop, planned, bins[inside], problem.data.inputs, problem.data.outputs)
        weighted = np.linalg.solve(noise, moved)
        total += 4.0 * line_hz * np.einsum("fyp,fyq->pq", moved.conj(), weighted).real
    return total


def open_loop_noise(
    loop: LoopModel, planned: Planned, omega_rad_s: FloatArray, inputs: tuple[str, ...], outputs: tuple[str, ...]
) -> ComplexArray:
    """Densities of the outputs beside their responses to the inputs, as they are logged, shape ``(f, y, y)``.

    The responses are those that instruments show, with the loops closed that other commands close.
    """
    chosen = loop_rows(loop, (*inputs, *outputs))
    excited = np.moveaxis(excited_channels(loop, planned, omega_rad_s, (*inputs, *outputs)), -1, 0)
    moved, measured = np.split(excited[:, :, : len(inputs)], [len(inputs)], axis=1)
    response = measured @ np.linalg.inv(moved)
    own = np.broadcast_to(np.eye(len(outputs)), (omega_rad_s.size, len(outputs), len(outputs)))
    mix = np.concatenate([-response, own], axis=2)
    logged = np.moveaxis(loop.logged_noise(omega_rad_s)[np.ix_(chosen, chosen)], -1, 0)
    noise = mix @ logged @ mix.conj().swapaxes(1, 2)
    floor = _LEAST_NOISE * np.trace(noise, axis1=1, axis2=2).real[:, None, None] + _LEAST_DENSITY
    return np.asarray(noise + floor * np.eye(len(outputs)))


def scattering_errors(problem: FrequencyProblem, loop: LoopModel, planned: Planned) -> ResidualErrors:
    """Errors of the residuals by what gusts and noise alone do to the response, leakage left out.

    Parameters
    ----------
    problem
        The expected response, and its points that are fitted.
    loop, planned
        What will fly, and what.
    """
    data = problem.data
    assert data.disturbance is not None
    noise = np.moveaxis(open_loop_noise(loop, planned, data.omega_rad_s, data.inputs, data.outputs), 0, -1)
    level = np.sqrt(np.einsum("yyf->yf", noise).real)
    factor = (level / np.sqrt(data.disturbance.level))[:, None, :]
    scattered = replace(
        data,
        covariance=data.covariance * factor[..., :, None] * factor[..., None, :],
        output_correlation=np.stack([noise / level[:, None] / level[None, :]] * len(data.inputs)),
    )
    return residual_errors(scattered, problem.used, problem.point_scales)


def expected_scatter(
    problem: FrequencyProblem, solution: Solution, weights: Weights, scattering: ResidualErrors
) -> FloatArray:
    r"""Standard deviations of the estimates over many flights of one plan, shape ``(p,)``.

    An identification includes the leakage of its windows, too, since in one flight it cannot be separated from
    noise. Of one plan it is the same in every flight: it moves the estimates, and does not scatter them. With the
    errors e that gusts and noise alone make, and the weights of the fit,

    .. math:: \mathrm{Cov}\,\theta = K \, \mathrm{Cov}(e) \, K^T, \qquad
        \delta\theta = -K e

    Parameters
    ----------
    problem, solution, weights
        The fit to the expected response.
    scattering
        Of :func:`scattering_errors`.
    """
    if weights == "cifer":
        gain = _least_squares_inverse(solution.jacobian)
    else:
        stated = problem.errors_about(solution.theta)
        _, slopes = problem.residuals(solution.theta)
        gain = _least_squares_inverse(stated.whitened(slopes)) @ stated.whitened(np.eye(len(slopes)))
    return np.asarray(np.sqrt(np.einsum("pn,nm,pm->p", gain, scattering.covariance, gain, optimize=True)))


def _least_squares_inverse(jacobian: FloatArray) -> FloatArray:
    """What takes residuals to parameters, shape ``(p, n)``; columns of unit length make parameters comparable."""
    length = np.linalg.norm(jacobian, axis=0)
    return np.asarray(np.linalg.pinv(jacobian / length) / length[:, None])


@dataclass(frozen=True, kw_only=True)
class PredictedParameter:
    """The predicted estimate of a parameter.

    Parameters
    ----------
    name, unit
        Its symbol and SI unit.
    value
        As it was given.
    expected
        Where the fit will end but for chance: elsewhere if feedback biases the estimate or the structure leaves out a
        part of what the loop does.
    std, std_random
        One standard deviation as the identification will state it, random and model error together, and its random
        part.
    scatter
        Standard deviation of the estimates over many flights of this plan: smaller, as leakage and a structure that
        does not fit are the same in each of them, and move all estimates to ``expected``. Of several outputs fitted
        together it comes out a fifth too small.
    cramer_rao, insensitivity
        CIFER's bounds, in the unit of the parameter.
    lowest_std
        What no estimate from the same test inputs in the fitted band falls below.
    """

    name: str
    unit: str
    value: float
    expected: float
    std: float
    std_random: float
    scatter: float
    cramer_rao: float
    insensitivity: float
    lowest_std: float

    @property
    def off_sigmas(self) -> float:
        """How far the fit will end from the value, in standard deviations as stated."""
        return abs(self.expected - self.value) / self.std if self.std > 0.0 else 0.0

    @property
    def std_model(self) -> float:
        """The part of model errors and clocks in the standard deviation."""
        return math.sqrt(max(self.std**2 - self.std_random**2, 0.0))

    @property
    def percent(self) -> float:
        """The standard deviation in percent of the value as it was given; infinite for a value of zero."""
        return self.in_percent(self.std)

    @property
    def cramer_rao_percent(self) -> float:
        """CIFER's bound in percent of the expected estimate, as an identification states it; infinite for a zero."""
        return 100.0 * self.cramer_rao / abs(self.expected) if self.expected and self.value else np.inf

    @property
    def insensitivity_percent(self) -> float:
        """CIFER's insensitivity in percent of the expected estimate; infinite for a zero."""
        return 100.0 * self.insensitivity / abs(self.expected) if self.expected and self.value else np.inf

    def in_percent(self, number: float) -> float:
        """A number in percent of the value."""
        return 100.0 * number / abs(self.value) if self.value else np.inf


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction(Immutable):
    """The prediction of a planned flight.

    Parameters
    ----------
    plan
        Its name.
    duration_s
        Its length.
    parameters
        Those that the fit will keep, in the order of the structure.
    covariance
        Of these parameters, shape ``(p, p)``.
    inflation
        Factor on the standard deviations, in the geometric mean, that comes of model errors and clocks.
    model_error
        What the structure misses in each response ``output/input``, relative; where responses are fitted.
    response
        The expected response with coherence and random error.
    used
        Points that will be usable, shape ``(y, u, f)``.
    findings
        What an identification would remark, before the flight.
    """

    plan: str
    duration_s: float
    parameters: tuple[PredictedParameter, ...]
    covariance: FloatArray
    inflation: float
    response: FrequencyResponse
    used: BoolArray
    findings: tuple[Finding, ...] = field(default=())
    model_error: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(
            model_error=self.model_error,
            parameters=tuple(self.parameters),
            covariance=read_only(self.covariance, np.float64, ndim=2),
            used=read_only(self.used, np.bool_, ndim=3),
            findings=tuple(self.findings),
        )

    def __getitem__(self, name: str) -> PredictedParameter:
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        raise KeyError(f"no parameter {name!r}; there are {', '.join(parameter.name for parameter in self.parameters)}")

    @property
    def correlation(self) -> FloatArray:
        """Correlation of the estimates, shape ``(p, p)``."""
        std = np.sqrt(np.diag(self.covariance))
        return np.asarray(self.covariance / np.outer(std, std))


def predict(
    structure: LinearStructure,
    values: Mapping[str, float],
    loop: LoopModel,
    plan: FlightPlan,
    *,
    choices: FitSettings | None = None,
    known_errors: KnownErrors | None = None,
) -> Prediction:
    """Say before a flight how well its identification will know every parameter.

    Parameters
    ----------
    structure
        What will be fitted; parameters that are fixed, tied or dropped stay so.
    values
        What its parameters are expected to be: all that are free.
    loop
        What will fly, with the disturbances and noises that it will meet. It need not be of that structure.
    plan
        The test inputs.
    choices
        How the flight will be identified.
    known_errors
        What a rehearsal and previous results know of systematic errors; without them clocks and the floor alone count.

    Raises
    ------
    InsufficientDataError
        The flight could not support the model, or a parameter ends on its bound; the findings say why.
    UsageError
        A value is missing, or loop, plan and structure do not fit each other.

    Notes
    -----
    Assumes a loop that is linear, stable and stationary: gusts that come and go, saturation and a vehicle that changes
    in flight are not in it. Weak instruments, with a coherence below some 0.3, scatter more than any linear formula
    says. Over simulated flights the stated standard deviations of rate models came out within 10 % of the predicted
    ones, those of hover models within 40 % and mostly within 15 %.

    References
    ----------
    Ljung, *System Identification: Theory for the User*, section 9.4, on covariance in the frequency domain.

    Examples
    --------
    >>> from rotorid.planning.loop import axis_loop
    >>> from rotorid.planning.loop import White
    >>> from rotorid.excitation.plan import planned, sequence
    >>> from rotorid.models.library import rate_model
    >>> roll, truth = rate_model("rate.roll"), {"L_roll": 80.0, "L_p": -4.0, "T_motor": 0.05, "tau_roll": 0.006}
    >>> loop = axis_loop(roll, truth, None, White(std=(0.1,), sample_rate_hz=200.0))
    >>> sweep = planned("roll", "pilot_sweep", start_s=0.0, amplitude=0.1, duration_s=60.0, sample_rate_hz=200.0,
    ...                 band_rad_s=(1.0, 50.0))
    >>> found = predict(roll, truth, loop, sequence("a minute", [sweep]))
    >>> round(found["L_roll"].percent, 1), round(found["tau_roll"].percent)
    (1.0, 22)
    """
    choices, known_errors = choices or FitSettings(), known_errors or KnownErrors()
    structure = _scoped(structure, loop, plan, choices)
    _require_values(structure, values)
    known = {p.name: values[p.name] for p in structure.parameters if p.status == "free"}
    parameters = structure.parameters.with_values(known)
    axes: tuple[Axis, ...] = tuple(_axis(name) for name in structure.inputs)
    planned = as_planned(plan, axes, loop.log_rate_hz, declared=loop.declared, alone=loop.alone)
    band = choices.band_rad_s or planned.band_rad_s
    windows = planned.windows(band, choices.windows_s)
    response = expected_response(
        loop,
        planned,
        inputs=structure.inputs,
        outputs=structure.outputs,
        omega_rad_s=grid_rad_s(band, windows),
        windows_s=windows.lengths_s,
        joint=choices.joint,
    )
    used = usable(response, planned, axes, band, choices)
    require_octave(response, used, choices.least_coherence)
    posed = FrequencyProblem(structure=structure, parameters=parameters, data=response, used=used)
    ended = expected_fit(posed, choices)
    require_inside(ended.problem.parameters, ended.solution)
    scattering = scattering_errors(ended.problem, loop, planned)
    limits = stated_bounds(ended, scattering, known_errors)
    information = fisher_information(ended.problem, ended.solution.theta, loop, planned)
    lowest = np.sqrt(np.diag(_inverse(information)))
    scatter = expected_scatter(ended.problem, ended.solution, ended.weights, scattering)
    return Prediction(
        plan=plan.name,
        duration_s=plan.duration_s,
        parameters=_parameters(ended, limits, values, lowest, scatter),
        covariance=limits.covariance,
        inflation=limits.inflation,
        response=response,
        used=ended.problem.used,
        model_error=limits.model_error.deviations if limits.model_error is not None else {},
        findings=(
            *windows.findings,
            *remarks(ended.problem, ended.solution, limits, values, band, ended.dropped),
        ),
    )


def _scoped(structure: LinearStructure, loop: LoopModel, plan: FlightPlan, choices: FitSettings) -> LinearStructure:
    """The part of a structure that the loop has and the plan excites."""
    inputs = [name for name in structure.inputs if name in loop.inputs and _axis(name) in plan.axes]
    outputs = [name for name in choices.outputs or structure.outputs if choices.outputs or name in loop.outputs]
    if not inputs or not outputs:
        raise UsageError(
            f"{structure.name} leads from {', '.join(structure.inputs)} to {', '.join(structure.outputs)}, the plan "
            f"{plan.name} excites {', '.join(plan.axes)}, and {loop.name} has the outputs {', '.join(loop.outputs)}",
            needed="an excited input and an existing output",
        )
    return connected(structure.select(inputs=inputs, outputs=outputs))


def _axis(command: str) -> Axis:
    return command.removesuffix("_command")  # type: ignore[return-value]


def _require_values(structure: LinearStructure, values: Mapping[str, float]) -> None:
    if missing := [name for name in structure.parameters.free if name not in values]:
        raise UsageError(
            f"missing values of {', '.join(missing)}",
            needed=f"a value for each free parameter of {structure.name}",
            remedy="give them, or fix or drop the parameters",
        )


def _parameters(
    ended: ExpectedFit, limits: Bounds, values: Mapping[str, float], lowest: FloatArray, scatter: FloatArray
) -> tuple[PredictedParameter, ...]:
    problem, theta = ended.problem, ended.solution.theta
    return tuple(
        PredictedParameter(
            name=name,
            unit=problem.parameters[name].unit,
            value=float(values[name]),
            expected=float(theta[row]),
            std=float(limits.std[row]),
            std_random=float(limits.random_std[row]),
            scatter=float(scatter[row]),
            cramer_rao=float(limits.cramer_rao[row]),
            insensitivity=float(limits.insensitivity[row]),
            lowest_std=float(lowest[row]),
        )
        for row, name in enumerate(limits.names)
    )


def _inverse(information: FloatArray) -> FloatArray:
    """Inverse of an information matrix whose parameters have any units."""
    scale = np.sqrt(np.diag(information))
    scale = np.where(scale > 0.0, scale, 1.0)
    return np.asarray(np.linalg.pinv(information / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale))
