r"""Predicted accuracy of responses to set-points, which are fitted to records in time.

A vehicle under its autopilot answers set-points; from outside its loop is a plant without feedback,

.. math:: y = G_{sp} s + v, \qquad G_{sp} = G T E

with the commands by set-points E, the closed loop T and the airframe G of :mod:`rotorid.planning.loop`. The history of
the set-points goes through it as it will be flown, held between the samples of the log, and the structure is fitted to
what comes out by output error, as an identification does. Where it ends is what the flight is expected to show: the
best that a structure of this order can say of a loop of a higher one. How well, say several draws of the gusts and
noises that the log will hold: each is fitted, and states its errors corrected for the color of its residuals, in which
what the structure leaves out counts like noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from rotorid.data.findings import Finding, remark
from rotorid.data.flight_plan import Entry, FlightPlan
from rotorid.data.record import TimeHistory
from rotorid.data.trust import DIRECT_COHERENCE
from rotorid.errors import UsageError
from rotorid.fitting.least_squares import LevenbergMarquardt
from rotorid.fitting.problem import Part
from rotorid.fitting.time.output_error import TimeData, TimeProblem, fit_output_error
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure, connected
from rotorid.planning.expected import (
    FitSettings,
    Planned,
    as_planned,
    excited_flight,
    expected_response,
    usable,
)
from rotorid.planning.loop import LoopModel, Noise
from rotorid.planning.prediction import PredictedParameter, Prediction
from rotorid.planning.remarks import require_inside
from rotorid.planning.systematic import mean_covariance
from rotorid.spectral.windows import grid_rad_s
from rotorid.typing import Axis, ComplexArray, FloatArray
from rotorid.uncertainty.cramer_rao import Bounds, bounds_of_parts

_DRAWS = 4
_FASTEST_RAD_S = 400.0
_SLOWEST_RAD_S, _GRID = 0.01, 256
_LEAST_NOISE = 1e-12
_MISFIT = 1.2


class Setpoint(NamedTuple):
    """A set-point of the vocabulary: the axis that it moves, where it enters, what answers it, and its sign there."""

    axis: Axis
    entry: Entry
    response: str
    sign: float = 1.0


SETPOINTS: Mapping[str, Setpoint] = MappingProxyType(
    {
        "phi_setpoint": Setpoint("roll", "attitude_setpoint", "phi"),
        "theta_setpoint": Setpoint("pitch", "attitude_setpoint", "theta"),
        "psi_setpoint": Setpoint("yaw", "attitude_setpoint", "psi"),
        "p_setpoint": Setpoint("roll", "rate_setpoint", "p"),
        "q_setpoint": Setpoint("pitch", "rate_setpoint", "q"),
        "r_setpoint": Setpoint("yaw", "rate_setpoint", "r"),
        # The stick is up positive.
        "velocity_down_setpoint": Setpoint("thrust", "stick", "velocity_down", -1.0),
    }
)


def setpoint_of(axis: Axis, entry: Entry) -> str | None:
    """The set-point that a test input of an axis at an entry moves.

    Examples
    --------
    >>> setpoint_of("thrust", "stick"), setpoint_of("roll", "command")
    ('velocity_down_setpoint', None)
    """
    return next(
        (name for name, setpoint in SETPOINTS.items() if (setpoint.axis, setpoint.entry) == (axis, entry)), None
    )


def answers_setpoints(structure: LinearStructure) -> bool:
    """Whether all inputs of a structure are set-points."""
    return all(name in SETPOINTS for name in structure.inputs)


def setpoint_loop(loop: LoopModel, names: Sequence[str], *, sampled: bool = False) -> LoopModel:
    """A loop as it is from outside: from set-points to what answers them, with nothing fed back that shows.

    Parameters
    ----------
    loop
        Airframe, feedback and noises; of :func:`rotorid.planning.aircraft.aircraft_loop`, logged at the rate of the
        set-points.
    names
        Set-points, some of :data:`SETPOINTS`.
    sampled
        Whether they are sent at the samples of the log, and stand until the next one.

    Raises
    ------
    UsageError
        A name is no set-point that is known.

    Examples
    --------
    The Bebop leans as far as it is asked to:

    >>> from rotorid.planning.aircraft import aircraft_loop
    >>> from rotorid.vehicles import aircraft
    >>> outside = setpoint_loop(aircraft_loop(aircraft("bebop"), log_rate_hz=20.0), ["phi_setpoint"])
    >>> abs(outside.plant.response(np.array([0.1]))[outside.outputs.index("phi"), 0]).round(2)
    array([1.])
    """
    if wrong := [name for name in names if name not in SETPOINTS]:
        raise UsageError(f"{wrong[0]!r} is not a set-point", needed=f"inputs of {', '.join(SETPOINTS)}")
    # Near hover on a level airframe the speed downward is that along its own axis.
    channels = {**{name: name for name in loop.outputs}, "velocity_down": "w"}
    rows = tuple(loop.outputs.index(row) for row in channels.values())
    own = tuple(SETPOINTS[name] for name in names)
    entered = {setpoint.entry: _Signs(tuple(other.sign for other in own)) for setpoint in own}
    return LoopModel(
        name=loop.name,
        inputs=tuple(names),
        outputs=tuple(channels),
        plant=_Answers(loop=loop, setpoints=own, rows=rows),
        feedback=None,
        noises=(Noise(source=_Logged(loop=loop, rows=rows), logged_only=True),),
        entries=dict(entered),
        log_rate_hz=loop.log_rate_hz,
        loop_rate_hz=loop.loop_rate_hz,
        declared=(),
        axes=tuple(setpoint.axis for setpoint in own),
        held=sampled,
    )


@dataclass(frozen=True, kw_only=True)
class _Answers:
    """Outputs by set-points with the loop closed."""

    loop: LoopModel
    setpoints: tuple[Setpoint, ...]
    rows: tuple[int, ...]

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        closed = self.loop.at(omega_rad_s)
        columns = []
        for setpoint in self.setpoints:
            place = self.loop.inputs.index(self.loop.input_of(setpoint.axis))
            entered = setpoint.sign * self.loop.excitation(omega_rad_s, setpoint.entry)[:, place]
            commands = np.einsum("ijf,jf->if", closed.excited, entered)
            columns.append(np.einsum("yuf,uf->yf", closed.plant, commands)[list(self.rows)])
        return np.stack(columns, axis=1)


@dataclass(frozen=True)
class _Signs:
    """Set-points by test inputs: the same, up to a sign."""

    signs: tuple[float, ...]

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        same = np.diag(np.array(self.signs, dtype=np.complex128))
        return np.repeat(same[:, :, None], omega_rad_s.size, axis=2)


@dataclass(frozen=True, kw_only=True)
class _Logged:
    """What outputs do in the log without test inputs: smooth, and so taken from a grid of its own."""

    loop: LoopModel
    rows: tuple[int, ...]

    @cached_property
    def _on_grid(self) -> tuple[FloatArray, ComplexArray]:
        first = len(self.loop.inputs)
        rows = [first + row for row in self.rows]
        grid = np.asarray(np.geomspace(_SLOWEST_RAD_S, np.pi * self.loop.log_rate_hz, _GRID), dtype=np.float64)
        return grid, np.asarray(self.loop.logged_noise(grid)[np.ix_(rows, rows)])

    def density(self, omega_rad_s: FloatArray) -> ComplexArray:
        grid, known = self._on_grid
        place = np.clip(np.searchsorted(grid, omega_rad_s), 1, grid.size - 1)
        share = np.clip((omega_rad_s - grid[place - 1]) / (grid[place] - grid[place - 1]), 0.0, 1.0)
        return np.asarray(known[..., place - 1] * (1.0 - share) + known[..., place] * share)


def with_known(loop: LoopModel, known: LinearStructure, values: Mapping[str, float]) -> LoopModel:
    """A loop from outside whose answers are those of an identified model, as far as it has them."""
    return replace(loop, plant=_Known(loop=loop, known=known, values=MappingProxyType(dict(values))))


@dataclass(frozen=True, kw_only=True)
class _Known:
    loop: LoopModel
    known: LinearStructure
    values: Mapping[str, float]

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        answers = self.loop.plant.response(omega_rad_s).copy()
        identified = self.known.response(self.values, omega_rad_s)
        for y, output in enumerate(self.known.outputs):
            for u, name in enumerate(self.known.inputs):
                if output in self.loop.outputs and name in self.loop.inputs:
                    answers[self.loop.outputs.index(output), self.loop.inputs.index(name)] = identified[y, u]
        return answers


def predict_responses(
    structure: LinearStructure,
    values: Mapping[str, float],
    loop: LoopModel,
    plan: FlightPlan,
    *,
    choices: FitSettings | None = None,
    seed: int = 0,
    rehearsed: Sequence[Bounds] = (),
    of_plan: bool = True,
    least_std: Mapping[str, float] | None = None,
) -> Prediction:
    """Say before a flight what an output-error fit of its responses to set-points will know.

    Parameters
    ----------
    structure
        What will be fitted, of ``response.*``.
    values
        What its parameters are believed to be; those that are not given are where the fit to the loop ends.
    loop
        Of :func:`setpoint_loop`.
    choices
        Only the band of the responses that stand beside.
    seed
        Of the draws of gusts and noise.
    rehearsed
        What identifications of simulated flights of such a plan state; without any, what fits to the linear loop do,
        which have no model error.
    of_plan
        Whether the plan itself flew; of another length, only model errors are alike.
    least_std
        Standard deviations of model error in an earlier result of the vehicle: none is smaller.

    Raises
    ------
    InsufficientDataError
        The plan does not excite an input or is too short, or a parameter ends on its bound.
    UsageError
        The loop has not the inputs or outputs of the structure.

    Notes
    -----
    Assumes a loop that is linear and stationary. In flight the tilt takes some lift, and large set-points meet limits:
    neither is in it.

    Examples
    --------
    >>> from rotorid.excitation import sequence, uncorrelated_binaries
    >>> from rotorid.models.library import response_model
    >>> from rotorid.planning.aircraft import aircraft_loop
    >>> from rotorid.vehicles import aircraft
    >>> roll = response_model("response.first_order_delay", [("phi_setpoint", "phi")])
    >>> loop = setpoint_loop(aircraft_loop(aircraft("bebop"), log_rate_hz=20.0), roll.inputs, sampled=True)
    >>> inputs = uncorrelated_binaries({"roll": 0.1}, start_s=0.0, band_rad_s=(1.5, 8.5), duration_s=30.0,
    ...                                sample_rate_hz=400.0, clock_hz=20.0, entries={"roll": "attitude_setpoint"})
    >>> found = predict_responses(roll, {}, loop, sequence("half a minute", [inputs]))
    >>> 0.15 < found["T_phi"].expected < 0.2, found["T_phi"].percent < 2.0
    (True, True)
    """
    choices = choices or FitSettings()
    structure = _scoped(structure, loop)
    axes = tuple(SETPOINTS[name].axis for name in structure.inputs)
    duration_s = plan.duration_s
    # What moves other axes is in no response of the structure.
    plan = replace(plan, inputs=tuple(planned for planned in plan.inputs if planned.axis in axes))
    shown = as_planned(plan, axes, loop.log_rate_hz, declared=())
    data = _records(structure, loop, as_planned(plan, axes, loop.loop_rate_hz or loop.log_rate_hz, declared=()))
    solver = LevenbergMarquardt(iterations=100, tolerance=1e-9)
    problem = TimeProblem(
        structure=structure,
        parameters=_with_free_values(structure.parameters, values),
        records=data,
        hold="zero",
        unknowns=("initial_state", "output_shift"),
    )
    alone = fit_output_error(problem, starts=[problem.parameters.pack()] if values else (), solver=solver)
    rng = np.random.default_rng([seed, 7])
    noises = list(_draws(structure, loop, data, rng))
    fits = [
        fit_output_error(_noisy(alone.problem, noise), starts=[alone.solution.theta], solver=solver) for noise in noises
    ]
    # In flight the errors decide how much each output counts, not what is left without them.
    weighed = alone.problem.with_noise(np.mean([fit.noise for fit in fits], axis=0))
    ended = solver.minimize(weighed.residuals, alone.solution.theta, *weighed.box)
    require_inside(weighed.parameters, ended)
    drawn = [bounds_of_parts(fit.problem.parts(fit.solution.theta), fit.parameters.free) for fit in fits]
    parts = weighed.parts(ended.theta)
    scatter, information = _of_noise(parts, weighed.whitening, structure, loop)
    alike = [bounds for bounds in rehearsed if bounds.names == weighed.parameters.free]
    stated = alike if alike and of_plan else drawn
    random = mean_covariance([bounds.random for bounds in stated])
    covariance = random + _model_part(weighed.parameters.free, rehearsed, least_std or {})
    inflation = _ratio(mean_covariance([bounds.random for bounds in drawn]), scatter)
    band = choices.band_rad_s or shown.band_rad_s
    windows = shown.windows(band, choices.windows_s)
    response = expected_response(
        loop,
        shown,
        inputs=structure.inputs,
        outputs=structure.outputs,
        omega_rad_s=grid_rad_s(band, windows),
        windows_s=windows.lengths_s,
        joint=False,
    )
    mask = np.eye(len(structure.outputs), len(structure.inputs), dtype=np.bool_)[:, :, None]
    least = choices.coherence if choices.coherence is not None else DIRECT_COHERENCE
    used = usable(response, shown, axes, band, replace(choices, estimate="direct", coherence=least)) & mask
    known = {**weighed.parameters.unpack(ended.theta).values, **values}
    return Prediction(
        plan=plan.name,
        duration_s=duration_s,
        parameters=_parameters(
            weighed.parameters, ended.theta, known, stated, covariance, random, scatter, information
        ),
        covariance=covariance,
        inflation=_ratio(covariance, random),
        response=response,
        used=used,
        findings=_remarks(structure, inflation),
    )


def _scoped(structure: LinearStructure, loop: LoopModel) -> LinearStructure:
    wrong = [name for name in structure.inputs if name not in loop.inputs]
    wrong += [name for name in structure.outputs if name not in loop.outputs]
    if wrong:
        raise UsageError(
            f"{structure.name} uses {wrong[0]}, but {loop.name} leads from {', '.join(loop.inputs)} to "
            f"{', '.join(loop.outputs)}",
            needed="flown set-points, and outputs of the loop",
        )
    return connected(structure)


def _with_free_values(parameters: ParameterSet, values: Mapping[str, float]) -> ParameterSet:
    return parameters.with_values({name: value for name, value in values.items() if name in parameters.free})


def _records(structure: LinearStructure, loop: LoopModel, planned: Planned) -> tuple[TimeData, ...]:
    """The records of a plan without gusts and noise, as the log will hold them."""
    fine = excited_flight(loop, planned, structure.outputs, highest_rad_s=_FASTEST_RAD_S)
    turn = round(planned.flight.sample_rate_hz / loop.log_rate_hz)
    signs = np.array([SETPOINTS[name].sign for name in structure.inputs])
    inputs = len(structure.inputs)
    return tuple(_logged(record, turn, signs, inputs, loop) for record in planned.records(fine))


def _logged(record: TimeHistory, turn: int, signs: FloatArray, inputs: int, loop: LoopModel) -> TimeData:
    sources = sum(name.endswith("_excitation") for name in record.names)
    late = turn // 2 if loop.held else 0
    asked, measured = record.values[:inputs, late::turn], record.values[sources:, ::turn]
    count = min(asked.shape[1], measured.shape[1])
    return TimeData(
        name="planned",
        inputs=signs[:, None] * asked[:, :count],
        outputs=measured[:, :count],
        sample_rate_hz=loop.log_rate_hz,
        before=np.zeros(inputs),
    )


def _noisy(problem: TimeProblem, noise: Sequence[FloatArray]) -> TimeProblem:
    records = tuple(
        replace(record, outputs=record.outputs + added) for record, added in zip(problem.records, noise, strict=True)
    )
    return replace(problem, records=records)


def _spectrum(structure: LinearStructure, loop: LoopModel, length: int) -> ComplexArray:
    """Densities of the outputs in the log on the lines of a record, shape ``(f, y, y)``; none at zero."""
    rows = [len(loop.inputs) + loop.outputs.index(name) for name in structure.outputs]
    lines = 2.0 * np.pi * loop.log_rate_hz / length * np.arange(length // 2 + 1)
    omega = np.asarray(lines, dtype=np.float64)
    density = np.zeros((omega.size, len(rows), len(rows)), dtype=np.complex128)
    density[1:] = np.moveaxis(loop.logged_noise(omega[1:])[np.ix_(rows, rows)], -1, 0)
    density[0] = density[1].real
    floor = _LEAST_NOISE * float(np.trace(density.sum(axis=0)).real) + np.finfo(np.float64).tiny
    return np.asarray(density + floor * np.eye(len(rows)))


def _draws(
    structure: LinearStructure, loop: LoopModel, data: Sequence[TimeData], rng: np.random.Generator
) -> Iterator[list[FloatArray]]:
    """What gusts and noise may do to the outputs of each record, shapes ``(y, n)``."""
    from scipy.fft import irfft, next_fast_len, rfft

    lengths = [int(next_fast_len(2 * record.samples, real=True)) for record in data]
    # One-sided densities: white noise of unit variance has twice one over the rate.
    roots = [np.linalg.cholesky(_spectrum(structure, loop, length) * loop.log_rate_hz / 2.0) for length in lengths]
    for _ in range(_DRAWS):
        drawn = []
        for record, length, root in zip(data, lengths, roots, strict=True):
            white = rfft(rng.standard_normal((length, len(structure.outputs))), axis=0)[:, :, None]
            drawn.append(np.asarray(irfft((root @ white)[:, :, 0], n=length, axis=0)[: record.samples].T))
        yield drawn


def _of_noise(
    parts: Sequence[Part], whitening: FloatArray, structure: LinearStructure, loop: LoopModel
) -> tuple[FloatArray, FloatArray]:
    r"""Covariance of the estimates by gusts and noise alone, and the information of the best estimate from them.

    .. math:: D S^T \Sigma S D, \qquad S^T \Sigma^{-1} S
    """
    from scipy.fft import next_fast_len, rfft

    count = parts[0].slopes.shape[2]
    flat = np.concatenate([part.slopes.reshape(-1, count) for part in parts])
    size = np.linalg.norm(flat, axis=0)
    D = np.linalg.inv((flat / size).T @ (flat / size)) / np.outer(size, size)
    middle, information = np.zeros((count, count)), np.zeros((count, count))
    for part in parts:
        length = int(next_fast_len(2 * len(part.slopes), real=True))
        lines = rfft(part.slopes, n=length, axis=0)
        spectrum = whitening @ _spectrum(structure, loop, length) @ whitening.T * loop.log_rate_hz / 2.0
        twice = np.full(len(lines), 2.0)
        twice[0] = 1.0
        twice[-1] = 1.0 if length % 2 == 0 else 2.0
        weighed = lines.conj() * twice[:, None, None] / length
        middle += np.einsum("fya,fyz,fzb->ab", weighed, spectrum, lines, optimize=True).real
        information += np.einsum("fya,fyb->ab", weighed, np.linalg.solve(spectrum, lines), optimize=True).real
    return D @ middle @ D, information


def _model_part(names: Sequence[str], rehearsed: Sequence[Bounds], least_std: Mapping[str, float]) -> FloatArray:
    """Covariance of model errors and clocks in what rehearsals state, in the mean; zero where none states any."""
    added = np.zeros((len(names), len(names)))
    alike = [bounds for bounds in rehearsed if bounds.names == tuple(names)]
    if alike:
        added = mean_covariance([bounds.covariance - bounds.random for bounds in alike])
    least = np.array([least_std.get(name, 0.0) ** 2 for name in names])
    return np.asarray(added + np.diag(np.maximum(least - np.diag(added), 0.0)))


def _ratio(stated: FloatArray, scatter: FloatArray) -> float:
    """How much larger stated standard deviations are than noise makes them, on the logarithmic mean."""
    return math.exp(0.5 * float(np.mean(np.log(np.diag(stated) / np.diag(scatter)))))


def _parameters(
    own: ParameterSet,
    theta: FloatArray,
    known: Mapping[str, float],
    stated: Sequence[Bounds],
    covariance: FloatArray,
    random: FloatArray,
    scatter: FloatArray,
    information: FloatArray,
) -> tuple[PredictedParameter, ...]:
    scale = np.sqrt(np.diag(information))
    lowest = np.sqrt(np.diag(np.linalg.pinv(information / np.outer(scale, scale), hermitian=True))) / scale
    return tuple(
        PredictedParameter(
            name=name,
            unit=own[name].unit,
            value=float(known[name]),
            expected=float(theta[row]),
            std=float(np.sqrt(covariance[row, row])),
            std_random=float(np.sqrt(random[row, row])),
            scatter=float(np.sqrt(scatter[row, row])),
            cramer_rao=float(np.mean([bounds.cramer_rao[row] for bounds in stated])),
            insensitivity=float(np.mean([bounds.insensitivity[row] for bounds in stated])),
            lowest_std=float(lowest[row]),
        )
        for row, name in enumerate(own.free)
    )


def _remarks(structure: LinearStructure, inflation: float) -> tuple[Finding, ...]:
    if inflation < _MISFIT:
        return ()
    return (
        remark(
            "colored_residuals",
            structure.name,
            f"What {structure.name} leaves out of the loop will count like noise: stated standard deviations are "
            f"{inflation:.2g} times those of gusts and noise alone. The values are those of the best model of this "
            "order for these test inputs.",
            factor=inflation,
        ),
    )
