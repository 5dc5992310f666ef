"""Black boxes of an order by maximum likelihood: a state space whose parameters have no meaning of their own.

Starts are subspaces with several methods and horizons, and drawn poles; they are brought from the samples back to
continuous time by the exact inverse of the zero-order or the first-order hold, written in parallel sections, and fitted
by output error. Information criteria and the gap between singular values show which order the data support.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, get_args

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.findings import Finding, warn
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.fitting.black_box.subspace import Subspace, fit_subspace, simulated_gains
from rotorid.fitting.least_squares import LevenbergMarquardt
from rotorid.fitting.time.output_error import (
    InitialCondition,
    OutputErrorFit,
    TimeData,
    TimeProblem,
    fit_output_error,
    require_records,
)
from rotorid.models.black_box import best_references, black_box, black_box_pairs, from_state_space
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.simulation.linear import Hold, discretize, earlier
from rotorid.typing import FloatArray

_FASTEST = float(np.exp(-np.pi))
"""A decaying mode as fast as the fastest oscillation that samples show."""

_ROUNDING = 1e-8


class Continuous(NamedTuple):
    """A and B of a system in continuous time, and how many modes had none and were replaced."""

    A: FloatArray
    B: FloatArray
    replaced: int


def continuous_from_discrete(A: FloatArray, B: FloatArray, *, step_s: float, hold: Hold) -> Continuous:
    r"""The system :math:`\dot x = A_c x + B_c u` whose samples under a hold obey :math:`x_{k+1} = A x_k + B u_k`.

    .. math:: A_c = \frac{1}{T} \log A, \qquad B = (\Gamma_0 + A \Gamma_1) B_c

    with the hold's integrals :math:`\Gamma_0` and :math:`\Gamma_1` for the samples at both ends of a step; a zero-order
    hold has no share of the end. Under a first-order hold a system without feedthrough shows one from sample to sample,
    :math:`C \Gamma_1 B_c`; it belongs to B here.

    A negative real eigenvalue changes its sign with every sample and no continuous system of the same order does that;
    it is mostly noise near the Nyquist frequency, or a delay. It is replaced by the decay :math:`e^{-\pi}`, and
    counted: the outcome is then a start and no equivalent.

    Parameters
    ----------
    A, B
        Shapes ``(x, x)`` and ``(x, u)``.
    hold
        What the inputs do between their samples.

    Raises
    ------
    ModelError
        The matrix has no real logarithm, or its inputs cannot be traced back.

    Examples
    --------
    >>> one = continuous_from_discrete(np.array([[np.exp(-0.2)]]), np.array([[1.0 - np.exp(-0.2)]]),
    ...                                step_s=0.1, hold="zero")
    >>> round(float(one.A[0, 0]), 12), round(float(one.B[0, 0]), 12), one.replaced
    (-2.0, 2.0, 0)
    """
    from scipy.linalg import logm

    transition, replaced = _with_logarithm(A)
    rate = np.asarray(logm(transition)) / step_s
    if not np.isfinite(rate).all() or np.abs(rate.imag).max() > _ROUNDING * np.abs(rate).max():
        raise ModelError("the discrete system has no continuous equivalent", remedy="use a lower order")
    system = np.asarray(rate.real, dtype=np.float64)
    order = len(A)
    taps = discretize(system, np.eye(order), delays_s=np.zeros(order), step_s=step_s, hold=hold).taps
    reached = taps[1].T + transition @ taps[2].T
    if np.linalg.cond(reached) > 1.0 / _ROUNDING:
        raise ModelError("the sample-and-hold of an input cannot be inverted", remedy="use a lower order")
    return Continuous(system, np.asarray(np.linalg.solve(reached, B), dtype=np.float64), replaced)


def _with_logarithm(A: FloatArray) -> tuple[FloatArray, int]:
    """The matrix without real eigenvalues up to zero, and how many there were."""
    from scipy.linalg import schur

    triangle, vectors = schur(A, output="real")
    below = np.append(np.abs(np.diag(triangle, -1)) > 0.0, False)
    single = ~(below | np.append(False, below[:-1]))
    lost = np.flatnonzero(single & (np.diag(triangle) <= _ROUNDING))
    if lost.size == 0:
        return A, 0
    triangle = triangle.copy()
    # Each its own decay, so that they stay apart.
    triangle[lost, lost] = _FASTEST * 1.1 ** np.arange(lost.size)
    return np.asarray(vectors @ triangle @ vectors.T, dtype=np.float64), int(lost.size)


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
            f"no starting model of order {order}: {'; '.join(sorted(set(reasons))) or 'none was asked for'}",
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
    return Start(A, system.B, C, np.full(inputs, delay_s), "random poles", 0, np.zeros(0))


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
        inputs = np.hstack([earlier(record.before, samples), inputs])[:, : record.samples]
    return TimeData(name=record.name, inputs=inputs, outputs=record.outputs, sample_rate_hz=record.sample_rate_hz)


_DELAY_SAMPLES = (0, 1, 2, 3)
"""Delays that starts take off where delays are free."""

_SEARCH = LevenbergMarquardt(iterations=150, tolerance=1e-9)


@dataclass(frozen=True, kw_only=True, eq=False)
class BlackBoxFit(Immutable):
    """A black box that was fitted.

    Parameters
    ----------
    structure
        Parallel sections; see :mod:`rotorid.models.black_box`.
    fit
        The output-error fit, with the other minima that its starts came to.
    singular_values
        Of the first subspace, largest first: evidence of the order. Empty where there was none.
    findings
        What an engineer would remark on.
    """

    structure: LinearStructure
    fit: OutputErrorFit
    singular_values: FloatArray
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        self._set(singular_values=read_only(self.singular_values, np.float64, ndim=1), findings=tuple(self.findings))

    @property
    def parameters(self) -> ParameterSet:
        """The identified values."""
        return self.fit.parameters


def fit_black_box(
    records: Sequence[TimeData],
    order: int,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    delays: bool = False,
    stable: bool = True,
    hold: Hold = "zero",
    unknowns: tuple[InitialCondition, ...] = ("initial_state", "output_shift"),
    plan: StartPlan | None = None,
    solver: LevenbergMarquardt | None = None,
) -> BlackBoxFit:
    """Fit a state space of an order with the error at the outputs.

    Systems from several subspaces and from drawn poles are brought to parallel sections, and each is the start of a
    search; the lowest end counts and the others are kept. Where a controller was at work an output error is biased;
    then the structure found here is the start of a prediction-error fit.

    Parameters
    ----------
    records
        Inputs and outputs, of one sample rate.
    order
        Number of states, from 1 to 20.
    inputs, outputs
        Names of the rows of the records.
    delays
        Whether inputs may come late; the delays are estimated as fractions of a sample.
    stable
        Whether modes must decay, as those of records without feedback do.
    hold
        What the inputs do between their samples.
    unknowns
        What is estimated beside the parameters, for each record.
    plan
        Which starts to make.
    solver
        Local solver.

    Raises
    ------
    InsufficientDataError
        The records are too short, or no start has a bounded response.
    UsageError
        The records do not go with the names or with each other.
    """
    require_records(records, inputs=inputs, outputs=outputs, unknowns=unknowns, known=get_args(InitialCondition))
    plan = replace(plan or StartPlan(), stable=stable)
    starts = _starts(records, order, delays=delays, hold=hold, unknowns=unknowns, plan=plan)
    size = np.hstack([record.outputs for record in records]).std(axis=1)
    size = np.where(size > 0.0, size, 1.0)
    references = _references(starts, outputs, size)
    structure = black_box(order, inputs, outputs, delays=delays, stable=stable, references=references)
    sets = list(_sets(starts, structure, delays=delays))
    if not sets:
        raise InsufficientDataError(
            f"no starting model of order {order} can be written in sections", remedy="use another order"
        )
    problem = TimeProblem(structure=structure, parameters=sets[0], records=tuple(records), hold=hold, unknowns=unknowns)
    fit = fit_output_error(problem, starts=[parameter_set.pack() for parameter_set in sets], solver=solver or _SEARCH)
    return BlackBoxFit(
        structure=structure,
        fit=fit,
        singular_values=next((start.singular_values for start in starts if start.singular_values.size), np.zeros(0)),
        findings=_remarks(starts, structure.name),
    )


def fit_black_box_pairs(
    records: Sequence[TimeData],
    order: int,
    *,
    pairs: Sequence[tuple[str, str]],
    delays: bool = False,
    stable: bool = True,
    hold: Hold = "zero",
    unknowns: tuple[InitialCondition, ...] = ("initial_state", "output_shift"),
    plan: StartPlan | None = None,
    solver: LevenbergMarquardt | None = None,
) -> BlackBoxFit:
    """Fit black boxes of one order side by side, each from one input to one output.

    Each pair is fitted alone, then all together, with the correlation of their errors.

    Parameters
    ----------
    records
        Rows of the inputs and of the outputs in the order of the pairs.
    order
        Number of states of each pair.
    pairs
        Input and output of each pair.
    delays, stable, hold, unknowns, plan, solver
        As for :func:`fit_black_box`.

    Raises
    ------
    InsufficientDataError, UsageError
        As for :func:`fit_black_box`.
    """
    structure = black_box_pairs(order, pairs, delays=delays, stable=stable)
    require_records(
        records, inputs=structure.inputs, outputs=structure.outputs, unknowns=unknowns, known=get_args(InitialCondition)
    )
    pair_fits = [
        fit_black_box(
            [_row(record, number) for record in records],
            order,
            inputs=[u],
            outputs=[y],
            delays=delays,
            stable=stable,
            hold=hold,
            unknowns=unknowns,
            plan=plan,
            solver=solver,
        )
        for number, (u, y) in enumerate(pairs)
    ]
    values = {
        f"{name}_{y}": value
        for (_, y), fit in zip(pairs, pair_fits, strict=True)
        for name, value in fit.parameters.values.items()
    }
    problem = TimeProblem(
        structure=structure,
        parameters=structure.parameters.with_values(values),
        records=tuple(records),
        hold=hold,
        unknowns=unknowns,
    )
    return BlackBoxFit(
        structure=structure,
        fit=fit_output_error(problem, solver=solver or _SEARCH),
        singular_values=np.sort(np.concatenate([fit.singular_values for fit in pair_fits]))[::-1],
        findings=tuple(finding for fit in pair_fits for finding in fit.findings),
    )


def _row(record: TimeData, number: int) -> TimeData:
    row = slice(number, number + 1)
    return replace(record, inputs=record.inputs[row], outputs=record.outputs[row], before=record.before[row])


def _starts(
    records: Sequence[TimeData],
    order: int,
    *,
    delays: bool,
    hold: Hold,
    unknowns: tuple[InitialCondition, ...],
    plan: StartPlan,
) -> tuple[Start, ...]:
    if delays and plan.delay_samples == (0,):
        plan = replace(plan, delay_samples=_DELAY_SAMPLES)
    if {"output_shift", "state_bias"} & set(unknowns):
        records = [_centered(record) for record in records]
    return black_box_starts(records, order, plan, hold=hold)


def _centered(record: TimeData) -> TimeData:
    mean = record.inputs.mean(axis=1)
    return replace(
        record,
        inputs=record.inputs - mean[:, None],
        outputs=record.outputs - record.outputs.mean(axis=1, keepdims=True),
        before=record.before - mean[:, None],
    )


def _references(starts: Sequence[Start], outputs: Sequence[str], size: FloatArray) -> tuple[str, ...]:
    """The outputs that see the sections best, in the first start that can be split."""
    for start in starts:
        try:
            return best_references(start.A, start.C / size[:, None], outputs)
        except ModelError:
            continue
    return ()


def _sets(starts: Sequence[Start], structure: LinearStructure, *, delays: bool) -> list[ParameterSet]:
    """Parameters of the starts that sections can hold."""
    found = []
    late = ["tau" if len(structure.inputs) == 1 else f"tau_{u}" for u in structure.inputs]
    for start in starts:
        try:
            parameters = from_state_space(start.A, start.B, start.C, structure)
        except ModelError:
            # Modes that coincide or are hidden: another start has them apart.
            continue
        if delays:
            parameters = parameters.with_values(dict(zip(late, start.delays_s.tolist(), strict=True)))
        found.append(parameters)
    return found


def _remarks(starts: Sequence[Start], name: str) -> tuple[Finding, ...]:
    remarks = []
    subspaces = [start for start in starts if start.singular_values.size]
    lost = [start for start in subspaces if start.replaced]
    if subspaces and len(lost) == len(subspaces):
        remarks.append(
            warn(
                "order_too_high",
                name,
                "Every subspace model of this order has a mode that changes its sign at each sample: it "
                "describes noise, or a delay without a parameter in the model.",
                starts=float(len(subspaces)),
                replaced=float(min(start.replaced for start in lost)),
            )
        )
    return tuple(remarks)


class InformationCriteria(NamedTuple):
    """Criteria of one model on its own data; lower is better, and only differences between models count.

    Parameters
    ----------
    aic
        Akaike's: twice the number of parameters.
    aicc
        The same, corrected for few samples; infinite where there are not more samples than parameters.
    bic
        Schwarz's, which is Rissanen's description length: the number of parameters times the logarithm of the samples.
    """

    aic: float
    aicc: float
    bic: float


def information_criteria(residuals: FloatArray, parameters: int) -> InformationCriteria:
    r"""Criteria from Gaussian residuals with an unknown covariance.

    .. math:: N \log\det \frac{1}{N} \sum_k e_k e_k^T + \begin{cases} 2p \\ 2 p N_y / (N_y - p - 1) \\ p \log N
        \end{cases}

    with :math:`N_y` all numbers of the outputs. Residuals of a simulation are hardly ever white; then neighbors are
    no news, the data count for more than they hold, and all three prefer too high an order. Scores on other records do
    not have this flaw.

    Parameters
    ----------
    residuals
        Shape ``(y, n)``.
    parameters
        How many were estimated from these residuals, initial states and offsets included.

    Raises
    ------
    UsageError
        The residuals are not finite or have another shape.
    InsufficientDataError
        There are fewer samples than outputs, or the residuals of an output vanish: their likelihood has no bound.

    References
    ----------
    H. Akaike, IEEE Transactions on Automatic Control, 1974; C. Hurvich and C.-L. Tsai, Biometrika, 1989; G. Schwarz,
    Annals of Statistics, 1978.

    Examples
    --------
    >>> noise = np.random.default_rng(0).standard_normal((1, 400))
    >>> few, many = information_criteria(noise, 2), information_criteria(noise, 12)
    >>> round(many.aic - few.aic, 9), bool(many.bic - few.bic > many.aicc - few.aicc > 20.0)
    (20.0, True)
    """
    if residuals.ndim != 2 or not np.isfinite(residuals).all():
        raise UsageError(f"invalid residuals of shape {residuals.shape}", needed="finite numbers of shape (y, n)")
    outputs, samples = residuals.shape
    sign, determinant = np.linalg.slogdet(residuals @ residuals.T / max(samples, 1))
    if samples <= outputs or sign <= 0:
        raise InsufficientDataError(
            "the covariance of the residuals is singular", needed="more samples than outputs, and noise"
        )
    fit, count = samples * float(determinant), samples * outputs
    left = count - parameters - 1
    aicc = fit + 2.0 * parameters * count / left if left > 0 else np.inf
    return InformationCriteria(fit + 2.0 * parameters, aicc, fit + parameters * float(np.log(samples)))
