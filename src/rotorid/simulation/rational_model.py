r"""A linear model as a state space without delays, for tools that have none.

A delay :math:`\tau` becomes states by Padé's approximation of order :math:`n`,

.. math::

    e^{-s\tau} \approx \frac{N(-s\tau)}{N(s\tau)}, \qquad
    N(x) = \sum_{k=0}^{n} \frac{(2n - k)! \, n!}{(2n)! \, k! \, (n - k)!} x^k

which has the right magnitude everywhere and the right phase up to about :math:`\omega \tau = n`; or a lag of the same
size, right at low frequencies alone; or nothing. Of a sampled model whose inputs are held nothing has to be
approximated: a delay is memory of the last samples, also where it is no whole number of them.

A negative delay, which a fit may find within its errors, is no model of anything that runs: it counts as none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.errors import UsageError, unknown_name
from rotorid.models.state_space import StateSpace
from rotorid.simulation.linear import discretize
from rotorid.typing import ComplexArray, FloatArray

Delays: TypeAlias = Literal["states", "lag", "none"]
"""Delays as states, as lags of the same size, or left out."""

Quadruple: TypeAlias = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""``A B C D``."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RationalModel(Immutable):
    r"""A state space without delays.

    .. math:: \dot x = A x + B u \quad \text{or} \quad x_{k+1} = A x_k + B u_k, \qquad y = C x + D u

    Parameters
    ----------
    A, B, C, D
        Shapes ``(x, x)``, ``(x, u)``, ``(y, x)`` and ``(y, u)``.
    states
        Names.
    sample_time_s
        Of a sampled model; ``None`` for a continuous one.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    states: tuple[str, ...]
    sample_time_s: float | None = None

    def __post_init__(self) -> None:
        self._set(**{name: read_only(getattr(self, name), np.float64, ndim=2) for name in "ABCD"})

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        """Frequency response, shape ``(y, u, f)``; of a sampled model at ``exp(j omega T)``."""
        jw = 1j * np.asarray(omega_rad_s)[:, None, None]
        at = jw if self.sample_time_s is None else np.exp(jw * self.sample_time_s)
        states = np.linalg.solve(at * np.eye(len(self.A)) - self.A, np.broadcast_to(self.B, (len(at), *self.B.shape)))
        response: ComplexArray = np.moveaxis(np.asarray(self.C @ states + self.D, dtype=np.complex128), 0, -1)
        return response

    def poles(self) -> ComplexArray:
        """Eigenvalues of ``A``."""
        return np.linalg.eigvals(self.A).astype(np.complex128)


def rational(
    system: StateSpace,
    *,
    delays: Delays = "states",
    pade_order: int = 4,
    sample_rate_hz: float | None = None,
    states: Sequence[str] = (),
) -> RationalModel:
    """A model without delays.

    Parameters
    ----------
    system
        The model with its delays.
    delays
        What becomes of them.
    pade_order
        Order of their approximation as states; of a sampled model they are exact.
    sample_rate_hz
        Rate of a sampled model, exact for inputs that are held between samples; continuous without it.
    states
        Names of the states. Where some of them are algebraic the others are mixed, and have numbers.

    Raises
    ------
    UsageError
        The order or the rate is out of range, or there is no such treatment of delays.
    ModelError
        The model has no proper state space.

    Examples
    --------
    >>> one = np.ones((1, 1))
    >>> lag = StateSpace(M=0.1 * one, F=-one, G=one, H0=one, H1=0.0 * one,
    ...                  input_delays_s=np.array([0.012]), output_delays_s=np.zeros(1))
    >>> model = rational(lag, pade_order=2, states=["x"])
    >>> model.states, bool(abs(model.response([20.0]) - lag.response([20.0])).max() < 2e-6)
    (('x', 'u1_delay_1', 'u1_delay_2'), True)
    >>> rational(lag, sample_rate_hz=100.0, states=["x"]).states
    ('x', 'u1_before_1', 'u1_before_2')
    """
    if delays not in get_args(Delays):
        raise unknown_name("treatment of delays", str(delays), get_args(Delays))
    if not 1 <= pade_order <= _HIGHEST_ORDER:
        raise UsageError(f"the Padé order {pade_order} is out of range", needed=f"1 to {_HIGHEST_ORDER}")
    if sample_rate_hz is not None and not (math.isfinite(sample_rate_hz) and sample_rate_hz > 0.0):
        raise UsageError(f"the sample rate {sample_rate_hz:g} Hz is not positive")
    plant = system.proper()
    order = len(plant[0])
    names = tuple(states) if len(states) == order else tuple(f"x{number}" for number in range(1, order + 1))
    before, behind = input_output_delays(system)
    step_s = None if sample_rate_hz is None else 1.0 / sample_rate_hz
    if delays == "states" and step_s is not None:
        return _with_past_inputs(plant, names, before, behind, step_s)
    if delays != "none":
        own = [(before, "u"), (behind, "y")]
        chains = [_chain(late, letter, None if delays == "lag" else pade_order) for late, letter in own]
        plant = _series(_series(chains[0][0], plant), chains[1][0])
        # In the order of the blocks of the series: inputs, plant, outputs; the plant is moved to the front.
        ahead = len(chains[0][1])
        plant = _reordered(plant, [*range(ahead, ahead + order), *range(ahead), *range(ahead + order, len(plant[0]))])
        names = (*names, *chains[0][1], *chains[1][1])
    if step_s is not None:
        return _with_past_inputs(plant, names, np.zeros_like(before), np.zeros_like(behind), step_s)
    A, B, C, D = plant
    return RationalModel(A=A, B=B, C=C, D=D, states=names)


_HIGHEST_ORDER = 10


def input_output_delays(system: StateSpace) -> tuple[FloatArray, FloatArray]:
    """Delays of inputs and outputs, none of them negative; what all outputs share is at the inputs."""
    before, behind = np.maximum(system.input_delays_s, 0.0), np.maximum(system.output_delays_s, 0.0)
    shared = behind.min(initial=np.inf)
    return (before + shared, behind - shared) if behind.size else (before, behind)


PHASE_ERROR_DEG = 0.01
"""Of a Padé approximation that counts as right: a tenth of what a phase margin may be off by. Where the phase is flat,
gain margins move by one percent in a tenth of a degree."""

USUAL_BAND_RAD_S = (1.0, 50.0)
"""Where a model was not fitted to responses."""

_BEYOND = 10.0
"""Over the end of the band: no crossover is looked for beyond."""


def right_up_to(system: StateSpace, band_rad_s: tuple[float, float] | None) -> float:
    """Frequency up to which the phase of a model matters, rad/s.

    That is the end of its band, or the highest frequency beyond at which the gain of a response is one, or its first
    phase of -180 degrees after that: the crossovers of a loop that is closed around the model alone.

    Parameters
    ----------
    system
        With delays.
    band_rad_s
        Where it was fitted; ``None`` where that was not to responses.
    """
    low, high = band_rad_s or USUAL_BAND_RAD_S
    omega = np.geomspace(0.1 * low, _BEYOND * high, _POINTS)
    response = system.response(omega)
    found = high
    for row in response.reshape(-1, omega.size):
        gain = np.abs(row)
        crossed = np.flatnonzero(np.diff(np.sign(gain - 1.0)) != 0.0)
        if not crossed.size:
            continue
        # The first real and negative value beyond the last crossover, where the imaginary part changes its sign.
        beyond = row[crossed[-1] + 1 :]
        turned = np.flatnonzero((np.diff(np.sign(beyond.imag)) != 0.0) & (beyond.real[1:] < 0.0))
        last = crossed[-1] + 1 + (turned[0] + 1 if turned.size else 0)
        found = max(found, float(omega[min(last, omega.size - 1)]))
    return found


_POINTS = 1500


def pade_phase_error(system: StateSpace, order: int, up_to_rad_s: float) -> float:
    """Largest error of the phase of any response with Padé approximations of an order, rad.

    Parameters
    ----------
    system
        With delays; negative ones count as none.
    order
        Of each of its delays.
    up_to_rad_s
        End of the frequencies that are compared.
    """
    before, behind = input_output_delays(system)
    omega = np.geomspace(1e-2, 1.0, _ERROR_POINTS) * up_to_rad_s
    errors = [_phase_errors(delays, order, omega) for delays in (behind, before)]
    both = errors[0][:, None] + errors[1]
    return float(np.abs(both).max(initial=0.0))


_ERROR_POINTS = 60


@np.errstate(over="ignore", invalid="ignore")  # a document may name a band or a delay without bounds
def _phase_errors(delays_s: FloatArray, order: int, omega_rad_s: FloatArray) -> FloatArray:
    """Phase of the approximation less that of the delay, shape ``(delays, f)``, followed from low frequencies up."""
    x = 1j * delays_s[:, None] * omega_rad_s
    powers = range(order + 1)
    under = sum(_coefficient(order, k) * x**k for k in powers)
    over = sum(_coefficient(order, k) * (-x) ** k for k in powers)
    return np.asarray(np.unwrap(np.angle(over / under), axis=1) + delays_s[:, None] * omega_rad_s)


def sufficient_order(system: StateSpace, up_to_rad_s: float, *, error_deg: float = PHASE_ERROR_DEG) -> int:
    """The lowest order of Padé approximations whose phase is right up to a frequency; at most ten.

    Parameters
    ----------
    system
        With delays.
    up_to_rad_s
        See :func:`right_up_to`.
    error_deg
        How far the phase of any response may be off.

    Examples
    --------
    >>> one = np.ones((1, 1))
    >>> lag = StateSpace(M=0.1 * one, F=-one, G=one, H0=one, H1=0.0 * one,
    ...                  input_delays_s=np.array([0.012]), output_delays_s=np.zeros(1))
    >>> sufficient_order(lag, 50.0), sufficient_order(lag, 200.0)
    (2, 4)
    """
    limit = math.radians(error_deg)
    orders = range(1, _HIGHEST_ORDER + 1)
    return next((order for order in orders if pade_phase_error(system, order, up_to_rad_s) <= limit), _HIGHEST_ORDER)


def delay_error(system: StateSpace, model: RationalModel, omega_rad_s: FloatArray) -> float:
    """Largest difference of the responses of a model with and without delays, relative to the response.

    Parameters
    ----------
    system
        With delays; negative ones count as none.
    model
        Without.
    omega_rad_s
        Where they are compared.
    """
    exact = StateSpace(
        **{name: getattr(system, name) for name in ("M", "F", "G", "H0", "H1")},
        input_delays_s=np.maximum(system.input_delays_s, 0.0),
        output_delays_s=np.maximum(system.output_delays_s, 0.0),
    ).response(omega_rad_s)
    size = np.abs(exact)
    there = size > _NOTHING * size.max(initial=0.0)
    off = np.abs(model.response(omega_rad_s) - exact)
    return float((off[there] / size[there]).max(initial=0.0))


_NOTHING = 1e-9


def pade(delay_s: float, order: int) -> Quadruple:
    """Padé's approximation of a delay; a delay of zero has no states.

    Parameters
    ----------
    delay_s
        Seconds.
    order
        Number of states.

    Examples
    --------
    >>> A, B, C, D = pade(0.1, 1)
    >>> A.round(9).tolist(), (B * C).round(9).tolist(), D.tolist()
    ([[-20.0]], [[40.0]], [[-1.0]])
    """
    if delay_s == 0.0:
        return _gain(1)
    under = np.array([_coefficient(order, k) for k in range(order + 1)])
    under /= under[-1]
    # In units in which the product of the poles is one: the coefficients of high orders are far apart.
    scale = under[0] ** (1.0 / order)
    under = under * scale ** (np.arange(order + 1) - order)
    over = under * (-1.0) ** np.arange(order + 1)
    direct = over[-1]
    A = np.diag(np.ones(order - 1), 1)
    A[-1] = -under[:-1]
    B = np.zeros((order, 1))
    B[-1] = 1.0
    rate = scale / delay_s
    return rate * A, rate * B, (over - direct * under)[None, :-1], np.array([[direct]])


def _coefficient(order: int, power: int) -> float:
    """Of a power in the denominator of the approximation."""
    return math.comb(order, power) * math.factorial(2 * order - power) / math.factorial(2 * order)


def _gain(count: int) -> Quadruple:
    return np.zeros((0, 0)), np.zeros((0, count)), np.zeros((count, 0)), np.eye(count)


def _lag(delay_s: float) -> Quadruple:
    rate = np.array([[1.0 / delay_s]])
    return -rate, rate, np.ones((1, 1)), np.zeros((1, 1))


def _chain(delays_s: FloatArray, letter: str, order: int | None) -> tuple[Quadruple, list[str]]:
    """Delays side by side, as states or (without an order) as lags, and the names of their states."""
    from scipy.linalg import block_diag

    parts, names = [], []
    for number, delay_s in enumerate(delays_s.tolist(), start=1):
        part = _gain(1) if delay_s == 0.0 else _lag(delay_s) if order is None else pade(delay_s, order)
        parts.append(part)
        names += [f"{letter}{number}_delay_{state}" for state in range(1, len(part[0]) + 1)]
    found: list[FloatArray] = [np.asarray(block_diag(*blocks)) for blocks in zip(*parts, strict=True)]
    states, count = len(names), len(delays_s)
    shapes = ((states, states), (states, count), (count, states), (count, count))
    A, B, C, D = (block.reshape(shape) for block, shape in zip(found, shapes, strict=True))
    return (A, B, C, D), names


def _series(first: Quadruple, second: Quadruple) -> Quadruple:
    """The second system behind the first."""
    A1, B1, C1, D1 = first
    A2, B2, C2, D2 = second
    return (
        np.block([[A1, np.zeros((len(A1), len(A2)))], [B2 @ C1, A2]]),
        np.vstack([B1, B2 @ D1]),
        np.hstack([D2 @ C1, C2]),
        D2 @ D1,
    )


def _reordered(system: Quadruple, order: Sequence[int]) -> Quadruple:
    A, B, C, D = system
    return A[np.ix_(order, order)], B[list(order)], C[:, list(order)], D


def _with_past_inputs(
    plant: Quadruple, names: Sequence[str], before: FloatArray, behind: FloatArray, step_s: float
) -> RationalModel:
    """Sampled, with the last inputs as states; outputs of other delays have a copy of the system each."""
    from scipy.linalg import block_diag

    A, B, C, D = plant
    late = sorted(set(behind.tolist())) or [0.0]
    blocks, states = [], []
    for copy, delay_s in enumerate(late):
        own = behind == delay_s
        part, memory = _step((A, B, C[own], D[own]), before + delay_s, step_s)
        blocks.append(part)
        states += [f"{name}{f'_copy_{copy}' if copy else ''}" for name in (*names, *memory)]
    outputs = np.argsort(np.concatenate([np.flatnonzero(behind == delay_s) for delay_s in late]))
    return RationalModel(
        A=np.asarray(block_diag(*(part[0] for part in blocks))).reshape(len(states), len(states)),
        B=np.vstack([part[1] for part in blocks]),
        C=np.asarray(block_diag(*(part[2] for part in blocks))).reshape(len(C), len(states))[outputs],
        D=np.vstack([part[3] for part in blocks])[outputs],
        states=tuple(states),
        sample_time_s=step_s,
    )


def _step(plant: Quadruple, delays_s: FloatArray, step_s: float) -> tuple[Quadruple, list[str]]:
    """One step of a system with delayed inputs, their last samples as states behind its own."""
    A, B, C, D = plant
    found = discretize(A, B, delays_s=delays_s, step_s=step_s, hold="zero")
    order, inputs = B.shape
    cells = [int(lag + (older > 0.0)) for lag, older in zip(found.lags, found.weights[0], strict=True)]
    size = order + sum(cells)
    moved, taken = np.zeros((size, size)), np.zeros((size, inputs))
    shown, direct = np.zeros((len(C), size)), np.zeros((len(C), inputs))
    moved[:order, :order], shown[:, :order] = found.transition, C
    names: list[str] = []
    first = order
    for j, (lag, count) in enumerate(zip(found.lags.tolist(), cells, strict=True)):
        # A sample so many steps old: the input itself, then one cell after the other.
        for tap, age in ((0, lag + 1), (1, lag)):
            if age > count:
                continue
            weight = found.weights[tap, j]
            into, out = (
                (taken[:, j], direct[:, j]) if age == 0 else (moved[:, first + age - 1], shown[:, first + age - 1])
            )
            into[:order] += found.taps[tap, j]
            out += weight * D[:, j]
        if count:
            taken[first, j] = 1.0
            moved[range(first + 1, first + count), range(first, first + count - 1)] = 1.0
        names += [f"u{j + 1}_before_{age}" for age in range(1, count + 1)]
        first += count
    return (moved, taken, shown, direct), names
