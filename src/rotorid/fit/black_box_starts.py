"""Where the search for a black box begins: subspaces with several methods and horizons, and drawn poles."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rotorid.errors import InsufficientDataError, ModelError
from rotorid.fit.black_box_continuous import continuous_from_discrete
from rotorid.fit.state_space_gains import simulated_gains
from rotorid.fit.subspace import Subspace, fit_subspace
from rotorid.fit.time_data import TimeData
from rotorid.simulate.hold import Hold
from rotorid.typing import FloatArray

_LONGER = 2
"""Beside the horizon of the rule, one that is longer by this factor."""

_FASTEST_OF_NYQUIST = 0.5
_SLOWEST = 1e-3
"""In 1/s: an integrator becomes a mode that decays in a quarter of an hour."""


class Start(NamedTuple):
    """A continuous system to begin with.

    Parameters
    ----------
    A, B, C
        Shapes ``(x, x)``, ``(x, u)``, ``(y, x)``.
    delays_s
        Of the inputs, shape ``(u,)``.
    origin
        Where it comes from.
    replaced
        Modes that no continuous system has, and that were replaced.
    singular_values
        Of the subspace, largest first; empty for drawn poles.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    delays_s: FloatArray
    origin: str
    replaced: int
    singular_values: FloatArray


@dataclass(frozen=True, kw_only=True)
class StartPlan:
    """Which starts to make.

    Parameters
    ----------
    methods
        Subspace methods; add or choose ``predictor`` where a controller was at work.
    delay_samples
        Whole samples of delay that are taken off the inputs first, one set of starts for each.
    drawn
        How many sets of poles to draw besides.
    seed
        Of the draws.
    stable
        Whether modes that grow are mirrored into modes that decay.
    """

    methods: tuple[Subspace, ...] = ("cva", "moesp", "predictor")
    delay_samples: tuple[int, ...] = (0,)
    drawn: int = 4
    seed: int = 0
    stable: bool = True


def black_box_starts(records: Sequence[TimeData], order: int, plan: StartPlan, *, hold: Hold) -> tuple[Start, ...]:
    """Continuous systems of an order that suit the records roughly, subspaces first.

    Parameters
    ----------
    records
        Inputs and outputs without offsets, of one sample rate.
    order
        Number of states.
    plan
        Which starts to make.
    hold
        What the inputs do between their samples.

    Raises
    ------
    InsufficientDataError
        No start could be made.
    """
    found: list[Start] = []
    reasons: list[str] = []
    for samples in plan.delay_samples:
        early = [_earlier(record, samples) for record in records]
        delay_s = samples / records[0].sample_rate_hz
        for attempt in _attempts(early, order, plan, hold, delay_s):
            if isinstance(attempt, Start):
                found.append(_decaying(attempt, early, hold) if plan.stable else attempt)
            else:
                reasons.append(attempt)
    if not found:
        raise InsufficientDataError(
            f"no start of order {order} could be made: {'; '.join(sorted(set(reasons))) or 'none was asked for'}",
            needed="longer records, or a lower order",
        )
    return tuple(found)


def _attempts(
    records: Sequence[TimeData], order: int, plan: StartPlan, hold: Hold, delay_s: float
) -> Iterator[Start | str]:
    """Starts, or the reasons why there is none."""
    rng = np.random.default_rng(plan.seed)
    for method in plan.methods:
        try:
            first = _from_subspace(records, order, method, None, hold, delay_s)
            yield first[0]
            yield _from_subspace(records, order, method, _LONGER * first[1], hold, delay_s)[0]
        except (InsufficientDataError, ModelError) as error:
            yield str(error)
    for _ in range(plan.drawn):
        A, C = _drawn(records, order, rng)
        try:
            yield _with_gains(A, C, records, hold, delay_s)
        except ModelError as error:
            yield str(error)


def _from_subspace(
    records: Sequence[TimeData], order: int, method: Subspace, horizon: int | None, hold: Hold, delay_s: float
) -> tuple[Start, int]:
    # Under a first-order hold the end of a step acts on the state at the end of it.
    model = fit_subspace(records, order, method=method, horizon=horizon, feedthrough=hold == "first")
    step_s = 1.0 / records[0].sample_rate_hz
    system = continuous_from_discrete(model.A, model.B, step_s=step_s, hold=hold)
    start = Start(
        A=system.A,
        B=system.B,
        C=np.asarray(model.C),
        delays_s=np.full(len(records[0].inputs), delay_s),
        origin=f"{method}, horizon {model.horizon}",
        replaced=system.replaced,
        singular_values=np.asarray(model.singular_values),
    )
    return start, model.horizon


def _with_gains(A: FloatArray, C: FloatArray, records: Sequence[TimeData], hold: Hold, delay_s: float) -> Start:
    """Given modes with the gains that suit the records best."""
    from scipy.linalg import expm

    step_s = 1.0 / records[0].sample_rate_hz
    transition = np.asarray(expm(A * step_s), dtype=np.float64)
    inputs = len(records[0].inputs)
    gains = simulated_gains(transition, C, records, direct=inputs if hold == "first" else 0)
    system = continuous_from_discrete(transition, gains.B, step_s=step_s, hold=hold)
    return Start(A, system.B, C, np.full(inputs, delay_s), "drawn poles", 0, np.zeros(0))


def _decaying(start: Start, records: Sequence[TimeData], hold: Hold) -> Start:
    """The start with modes that grow mirrored into modes that decay, and new gains where there were any."""
    poles, vectors = np.linalg.eig(start.A)
    if poles.real.max() < 0.0:
        return start
    left = np.where(poles.real >= 0.0, -np.maximum(poles.real, _SLOWEST) + 1j * poles.imag, poles)
    A = np.asarray((vectors * left @ np.linalg.inv(vectors)).real, dtype=np.float64)
    mirrored = _with_gains(A, start.C, records, hold, float(start.delays_s[0]))
    return start._replace(A=A, B=mirrored.B)


def _drawn(records: Sequence[TimeData], order: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Modes with frequencies even on a logarithmic axis, from one turn in the longest record up."""
    slowest = 2.0 * np.pi / max(record.duration_s for record in records)
    fastest = _FASTEST_OF_NYQUIST * np.pi * records[0].sample_rate_hz
    A, outputs = np.zeros((order, order)), len(records[0].outputs)
    size = np.sqrt(np.mean(np.hstack([record.outputs for record in records]) ** 2, axis=1))
    C = rng.standard_normal((outputs, order)) * size[:, None]
    for k in range(0, order, 2):
        rate = float(np.exp(rng.uniform(np.log(slowest), np.log(fastest))))
        damping = float(rng.uniform(0.2, 1.5))
        if k + 1 == order:
            A[k, k] = -rate
        else:
            # States of one size: position times frequency, and rate.
            A[k : k + 2, k : k + 2] = [[0.0, rate], [-rate, -2.0 * damping * rate]]
    return A, C


def _earlier(record: TimeData, samples: int) -> TimeData:
    """The record with inputs that were given earlier, so that a system that is late by as much is so no more."""
    inputs = record.inputs
    if samples:
        before = np.repeat(record.before[:, None], min(samples, record.samples), axis=1)
        inputs = np.hstack([before, inputs])[:, : record.samples]
    return TimeData(name=record.name, inputs=inputs, outputs=record.outputs, sample_rate_hz=record.sample_rate_hz)
