r"""Speed damping in two steps: X_u and Y_v first, from one response each, then the other parameters.

.. math:: \frac{\dot u}{\theta} = \frac{-s g}{s - X_u}, \qquad \frac{\dot v}{\phi} = \frac{s g}{s - Y_v}

Both leave out that a command pushes the vehicle sideways too (X_pitch, Y_roll). Where it does, the damping comes out
several times too small from slow responses and several times too large from fast ones, however good the data are. So
this is an option, and the remark says what it does and how well the first step fits at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from rotorid.data.findings import Finding, warn
from rotorid.data.quantity import with_error
from rotorid.errors import UsageError
from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.fitting.frequency.problem import (
    FrequencyProblem,
)
from rotorid.flights.flights import Flight
from rotorid.flights.measure import measure
from rotorid.models.library import speed_damping
from rotorid.models.structure import LinearStructure
from rotorid.settings.identifying import IdentifySettings
from rotorid.uncertainty.cramer_rao import (
    bounds,
)

FIRST_RESPONSES = {"X_u": ("u_dot", "theta", "pitch"), "Y_v": ("v_dot", "phi", "roll")}

_NEGLECTED = {"X_u": "X_pitch", "Y_v": "Y_roll"}


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
        Choices of the run; bands and instruments are those of the second step and not used here.

    Raises
    ------
    UsageError
        The structure has neither parameter.
    InsufficientDataError
        A channel is missing, or the response is not coherent.
    """
    names = [name for name in FIRST_RESPONSES if name in structure.parameters.free]
    if not names:
        raise UsageError(
            f"{structure.name} has neither a free X_u nor a free Y_v for --speed-damping two_step",
            needed="a model with one of them, such as hover.longitudinal",
        )
    found = {name: _speed_damping_of(name, flights, settings) for name in names}
    return FirstStep(
        fix={name: value for name, (value, _) in found.items()}, findings=tuple(f for _, f in found.values())
    )


def _speed_damping_of(name: str, flights: Sequence[Flight], settings: IdentifySettings) -> tuple[float, Finding]:
    output, source, axis = FIRST_RESPONSES[name]
    own = [flight for flight in flights if flight.axis == axis] or list(flights)
    plain = replace(
        settings, instruments=(), estimate="direct", pairs={}, pair_weights={}, shifts={}, correct_filters=False
    )
    measured = measure(own, inputs=(source,), outputs=(output,), settings=plain)
    structure = speed_damping(output, source)
    used = measured.trusted_points(measured.response, plain.least_coherence(joint=False))
    problem = FrequencyProblem(structure=structure, parameters=structure.parameters, data=measured.response, used=used)
    solution = fit_frequency(problem)
    value, std = float(solution.theta[0]), float(bounds(problem, solution).std[0])
    cost = float(problem.costs(solution.theta)[0, 0])
    omega = measured.response.omega_rad_s[used[0, 0]]
    return value, warn(
        "speed_damping_biased",
        name,
        f"{name} = {with_error(value, std)} 1/s was estimated from {output}/{source} between {omega[0]:.2g} and "
        f"{omega[-1]:.3g} rad/s (cost {cost:.0f}) and then fixed. This neglects {_NEGLECTED[name]}: if the "
        f"command pushes the vehicle sideways, {name} is wrong by a factor, too small from slow responses and "
        "too large from fast ones. The joint fit of all responses has no such bias.",
        value=value,
        std=std,
        cost=cost,
        low_rad_s=float(omega[0]),
        high_rad_s=float(omega[-1]),
    )
