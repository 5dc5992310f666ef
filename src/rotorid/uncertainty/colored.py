"""Colored residuals: covariance of parameters when errors have memory, as in every real flight, and draws of them.

The residuals of a fit in time are described by a vector autoregression. With it the textbook covariance, which holds
for white errors and is several times too small in flight, is corrected; and from it, or from blocks of the residuals
themselves, a bootstrap draws new errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from rotorid.errors import InsufficientDataError
from rotorid.fitting.problem import Part
from rotorid.typing import ComplexArray, FloatArray

_LONGEST_MEMORY = 40
_SAMPLES_PER_LAG = 10
_ROUNDS = 4
_AT_REST = 1e-6
"""Of the power of the residuals: what rounds still add of that changes no order and no covariance."""
_AS_SURPRISING = 1.5
"""What a fit takes is slow. Given back, it hardly changes what no sample before foretells; where that grows by more,
the products are of no process any more."""
_NEGLIGIBLE = 0.02
_SAME_RATE = 1.1
"""Largest ratio of sample rates at which records share an autoregression."""


class ColoredCovariance(NamedTuple):
    """Covariance of the free parameters, shape ``(p, p)`` each.

    Parameters
    ----------
    corrected
        For the color of the residuals.
    white
        As it would be, were the residuals white: what textbooks print, and several times too small in flight.
    ar_order
        Order of the autoregression that describes the color; of several, the highest.
    """

    corrected: FloatArray
    white: FloatArray
    ar_order: int


def colored_covariance(parts: Sequence[Part]) -> ColoredCovariance:
    r"""Covariance of least-squares estimates whose residuals are a stationary process of any color.

    .. math:: \mathrm{Cov} = D \Big[ \sum_i S_i^T \sum_j \mathcal R(i-j) S_j \Big] D, \qquad
        D = \Big( \sum_i S_i^T S_i \Big)^{-1}

    for whitened sensitivities :math:`S` (:math:`R^{-1/2}` times the derivatives of the outputs) and the
    autocovariance :math:`\mathcal R` of the errors. It is that of a vector autoregression, its order chosen by the
    corrected information criterion of Akaike: products of single lags scatter so much that their double sum need not
    even be positive.

    A fit takes from the residuals what looks like its parameters, and slow errors look like them most. With P the
    projection on parameters and unknowns, :math:`E[r r^T] = (I - P) \Sigma (I - P)`: what is missing is computed for
    the autoregression found so far and given back, until it rests. Where no process is left, nothing is given back.

    Records of one sample rate share an autoregression; errors that last as long are another one at another rate.

    Parameters
    ----------
    parts
        Whitened residuals, slopes and unknowns of each record, see :class:`rotorid.fitting.problem.Part`. A part of a
        single row is what was known before, and has the size that its whitening says.

    Raises
    ------
    InsufficientDataError
        The data do not determine all parameters.

    Notes
    -----
    Assumes errors that do not depend on the inputs. A structure that is wrong leaves residuals that do; then the
    covariance describes scatter about the best wrong model only.

    References
    ----------
    Morelli and Klein, *Accuracy of Aerodynamic Model Parameters Estimated from Flight Test Data*, Journal of Guidance,
    Control, and Dynamics 20(1), 1997, for the sum.
    """
    D, residual_dof = _inverse_information(parts)
    return _corrected(parts, residual_processes(parts), D, residual_dof)


def _corrected(
    parts: Sequence[Part], processes: Sequence[Process], D: FloatArray, residual_dof: int
) -> ColoredCovariance:
    middle = sum(
        (_middle(part.slopes, process) for part, process in zip(parts, processes, strict=True)),
        start=np.zeros_like(D),
    )
    white = D * float(sum(np.sum(part.residual**2) for part in parts)) / residual_dof
    ar_order = max(len(process.coefficients) for process in processes)
    return ColoredCovariance(corrected=D @ middle @ D, white=white, ar_order=ar_order)


def residual_processes(parts: Sequence[Part]) -> tuple[Process, ...]:
    """For each part the autoregression of its errors, with what the fit took from the residuals given back.

    Parts of one sample rate have one in common.

    Parameters
    ----------
    parts
        As in :func:`colored_covariance`.

    Raises
    ------
    InsufficientDataError
        The data do not determine all parameters.
    """
    parameters = parts[0].slopes.shape[2]
    D, _ = _inverse_information(parts)
    root = np.linalg.cholesky((D + D.T) / 2.0)
    taken = [np.concatenate([part.unknown, part.slopes @ root], axis=2) for part in parts]
    processes = plain = _of_each(parts, None)
    given = [np.zeros(()) for _ in parts]
    power = sum(float(np.sum(part.residual**2)) for part in parts)
    for _ in range(_ROUNDS if _matters(taken, parameters) else 0):
        missing = _missing(taken, processes, parameters)
        moved = float(np.sqrt(sum(np.sum((m - g) ** 2) for m, g in zip(missing, given, strict=True))))
        processes, given = _of_each(parts, missing), missing
        if any(
            _surprise(one) > _AS_SURPRISING * _surprise(before) for one, before in zip(processes, plain, strict=True)
        ):
            # Errors outlast the record: rounds jump by ten times, where residuals alone err by two.
            return plain
        if moved <= _AT_REST * power:
            break
    return processes


def _surprise(process: Process) -> float:
    """Power of what no sample before foretells."""
    return float(np.trace(process.noise))


def _of_each(parts: Sequence[Part], missing: Sequence[FloatArray] | None) -> tuple[Process, ...]:
    """The autoregression of each part, shared by all parts of about one sample rate."""
    rows = [place for place, part in enumerate(parts) if len(part.residual) > 1]
    found = {place: _process_of_part(part.residual) for place, part in enumerate(parts) if place not in rows}
    for group in _by_rate([parts[place].sample_rate_hz for place in rows]):
        places = [rows[place] for place in group]
        lacks = None if missing is None else np.sum([missing[place] for place in places], axis=0)
        found |= dict.fromkeys(places, autoregression([parts[place].residual for place in places], missing=lacks))
    return tuple(found[place] for place in range(len(parts)))


def _by_rate(rates_hz: Sequence[float]) -> list[list[int]]:
    """Places of records whose sample rates are about the same, those of the lowest rate first."""
    groups: list[list[int]] = []
    for place in sorted(range(len(rates_hz)), key=lambda place: rates_hz[place]):
        if groups and rates_hz[place] <= _SAME_RATE * rates_hz[groups[-1][0]]:
            groups[-1].append(place)
        else:
            groups.append([place])
    return groups


def _inverse_information(parts: Sequence[Part]) -> tuple[FloatArray, int]:
    r""":math:`D`, and by how many the residuals are more than the numbers fitted to them."""
    parameters = parts[0].slopes.shape[2]
    flat = np.concatenate([part.slopes.reshape(-1, parameters) for part in parts])
    size = np.linalg.norm(flat, axis=0)
    residual_dof = flat.shape[0] - sum(part.unknown.shape[2] for part in parts) - parameters
    if not (size > 0.0).all() or residual_dof <= 0:
        raise InsufficientDataError("a parameter has no effect on the records", remedy="fix it or drop it")
    return np.linalg.inv((flat / size).T @ (flat / size)) / np.outer(size, size), residual_dof


def colored_by_part(parts: Sequence[Part]) -> ColoredCovariance:
    """The same where each part has errors of a color of its own: equations of different kind, fitted together.

    What the fit took from the residuals is not given back: parts should be long beside the number of parameters.
    A part of a single row has the size that its whitening says.

    Raises
    ------
    InsufficientDataError
        The data do not determine all parameters.
    """
    D, residual_dof = _inverse_information(parts)
    return _corrected(parts, [_process_of_part(part.residual) for part in parts], D, residual_dof)


def _process_of_part(residual: FloatArray) -> Process:
    if len(residual) == 1:
        outputs = residual.shape[1]
        return Process(np.zeros((0, outputs, outputs)), np.eye(outputs))
    return autoregression([residual])


class Process(NamedTuple):
    r"""A vector autoregression :math:`e_k = \sum_i A_i e_{k-i} + w_k`.

    Parameters
    ----------
    coefficients
        :math:`A`, shape ``(order, y, y)``; stable.
    noise
        Covariance of :math:`w`, shape ``(y, y)``.
    """

    coefficients: FloatArray
    noise: FloatArray


def _matters(taken: Sequence[FloatArray], parameters: int) -> bool:
    """Whether a fit takes a noticeable share of the power within as narrow a band as the longest memory resolves."""
    numbers = parameters + sum(basis.shape[2] - parameters for basis in taken)
    return bool(numbers * _LONGEST_MEMORY > _NEGLIGIBLE * sum(basis[:, :, 0].size for basis in taken))


_MOST_NUMBERS = 4_000_000


def _missing(taken: Sequence[FloatArray], processes: Sequence[Process], parameters: int) -> list[FloatArray]:
    """Loss of the sums of products of residuals by a fit: for each record all lags, shape ``(lags, y, y)``."""
    late = [_colored(basis, process) for basis, process in zip(taken, processes, strict=True)]
    inner = [_products(basis, lagged) for basis, lagged in zip(taken, late, strict=True)]
    # Parameters are shared by all records, unknowns are not.
    shared = sum((values[-parameters:, -parameters:] for values in inner), start=np.zeros((parameters, parameters)))
    for values in inner:
        values[-parameters:, -parameters:] = shared
    return [
        _lagged_products(basis, lagged - 0.5 * basis @ values.T, _LONGEST_MEMORY)
        for basis, lagged, values in zip(taken, late, inner, strict=True)
    ]


def _lagged_products(one: FloatArray, other: FloatArray, longest: int) -> FloatArray:
    r"""Sums of products at all lags :math:`l`, :math:`\sum_{k m} (a_{k+l,im} b_{kjm} + b_{k+l,im} a_{kjm})`.

    Parameters
    ----------
    one, other
        Shape ``(n, y, m)``.
    longest
        Lag up to which they are wanted.

    Returns
    -------
    numpy.ndarray
        Shape ``(longest + 1, y, y)``.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    samples, outputs, columns = one.shape
    size = next_fast_len(samples + longest, real=True)
    spectrum = np.zeros((size // 2 + 1, outputs, outputs), dtype=np.complex128)
    at_once = max(1, _MOST_NUMBERS // (size * outputs))
    for first in range(0, columns, at_once):
        a, b = (rfft(each[:, :, first : first + at_once], size, axis=0) for each in (one, other))
        product = a @ np.conj(np.swapaxes(b, 1, 2))
        spectrum += product + np.conj(np.swapaxes(product, 1, 2))
    found = irfft(spectrum, size, axis=0)[: longest + 1]
    # Beyond the record there are no products, only rounding.
    found[samples:] = 0.0
    return np.asarray(found)


def autoregression(residuals: Sequence[FloatArray], *, missing: FloatArray | None = None) -> Process:
    """Vector autoregression of residuals by Yule and Walker's equations, its order by information criterion.

    Parameters
    ----------
    residuals
        One array ``(n, y)`` for each record; means are taken as they are.
    missing
        What the sums of products lack of their expectation, lag by lag, shape ``(lags, y, y)``; nothing by default.

    Examples
    --------
    >>> from scipy.signal import lfilter
    >>> noise = np.random.default_rng(0).standard_normal(4000)
    >>> process = autoregression([lfilter([1.0], [1.0, -0.8], noise)[:, None]])
    >>> len(process.coefficients), round(float(process.coefficients[0, 0, 0]), 1)
    (1, 0.8)
    """
    outputs = residuals[0].shape[1]
    count = sum(len(residual) for residual in residuals)
    limit = max(1, min(_LONGEST_MEMORY, count // _SAMPLES_PER_LAG, *(len(residual) // 2 for residual in residuals)))
    lags = []
    for lag in range(limit + 1):
        total = sum(
            (residual[lag:].T @ residual[: len(residual) - lag] for residual in residuals),
            start=np.zeros((outputs, outputs)),
        )
        if missing is not None:
            total = total + missing[lag]
        lags.append(total / (count - lag * len(residuals)))
    sums = np.stack(lags)
    together = _fitted(sums, count)
    if outputs == 1:
        return together.process
    separate = _separate(np.einsum("kyy->ky", sums), count)
    # Barely correlated outputs are better described separately, each with its own memory.
    return separate.process if separate.criterion < together.criterion else together.process


class _Fitted(NamedTuple):
    process: Process
    criterion: float


def _fitted(lags: FloatArray, count: int) -> _Fitted:
    """The order of least corrected information criterion for autocovariances ``(lags, y, y)``."""
    outputs = lags.shape[1]
    best, lowest = Process(np.zeros((0, outputs, outputs)), lags[0]), np.inf
    for order, process in enumerate(_whittle(lags)):
        free = order * outputs**2
        spare = max(count * outputs - free - outputs, 1)
        criterion = count * float(np.linalg.slogdet(process.noise)[1]) + 2.0 * free * count * outputs / spare
        if criterion < lowest:
            best, lowest = process, criterion
    return _Fitted(best, lowest)


def _separate(lags: FloatArray, count: int) -> _Fitted:
    """The same for each output alone, of autocovariances ``(lags, y)``: the criterion is that of all."""
    outputs = lags.shape[1]
    coefficients, noise = np.zeros((0, outputs)), lags[0]
    best, of_best, lowest, longest = np.zeros_like(lags[1:]), noise, np.full(outputs, np.inf), 0
    stable = np.ones(outputs, dtype=np.bool_)
    for order in range(len(lags)):
        if order:
            delta = lags[order] - (coefficients * lags[order - 1 : 0 : -1]).sum(axis=0)
            reflection = np.divide(delta, noise, out=np.zeros(outputs), where=noise > 0.0)
            coefficients = np.vstack([coefficients - reflection * coefficients[::-1], reflection])
            noise = noise - reflection * delta
            stable &= noise > 0.0
        spare = max(count - order - 1, 1)
        with np.errstate(divide="ignore", invalid="ignore"):
            criterion = np.where(stable, count * np.log(noise) + 2.0 * order * count / spare, np.inf)
        lower = criterion < lowest
        if lower.any():
            best[:order, lower], longest = coefficients[:, lower], order
            of_best, lowest = np.where(lower, noise, of_best), np.where(lower, criterion, lowest)
    return _Fitted(Process(best[:longest, :, None] * np.eye(outputs), np.diag(of_best)), float(lowest.sum()))


def _whittle(lags: FloatArray) -> list[Process]:
    """Whittle's recursion: the autoregressions of all orders, each from the one before, while they are stable."""
    outputs = lags.shape[1]
    forward, backward = np.zeros((0, outputs, outputs)), np.zeros((0, outputs, outputs))
    ahead, behind = lags[0], lags[0]
    found = [Process(forward, ahead)]
    for order in range(1, len(lags)):
        delta = lags[order] - (forward @ lags[order - 1 : 0 : -1]).sum(axis=0)
        A, B = np.linalg.solve(behind.T, delta.T).T, np.linalg.solve(ahead.T, delta).T
        forward, backward = (
            np.concatenate([forward - A @ backward[::-1], A[None]]),
            np.concatenate([backward - B @ forward[::-1], B[None]]),
        )
        ahead, behind = ahead - A @ delta.T, behind - B @ delta
        ahead, behind = (ahead + ahead.T) / 2.0, (behind + behind.T) / 2.0
        if min(np.linalg.eigvalsh(ahead)[0], np.linalg.eigvalsh(behind)[0]) <= 0.0:
            break
        found.append(Process(forward, ahead))
    return found


def _middle(slopes: FloatArray, process: Process) -> FloatArray:
    r""":math:`S^T \Sigma S` of one record."""
    return _products(slopes, _colored(slopes, process))


def _products(one: FloatArray, other: FloatArray) -> FloatArray:
    """Sums over samples and outputs of products of columns ``(n, y, a)`` and ``(n, y, b)``, shape ``(a, b)``."""
    return np.asarray(one.reshape(-1, one.shape[2]).T @ other.reshape(-1, other.shape[2]))


def _colored(columns: FloatArray, process: Process) -> FloatArray:
    r""":math:`\Sigma` times columns ``(n, y, m)``: the covariance of a stationary process from its spectrum."""
    from scipy.fft import irfft, next_fast_len, rfft

    samples, outputs, _ = columns.shape
    length = next_fast_len(2 * samples, real=True)
    polynomial = np.concatenate([np.eye(outputs)[None], -process.coefficients])
    inverse = np.linalg.inv(rfft(polynomial, n=length, axis=0))
    spectrum = inverse @ process.noise @ np.conj(np.swapaxes(inverse, 1, 2))
    whole: FloatArray = irfft(spectrum @ rfft(columns, n=length, axis=0), n=length, axis=0)
    return whole[:samples]


class OutputNoise(Protocol):
    """Draws whitened errors of all records, shape ``(n, y)`` each."""

    def draw(self, rng: np.random.Generator) -> tuple[FloatArray, ...]:
        """One draw."""
        ...


@dataclass(frozen=True, eq=False)
class ColoredNoise:
    r"""Draws of a vector autoregression :math:`e_k = \sum_i A_i e_{k-i} + w_k` with normal :math:`w`.

    Drawn by its spectrum over twice the length of a record, so that it is stationary from the first sample on.

    Parameters
    ----------
    processes
        Of each record stable coefficients and the covariance of the noise.
    samples
        Of each record.

    Examples
    --------
    >>> process = Process(np.array([[[0.8]]]), np.array([[1.0]]))
    >>> (e,) = ColoredNoise((process,), (20000,)).draw(np.random.default_rng(0))
    >>> round(float(np.mean(e[1:] * e[:-1]) / np.mean(e**2)), 1)
    0.8
    """

    processes: tuple[Process, ...]
    samples: tuple[int, ...]

    @classmethod
    def of(cls, parts: Sequence[Part]) -> ColoredNoise:
        """The processes of the errors of a fit, with what the fit took from its residuals given back."""
        return cls(residual_processes(parts), tuple(len(part.residual) for part in parts))

    @classmethod
    def by_part(cls, parts: Sequence[Part]) -> ColoredNoise:
        """A process for each part, as of equations of different kind; what the fit took is not given back."""
        return cls(
            tuple(_process_of_part(part.residual) for part in parts), tuple(len(part.residual) for part in parts)
        )

    def draw(self, rng: np.random.Generator) -> tuple[FloatArray, ...]:
        """One draw of all records, shape ``(n, y)`` each."""
        return tuple(
            _drawn(process, samples, rng) for process, samples in zip(self.processes, self.samples, strict=True)
        )


def _drawn(process: Process, samples: int, rng: np.random.Generator) -> FloatArray:
    from scipy.fft import irfft, next_fast_len, rfft

    length = int(next_fast_len(2 * samples, real=True))
    white = rng.standard_normal((length, len(process.noise)))
    color = rfft(white, axis=0)[:, :, None]
    drawn = irfft((_filter(process, length) @ color)[:, :, 0], n=length, axis=0)
    return np.asarray(drawn[:samples], dtype=np.float64)


def _filter(process: Process, length: int) -> ComplexArray:
    """From white noise to the process, shape ``(length // 2 + 1, y, y)``."""
    from scipy.fft import rfft

    polynomial = np.concatenate([np.eye(len(process.noise))[None], -process.coefficients])
    root = np.linalg.cholesky(process.noise)
    return np.asarray(np.linalg.solve(rfft(polynomial, n=length, axis=0), root.astype(np.complex128)))
