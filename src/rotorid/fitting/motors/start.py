"""Where a fit of the motor chain begins: values at first sight, and the box in which a search looks for better ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.axes import AXIS_WORDS
from rotorid.data.record import MotorRecord
from rotorid.fitting.motors.excitation import LEAST_CORRELATION, Excitation
from rotorid.fitting.motors.problem import INERTIA, Filter, MotorProblem
from rotorid.fitting.problem import Scale, StartBox
from rotorid.models.motors import SPIN_UP, YAW_DELAY, mean_force
from rotorid.models.parameter import ParameterSet
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

WEIGHING = Filter(np.ones(1), 0.05)
"""The mean of an accelerometer as a scale of thrust: good to its bias, 0.05 m/s² where it was calibrated."""

_SEARCHED_HZ = 50.0
_FAR = 5.0
_REACH: Mapping[str, tuple[float, float]] = {
    "T_motor": (0.003, 0.3),
    "tau_gyro": (0.0, 0.06),
    YAW_DELAY: (0.0, 0.06),
    "tau_accel": (0.0, 0.06),
    "L_p": (-6.0, 1.0),
    "M_q": (-6.0, 1.0),
    "N_r": (-6.0, 1.0),
    "Z_w": (-3.0, 0.5),
    "X_u": (-3.0, 0.5),
    "Y_v": (-3.0, 0.5),
}


def searched_motors(problem: MotorProblem) -> MotorProblem:
    """The problem of slow motion on a coarser clock, with a box around it, for a search to find a start in.

    Outputs are averaged over the coarser samples, of which there are some 50 in a second; filters in front of the
    sensors are left to the delays.

    Parameters
    ----------
    problem
        As for :func:`fit_motors`.
    """
    coarse = replace(problem, records=tuple(coarser(record) for record in problem.records), filters=(), region=None)
    found = coarse.excitations
    slow = slow_problem(coarse.with_parameters(started(coarse, found)), found)
    return slow.within(reach(slow))


def coarser(record: MotorRecord) -> MotorRecord:
    """A record of some 50 samples in a second: outputs averaged over them, filters in front of the sensors left out.

    The specific force keeps its mean, which is the weight: of a differentiated height, only all samples together have
    it, since the noise of every second or third one does not cancel.
    """
    every = max(1, int(record.sample_rate_hz / _SEARCHED_HZ))
    count = record.samples // every

    def mean(rows: FloatArray) -> FloatArray:
        return np.asarray(rows[..., : count * every].reshape(*rows.shape[:-1], count, every).mean(axis=-1))

    az = record.az[: count * every : every]
    if az.size:
        az = az + (record.az[: count * every].mean() - az.mean())
    return replace(
        record,
        sample_rate_hz=record.sample_rate_hz / every,
        outputs=mean(record.outputs),
        rates=record.rates[:, : count * every : every],
        az=az,
        w=record.w[: count * every : every],
        velocity=record.velocity[:, : count * every : every],
        attitude=record.attitude[:, : count * every : every],
        strength=mean(record.strength),
        gyro_taps=np.ones(1),
        accel_taps=np.ones(1),
    )


def reach(problem: MotorProblem, *, factor: float = _FAR) -> StartBox:
    """Where a vehicle may lie: thrust that makes the measured force, inertia within a factor, lags, damping.

    Parameters
    ----------
    problem
        With first values.
    factor
        How far from these inertia and the only coefficient of thrust may lie.
    """
    parameters = problem.parameters
    force = parameters["m"].value * _force_per_mass(problem)
    sides: list[tuple[float, float]] = []
    several = sum(name in parameters.free for name in ("c_0", "c_1", "c_2"))
    for name in parameters.free:
        value = parameters[name].value
        low, high = min(value / factor, value * factor), max(value / factor, value * factor)
        if name in ("c_0", "c_1", "c_2") and not (factor < _FAR and several == 1):
            size = force / max(_summed(problem, int(name[-1])), 1e-9)
            low, high = -size, 2.0 * size
        low, high = _REACH.get(name, (low, high))
        sides.append((max(low, parameters[name].lower), min(high, parameters[name].upper)))
    scales: list[Scale] = ["logarithmic" if low * high > 0.0 else "linear" for low, high in sides]
    lower, upper = np.array(sides).T
    return StartBox(lower=lower, upper=upper, scales=tuple(scales))


def _counted(record: Mapping[str, Excitation], axes: Sequence[str]) -> list[str]:
    """Equations of a record that count; the weight where nothing better is known of the thrust."""
    excited = [axis for axis in axes if axis in record and record[axis].correlation >= LEAST_CORRELATION]
    return excited if "az" in excited or "weight" not in axes else ["weight", *excited]


def slow_problem(problem: MotorProblem, found: Sequence[Mapping[str, Excitation]]) -> MotorProblem:
    """The problem of slow motion: each axis that counts in units of the errors of a first guess."""
    filters = []
    for record, errors, excited in zip(problem.records, problem.errors(problem.parameters.pack()), found, strict=True):
        counted = _counted(excited, problem.axes)
        filters.append(
            {
                axis: WEIGHING if axis == "weight" else sized(excited[axis].taps(record.sample_rate_hz), errors[axis])
                for axis in counted
            }
        )
    return problem.with_filters(filters)


def sized(taps: FloatArray, error: FloatArray) -> Filter:
    """A filter in units of what it leaves of an error."""
    size = float(np.sqrt(np.mean(Filter(taps, 1.0)(error) ** 2)))
    return Filter(taps, size or 1.0)


def started(problem: MotorProblem, found: Sequence[Mapping[str, Excitation]]) -> ParameterSet:
    """Thrust that makes the measured force, lag of the best correlation, inertia from torque and slow acceleration."""
    parameters = problem.parameters
    free = set(parameters.free)
    lags = [
        excitation.lag_s
        for record in found
        for axis, excitation in record.items()
        # Tilt has no lag of the motors.
        if axis in AXIS_WORDS and excitation.correlation >= LEAST_CORRELATION
    ]
    if "T_motor" in free and lags:
        parameters = parameters.with_values({"T_motor": float(np.median(lags))})
    parameters = parameters.with_values(_of_mean_force(problem, parameters))
    units = {name: 1.0 for axis, name in INERTIA.items() if axis in problem.axes and name in free}
    return parameters.with_values(_inertia(problem.with_parameters(parameters.with_values(units)), found, units))


def _force_per_mass(problem: MotorProblem) -> float:
    """Mean specific force of the flights; weight, where the accelerometer shows less than half of it."""
    measured = mean_force(problem.records)
    return measured if measured > 0.5 * STANDARD_GRAVITY_M_S2 else STANDARD_GRAVITY_M_S2


def _of_mean_force(problem: MotorProblem, parameters: ParameterSet) -> dict[str, float]:
    """The leading coefficient of thrust, or the mass, with which the rotors make the measured force on average."""
    curve: list[str] = [name for name in ("c_0", "c_1", "c_2") if name in parameters.names]
    sums = {name: _summed(problem, int(name[-1])) for name in curve}
    carried = sum(parameters[name].value * sums[name] for name in curve if name not in parameters.free)
    if not (open_ := [name for name in curve if name in parameters.free]):
        return {"m": carried / _force_per_mass(problem)} if "m" in parameters.free else {}
    force = parameters["m"].value * _force_per_mass(problem)
    return dict.fromkeys(open_, 0.0) | {open_[-1]: (force - carried) / sums[open_[-1]]}


def _summed(problem: MotorProblem, power: int) -> float:
    """Sum over the rotors of a power of their outputs, on average over the records."""
    means = [float(np.mean((record.outputs**power).sum(axis=0) * record.strength)) for record in problem.records]
    return float(np.mean(means))


def _inertia(
    probe: MotorProblem, found: Sequence[Mapping[str, Excitation]], units: Mapping[str, float]
) -> dict[str, float]:
    """Inertia from the regression of slow acceleration on the torque of a unit inertia."""
    products = {axis: np.zeros(2) for axis in probe.axes}
    yaw: list[tuple[FloatArray, FloatArray]] = []
    for record, equations, excited in zip(probe.records, probe.equations(probe.parameters.pack()), found, strict=True):
        for axis in equations:
            if axis.name in _counted(excited, probe.axes):
                own = excited["az" if axis.name == "weight" else axis.name]
                shape = Filter(own.taps(record.sample_rate_hz), 1.0)
                motion, torque = (shape(row - row.mean()) for row in (axis.measured, axis.predicted))
                products[axis.name] += [float(motion @ torque), float(torque @ torque)]
                if axis.name == "r" and SPIN_UP in probe.parameters.free:
                    gained = shape(axis.slopes[probe.parameters.names.index(SPIN_UP)])
                    yaw.append((np.stack([torque, gained - gained.mean()]), motion))
    gains = {axis: top / bottom for axis, (top, bottom) in products.items() if top > 0.0}
    values = {
        name: gains.get(axis, 1.0) if axis == "r" else 1.0 / gains.get(axis, 1.0) for axis, name in INERTIA.items()
    }
    if yaw:
        values |= _of_yaw(np.concatenate([rows for rows, _ in yaw], axis=1), np.concatenate([row for _, row in yaw]))
    return {name: value for name, value in values.items() if name in (*units, SPIN_UP)}


def _of_yaw(rows: FloatArray, motion: FloatArray) -> dict[str, float]:
    """Torque and spin-up, from zero up; where slow motion shows but one of them, the other gets a little."""
    from scipy.optimize import nnls

    factors, _ = nnls(rows.T, motion)
    most = float(np.max(factors * np.linalg.norm(rows, axis=1)))
    least = 0.01 * most / np.maximum(np.linalg.norm(rows, axis=1), 1e-300)
    torque, gained = np.maximum(factors, least).tolist()
    return {"kappa_per_I_zz": torque, SPIN_UP: gained} if most > 0.0 else {}
