"""Easy and hard problems for global searches: simulated data with noise, a known truth, and a stated box.

Every seed draws its own noise, so that a search without anything random has a rate of success too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from rotorid.data import FrequencyResponse
from rotorid.fitting import (
    FrequencyProblem,
    LevenbergMarquardt,
    Scale,
    Solution,
    StartBox,
    TimeData,
    TimeProblem,
    fit_frequency,
    own_starts,
)
from rotorid.fitting import Problem as AnyProblem
from rotorid.models import LinearStructure, ParameterSet, from_toml, library_model, rate_model
from rotorid.search import AccelerationProblem, hover_parameters
from rotorid.simulation import simulate_linear
from rotorid.typing import FloatArray
from rotorid.vehicles import hover_quadrotor, s500

NOISE = 0.05
"""Relative error of real and imaginary part of a response at each frequency."""

Side = tuple[float, float, Scale]
LOGARITHMIC: Scale = "logarithmic"
LINEAR: Scale = "linear"


class Posed(NamedTuple):
    """A problem with the data of one seed.

    Parameters
    ----------
    problem
        What is searched.
    truth
        Parameters behind the data, shape ``(p,)``.
    own
        The package's own starts: the lowest cost they lead to, and the residuals with Jacobians they take.
    """

    problem: AnyProblem
    truth: FloatArray
    own: Callable[[], tuple[float, int]]


class Problem(NamedTuple):
    """A problem for every seed, and what it is about."""

    title: str
    pose: Callable[[int], Posed]


@dataclass(frozen=True, kw_only=True)
class Counted(LevenbergMarquardt):
    """The local search of a fit, whose residuals are counted over all starts."""

    ends: list[Solution] = field(default_factory=list)

    def minimize(self, *given: Any, **options: Any) -> Solution:
        end = LevenbergMarquardt.minimize(self, *given, **options)
        self.ends.append(end)
        return end


def _box(sides: Mapping[str, Side], parameters: ParameterSet) -> StartBox:
    lower, upper, scales = zip(*(sides[name] for name in parameters.free), strict=True)
    return StartBox(lower=np.array(lower), upper=np.array(upper), scales=scales)


def _response(
    structure: LinearStructure,
    truth: Mapping[str, float],
    omega_rad_s: FloatArray,
    sides: Mapping[str, Side],
    seed: int,
    parameters: ParameterSet | None = None,
) -> Posed:
    exact = structure.response(truth, omega_rad_s)
    rng = np.random.default_rng(seed)
    noise = NOISE * (rng.standard_normal(exact.shape) + 1j * rng.standard_normal(exact.shape))
    data = FrequencyResponse(
        omega_rad_s=omega_rad_s,
        values=exact * (1.0 + noise),
        coherence=np.full(exact.shape, 0.95),
        random_error=np.full(exact.shape, NOISE),
        covariance=np.zeros((*exact.shape, omega_rad_s.size)),
        inputs=structure.inputs,
        outputs=structure.outputs,
        estimate="direct",
    )
    parameters = parameters or structure.parameters
    problem = FrequencyProblem(
        structure=structure, parameters=parameters, data=data, used=np.ones(exact.shape, dtype=np.bool_)
    )

    def own() -> tuple[float, int]:
        solver = Counted()
        return fit_frequency(problem, solver=solver).cost, sum(end.evaluations for end in solver.ends)

    return Posed(problem.within(_box(sides, parameters)), np.array([truth[name] for name in parameters.free]), own)


RATE_TRUTH = {"L_roll": 60.0, "L_p": -2.0, "T_motor": 0.05, "tau_roll": 0.012}
RATE_SIDES: Mapping[str, Side] = {
    "L_roll": (5.0, 500.0, LOGARITHMIC),
    "L_p": (-20.0, -0.1, LOGARITHMIC),
    "T_motor": (0.01, 0.3, LOGARITHMIC),
    "tau_roll": (0.0, 0.04, LINEAR),
}


def rate(seed: int) -> Posed:
    """Rate with a lag and a delay that turns the phase by less than a turn anywhere in the box."""
    return _response(rate_model("rate.roll"), RATE_TRUTH, np.geomspace(1.0, 40.0, 30), RATE_SIDES, seed)


def late(seed: int) -> Posed:
    """The same data; the box lets the delay turn the phase by up to 2.5 turns at 40 rad/s."""
    sides = {**RATE_SIDES, "tau_roll": (0.0, 0.4, LINEAR)}
    return _response(rate_model("rate.roll"), RATE_TRUTH, np.geomspace(1.0, 40.0, 30), sides, seed)


MODES = """
    name = "two modes"
    inputs = ["u"]
    states = ["a", "b", "c", "d"]
    equations = ["a' = b", "b' = -w1*w1*a - 2*z1*w1*b + k1*u", "c' = d", "d' = -w2*w2*c - 2*z2*w2*d + k2*u"]
    outputs = ["y = a + c"]
    [delays]
    u = "tau"
    [parameters]
    w1 = { value = 1.0, unit = "rad/s", lower = 0.0 }
    z1 = { value = 1.0, unit = "1", lower = 0.0 }
    k1 = { value = 1.0, unit = "1/s^2" }
    w2 = { value = 1.0, unit = "rad/s", lower = 0.0 }
    z2 = { value = 1.0, unit = "1", lower = 0.0 }
    k2 = { value = 1.0, unit = "1/s^2" }
    tau = { value = 0.01, unit = "s", lower = 0.0 }
    """


def modes(seed: int) -> Posed:
    """Two modes of 3 and 2 % damping, which may change places, and a delay; start values are one."""
    truth = {"w1": 6.0, "z1": 0.03, "k1": 10.0, "w2": 17.0, "z2": 0.02, "k2": 30.0, "tau": 0.03}
    sides: dict[str, Side] = {"tau": (0.0, 0.3, LINEAR)}
    for mode in "12":
        sides |= {f"w{mode}": (0.5, 80.0, LOGARITHMIC), f"z{mode}": (0.002, 0.9, LOGARITHMIC)}
        sides |= {f"k{mode}": (0.5, 500.0, LOGARITHMIC)}
    return _response(from_toml(MODES), truth, np.geomspace(1.0, 60.0, 50), sides, seed)


HOVER_OUTPUTS = ("q", "u", "w", "ax")
STABILITY = ("M_q", "M_u", "M_w", "X_q", "X_u", "Z_u", "Z_w")


def hover(seed: int) -> Posed:
    """Pitch of an unstable quadrotor of 1.4 kg: eleven parameters; signs are known of control derivatives only."""
    whole = library_model("hover.longitudinal").select(HOVER_OUTPUTS, ("pitch_command",))
    truth = {name: s500.LONGITUDINAL.get(name, 0.0) for name in whole.parameters.names}
    sides: dict[str, Side] = {name: (-3.0 * abs(truth[name]), 3.0 * abs(truth[name]), LINEAR) for name in STABILITY}
    sides |= {"M_pitch": (15.0, 1500.0, LOGARITHMIC), "tau_pitch": (0.0, 0.2, LINEAR)}
    sides |= {"X_pitch": (-70.0, -0.7, LOGARITHMIC), "Z_pitch": (-60.0, -0.6, LOGARITHMIC)}
    parameters = whole.parameters
    for name in parameters.names:
        if name not in sides:
            parameters = parameters.fix(name, truth[name])
    return _response(whole, truth, np.geomspace(1.0, 60.0, 30), sides, seed, parameters)


LAGS = """
    name = "three lags"
    inputs = ["u"]
    states = ["a", "b", "c"]
    equations = ["T1*a' = -a + k*u", "T2*b' = -b + a", "T3*c' = -c + b"]
    outputs = ["y = c + T0*c'"]
    [parameters]
    k = { value = 100.0, unit = "1" }
    T0 = { value = 0.1, unit = "s", lower = 1e-5 }
    T1 = { value = 1.0, unit = "s", lower = 1e-5 }
    T2 = { value = 0.1, unit = "s", lower = 1e-5 }
    T3 = { value = 0.01, unit = "s", lower = 1e-5 }
    """


def _lags(seed: int, scale: Scale) -> Posed:
    truth = {"k": 800.0, "T0": 0.4, "T1": 3.0, "T2": 0.08, "T3": 0.004}
    sides: dict[str, Side] = dict.fromkeys(("T0", "T1", "T2", "T3"), (0.0001, 100.0, scale))
    sides["k"] = (1.0, 1e5, scale)
    return _response(from_toml(LAGS), truth, np.geomspace(0.1, 500.0, 40), sides, seed)


def scaled(seed: int) -> Posed:
    """A gain, a lead and three lags over three decades, in a box of six decades that is divided linearly."""
    return _lags(seed, LINEAR)


def in_decades(seed: int) -> Posed:
    """The same data in the same box, divided by the logarithm."""
    return _lags(seed, LOGARITHMIC)


SWING = """
    name = "swing"
    inputs = ["u"]
    states = ["x", "v"]
    equations = ["x' = v", "v' = -w*w*x - 2*z*w*v + b*u"]
    outputs = ["x"]
    [delays]
    u = "tau"
    [parameters]
    w = { value = 10.0, unit = "rad/s", lower = 0.0, starts = [5.0, 15.0, 40.0] }
    z = { value = 0.1, unit = "1", lower = 0.0 }
    b = { value = 100.0, unit = "1/s^2" }
    tau = { value = 0.02, unit = "s", lower = 0.0, upper = 1.0 }
    """
SWING_RATE_HZ, SWING_SAMPLES = 25.0, 300


def swing(seed: int) -> Posed:
    """Output error of a mode of 0.5 % damping over 12 s, 38 of its periods; noise is a tenth of the motion."""
    structure = from_toml(SWING)
    truth = {"w": 20.0, "z": 0.005, "b": 300.0, "tau": 0.03}
    u = np.sign(np.repeat(np.random.default_rng(0).standard_normal((1, SWING_SAMPLES // 6)), 6, axis=1))
    exact = simulate_linear(structure.matrices(truth), u, sample_rate_hz=SWING_RATE_HZ)
    outputs = exact + 0.1 * exact.std() * np.random.default_rng(seed).standard_normal(exact.shape)
    record = TimeData(name="a flight", inputs=u, outputs=outputs, sample_rate_hz=SWING_RATE_HZ)
    problem = TimeProblem(structure=structure, parameters=structure.parameters, records=(record,))
    sides: dict[str, Side] = {"w": (3.0, 100.0, LOGARITHMIC), "z": (0.001, 0.9, LOGARITHMIC)}
    sides |= {"b": (10.0, 1e4, LOGARITHMIC), "tau": (0.0, 0.3, LINEAR)}

    def own() -> tuple[float, int]:
        ends = [problem.polish(start) for start in own_starts(problem)]
        return min(end.cost for end in ends), sum(end.evaluations for end in ends)

    truths = np.array([truth[name] for name in problem.parameters.free])
    return Posed(problem.within(_box(sides, problem.parameters)), truths, own)


def accelerations(seed: int) -> Posed:
    """Sums of absolute errors of four accelerations over a minute; κ and I_zz are seen as a ratio only."""
    flight = hover_quadrotor.fly(np.random.default_rng(seed))
    truth = hover_quadrotor.TRUTH
    problem = AccelerationProblem(
        motors=flight.motors,
        tilt=flight.tilt,
        accelerations=flight.accelerations,
        sample_rate_hz=hover_quadrotor.SAMPLE_RATE_HZ,
        layout=hover_quadrotor.layout(),
        parameters=hover_parameters(m=truth["m"], omega_max=truth["omega_max"], T_motor=truth["T_motor"]),
    )

    def own() -> tuple[float, int]:
        end = problem.polish(problem.parameters.pack())
        return end.cost, end.evaluations

    return Posed(problem, np.array([truth[name] for name in problem.parameters.free]), own)


PROBLEMS: Mapping[str, Problem] = {
    "rate": Problem("rate with a lag: 4 parameters", rate),
    "late": Problem("delay that wraps the phase: 4", late),
    "modes": Problem("two lightly damped modes: 7", modes),
    "hover": Problem("unstable hover: 11", hover),
    "scaled": Problem("poorly scaled, linear box: 5", scaled),
    "in decades": Problem("the same, logarithmic box: 5", in_decades),
    "swing": Problem("output error of a light mode: 4", swing),
    "accelerations": Problem("absolute errors of accelerations: 5", accelerations),
}
"""By name; titles with the number of free parameters."""
