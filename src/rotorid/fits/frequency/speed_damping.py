r"""Speed damping in two steps: X_u and Y_v first, from the motion along one axis, then the other parameters.

.. math:: \frac{\dot u}{\theta} = \frac{-s g}{s - X_u}, \qquad \frac{\dot v}{\phi} = \frac{s g}{s - Y_v}

Both leave out that a command pushes the vehicle sideways too (X_pitch, Y_roll). Where it does, the damping comes out
several times too small from slow responses and several times too large from fast ones, however good the data are. So
this is an option, its cost must be acceptable, and the remark says what it neglects.

With the force of the command and the rate in it, the equation of motion along one axis is complete,

.. math:: (s - X_u) \frac{\dot u}{\delta} = s \left( -g + X_q s \right) \frac{\theta}{\delta}
          + s X_{pitch} e^{-\tau s},

between two measured responses to the command, with the other commands that were flown as inputs too: feedback moves
them with the sweep. It has no such bias: on flights of a published vehicle in gusts, whose
X_u is -0.25, it finds -0.25 over every band.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rotorid.data.findings import Finding, refusal, remark, warn
from rotorid.data.quantity import with_error
from rotorid.data.record import AXES
from rotorid.data.trust import ACCEPTABLE_COST
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.fitting.frequency.problem import FrequencyProblem, pair_costs, point_weights, within_bands
from rotorid.fitting.problem import Part
from rotorid.flights.flights import Flight
from rotorid.flights.measure import Measured, measure
from rotorid.models.library import speed_damping
from rotorid.models.structure import LinearStructure
from rotorid.settings.identifying import FIRST_RESPONSES, IdentifySettings
from rotorid.typing import BoolArray, ComplexArray, FloatArray
from rotorid.uncertainty.cramer_rao import bounds
from rotorid.uncertainty.model_error import SMALLEST_MODEL_ERROR
from rotorid.uncertainty.sandwich import by_lines
from rotorid.units import STANDARD_GRAVITY_M_S2

_ROWS = {"X_u": ("pitch", -1.0, "X_pitch", "X_q"), "Y_v": ("roll", 1.0, "Y_roll", "Y_p")}
"""Axis, sign of gravity, force of the command and of the rate in the equation of each speed."""

_DELAY_S = 0.03
_LONGEST_DELAY_S = 0.3


@dataclass(frozen=True, kw_only=True)
class FirstStep:
    """Result of the first step: parameters to fix, with a finding on each."""

    fix: dict[str, float]
    findings: tuple[Finding, ...]


def first_step(structure: LinearStructure, flights: Sequence[Flight], settings: IdentifySettings) -> FirstStep:
    """X_u and Y_v, if the structure has them, each from the sweeps of its own axis.

    Parameters
    ----------
    structure
        What will be fitted in the second step.
    flights
        Maneuvers; attitude and acceleration along the body must be logged or follow from what is.
    settings
        Choices of the run. Of its responses only ``u_dot/theta`` and ``v_dot/phi`` concern this step.

    Raises
    ------
    UsageError
        The structure has neither parameter.
    InsufficientDataError
        A channel is missing, the response is not coherent, or its cost is above 100.
    """
    names = [name for name in FIRST_RESPONSES if name in structure.parameters.free]
    if not names:
        raise UsageError(
            f"{structure.name} has neither a free X_u nor a free Y_v for --speed-damping {settings.speed_damping}",
            needed="a model with one of them, such as hover.longitudinal",
        )
    of = _with_force if settings.speed_damping == "two_step_force" else _of_one_response
    found = {name: of(name, structure.inputs, flights, settings) for name in names}
    return FirstStep(
        fix={name: value for name, (value, _) in found.items()}, findings=tuple(f for _, f in found.values())
    )


def without_first(pairs: Mapping[str, tuple[float, float] | None]) -> dict[str, tuple[float, float] | None]:
    """The chosen responses of the second step."""
    first = {"/".join(response) for response in FIRST_RESPONSES.values()}
    return {name: band for name, band in pairs.items() if name not in first}


def _of_axes(axes: Sequence[str], flights: Sequence[Flight]) -> list[Flight]:
    """Maneuvers of these axes, or all where none is."""
    return [flight for flight in flights if flight.axis in axes] or list(flights)


def _plain(settings: IdentifySettings) -> IdentifySettings:
    """The choices without those of the second step."""
    return replace(settings, instruments=(), pairs={}, pair_weights={}, shifts={}, correct_filters=False)


def _trusted(measured: Measured, name: str, settings: IdentifySettings) -> BoolArray:
    """Trusted points of all responses, within the band that was chosen for the first step, shape ``(y, u, f)``."""
    data = measured.response
    used = measured.trusted_points(data, settings.least_coherence(joint=data.estimate == "joint"))
    band = settings.pairs.get("/".join(FIRST_RESPONSES[name]))
    if band is None:
        return used
    every = {f"{output}/{source}": band for output in data.outputs for source in data.inputs}
    return within_bands(used, data, every)


def _of_one_response(
    name: str,
    inputs: Sequence[str],  # noqa: ARG001 - as with the force of the command
    flights: Sequence[Flight],
    settings: IdentifySettings,
) -> tuple[float, Finding]:
    output, source = FIRST_RESPONSES[name]
    own, alone = _of_axes((_ROWS[name][0],), flights), replace(_plain(settings), estimate="direct")
    measured = measure(own, inputs=(source,), outputs=(output,), settings=alone)
    structure = speed_damping(output, source)
    used = _trusted(measured, name, settings)
    problem = FrequencyProblem(structure=structure, parameters=structure.parameters, data=measured.response, used=used)
    solution = fit_frequency(problem)
    value, std = float(solution.theta[0]), float(bounds(problem, solution).std[0])
    cost = float(problem.costs(solution.theta)[0, 0])
    omega = measured.response.omega_rad_s[used[0, 0]]
    force = _ROWS[name][2]
    _require_acceptable(name, cost, omega, f"use --speed-damping two_step_force, which includes {force}, or joint")
    return value, warn(
        "speed_damping_biased",
        name,
        f"{name} = {with_error(value, std)} 1/s was estimated from {output}/{source} between {omega[0]:.2g} and "
        f"{omega[-1]:.3g} rad/s (cost {cost:.0f}) and then fixed. This neglects {force}: if the "
        f"command pushes the vehicle sideways, {name} is wrong by a factor, too small from slow responses and "
        "too large from fast ones. The joint fit of all responses has no such bias.",
        value=value,
        std=std,
        cost=cost,
        low_rad_s=float(omega[0]),
        high_rad_s=float(omega[-1]),
    )


def _require_acceptable(name: str, cost: float, omega_rad_s: FloatArray, remedy: str) -> None:
    if cost <= ACCEPTABLE_COST:
        return
    output, source = FIRST_RESPONSES[name]
    message = (
        f"{output}/{source} between {omega_rad_s[0]:.2g} and {omega_rad_s[-1]:.3g} rad/s does not show {name}: "
        f"the cost is {cost:.0f}"
    )
    raise InsufficientDataError(
        message,
        needed=f"a cost of at most {ACCEPTABLE_COST:g}",
        remedy=f"{remedy}, or another band with --pair {output}/{source}:LO:HI",
        findings=[refusal("poor_fit", name, f"{message}; at most {ACCEPTABLE_COST:g} is acceptable.", cost=cost)],
    )


class _Row(NamedTuple):
    """Measured responses in the equation of one speed, at the same frequencies, shape ``(f,)`` each."""

    s: ComplexArray
    speed: ComplexArray
    angle: ComplexArray
    error: FloatArray
    gravity: float

    def predicted(self, theta: FloatArray) -> ComplexArray:
        """Response of the acceleration that the equation makes of that of the attitude."""
        damping, of_rate, force, delay_s = theta
        pushed = (self.gravity + of_rate * self.s) * self.angle + force * np.exp(-self.s * delay_s)
        return np.asarray(self.s * pushed / (self.s - damping))

    def residual(self, theta: FloatArray) -> FloatArray:
        off = np.log(self.predicted(theta) / self.speed) / self.error
        return np.concatenate([off.real, off.imag])


def _with_force(
    name: str, inputs: Sequence[str], flights: Sequence[Flight], settings: IdentifySettings
) -> tuple[float, Finding]:
    from scipy.optimize import least_squares

    output, source = FIRST_RESPONSES[name]
    axis, sign, force, of_rate = _ROWS[name]
    # Feedback moves the other commands with the sweep, and what they do is no answer to this one.
    flown = {flight.axis for flight in flights}
    axes = (axis, *(other for other in AXES if other in flown - {axis} and f"{other}_command" in inputs))
    axes = axes if axis in flown else (axis,)
    commands = tuple(f"{one}_command" for one in axes)
    measured = measure(_of_axes(axes, flights), inputs=commands, outputs=(output, source), settings=_plain(settings))
    data, used = measured.response, _trusted(measured, name, settings)
    known = used[:, 0].all(axis=0)
    omega = data.omega_rad_s[known]
    if omega.size < 4:
        raise InsufficientDataError(
            f"{output} and {source} over {axis}_command share {omega.size} trusted frequencies",
            needed=f"at least 4 for {name}, {of_rate}, {force} and a delay",
            remedy="widen the band, or use --speed-damping joint",
        )
    row = _Row(
        s=np.asarray(1j * omega, dtype=np.complex128),
        speed=data.values[0, 0, known],
        angle=data.values[1, 0, known],
        error=np.hypot(np.linalg.norm(data.random_error[:, 0, known], axis=0), SMALLEST_MODEL_ERROR),
        gravity=sign * STANDARD_GRAVITY_M_S2,
    )
    found = least_squares(
        row.residual,
        [-0.2, 0.0, 5.0 * sign, _DELAY_S],
        bounds=([-np.inf, -np.inf, -np.inf, 0.0], [0.0, np.inf, np.inf, _LONGEST_DELAY_S]),
        x_scale=[0.1, 0.1, 1.0, 0.01],
    )
    variance = _variance(np.asarray(found.jac, dtype=np.float64), found.fun, omega)
    value, std = float(found.x[0]), float(np.sqrt(variance[0]))
    weights = point_weights(data, used)[:1, :1, known]
    cost = float(pair_costs(row.predicted(found.x)[None, None], row.speed[None, None], weights)[0, 0])
    _require_acceptable(name, cost, omega, "use --speed-damping joint")
    return value, remark(
        "speed_damping_first",
        name,
        f"{name} = {with_error(value, std)} 1/s was estimated from {output} and {source} over {axis}_command between "
        f"{omega[0]:.2g} and {omega[-1]:.3g} rad/s, with {force} and {of_rate} (cost {cost:.0f}), and then fixed.",
        value=value,
        std=std,
        cost=cost,
        low_rad_s=float(omega[0]),
        high_rad_s=float(omega[-1]),
    )


def _variance(slopes: FloatArray, residual: FloatArray, omega_rad_s: FloatArray) -> FloatArray:
    """By the stated errors, or where it is more by how bands of half an octave pull, shape ``(p,)``."""
    # Neighbors share windows, so their errors are no independent ones.
    part = Part(residual[:, None], slopes[:, None, :], np.zeros((residual.size, 1, 0)))
    of_bands = by_lines([part], [omega_rad_s]).diagonal()
    return np.asarray(np.maximum(np.linalg.pinv(slopes.T @ slopes).diagonal(), of_bands))
