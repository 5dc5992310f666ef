r"""A late lag fitted to the finite Fourier transforms of records, with the noise weighed as it is.

.. math:: Y(\omega) = G(\omega)\, e^{-j\omega\tau}\, U(\omega)
    + \frac{\sum_k c_k z^{-k}}{\prod_i (1 - e^{p_i T} z^{-1})} + V(\omega), \qquad E|V|^2 = S(\omega)

The second term is what a record of finite length adds: the state at its start and at its end. It is eliminated by
projection. The spectrum :math:`S` is that of the residuals, so that colored noise widens the interval as it should
(Whittle, *Estimation and information in stationary time series*, Arkiv för Matematik, 1953; Pintelon and Schoukens,
*System Identification: A Frequency Domain Approach*, 2012, chapters 6 and 9).

A long record has more spectral lines than it needs, and neighboring ones are merged. Within a narrow group a response
is straight, :math:`G(\omega) = \varphi_a(\omega)\, G(\omega_a) + \varphi_b(\omega)\, G(\omega_b)`, and so is what the
ends of the record add. All that the lines of the group say about four numbers, two of each, is in the four equations
:math:`Q^H Y = R\, x` of the decomposition :math:`Q R` of their coefficients. A group is 1 % of its frequency wide, over
which straight is true to :math:`10^{-4}` for lags of an order up to three.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from rotorid.data.base import Immutable, read_only
from rotorid.data.record import TimeHistory
from rotorid.fitting.delay.fit import DelayedLag, InputHold, hold_spectrum, real
from rotorid.typing import ComplexArray, FloatArray

MOST_LINES = 4000
"""Of shorter records every line is an equation of its own."""

_WIDTH = 0.01
_FEWEST_MERGED = 8
UNKNOWNS = 4
_NODE = 1.0 / np.sqrt(2.0)
_CACHED = 64
"""Shifts whose equations are kept; a search comes back to the same few dozen."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Equations(Immutable):
    """Equations of one record at one shift of its input: ``output = drive * G(nodes) + ends * E(nodes)``.

    Parameters
    ----------
    output
        Shape ``(r,)``.
    drive, ends
        Coefficients at the two nodes of each equation, shape ``(2, r)``.
    left
        Power of the output that no response which is straight within a group explains, shape ``(g,)``.
    """

    output: ComplexArray
    drive: ComplexArray
    ends: ComplexArray
    left: FloatArray

    def __post_init__(self) -> None:
        self._set(
            output=read_only(self.output, np.complex128, ndim=1),
            drive=read_only(self.drive, np.complex128, ndim=2),
            ends=read_only(self.ends, np.complex128, ndim=2),
            left=read_only(self.left, np.float64, ndim=1),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordPart(Immutable):
    """Finite Fourier transforms of one record, ready for any shift of the input by whole samples.

    Parameters
    ----------
    sample_s
        Sample interval.
    hold
        How the input goes on between its samples.
    omega_rad_s
        Lines of the transform that are used, shape ``(f,)``.
    bins
        Their numbers, shape ``(f,)``.
    output
        Transform of the output, shape ``(f,)``.
    drive
        Transform of the input in the window of the output, shape ``(f,)``.
    input
        Samples of the input, with a margin for the shifts on either side.
    first
        Sample of ``input`` with which the window of the output begins.
    count
        Samples in the window.
    edges
        Lines with which groups of merged lines begin, and the number of lines at the end, shape ``(g + 1,)``; lines
        before the first of them stand alone.
    """

    sample_s: float
    hold: InputHold
    omega_rad_s: FloatArray
    bins: NDArray[np.int64]
    output: ComplexArray
    drive: ComplexArray
    input: FloatArray
    first: int
    count: int
    edges: NDArray[np.int64]

    def __post_init__(self) -> None:
        self._set(
            omega_rad_s=read_only(self.omega_rad_s, np.float64, ndim=1),
            bins=read_only(self.bins, np.int64, ndim=1),
            output=read_only(self.output, np.complex128, ndim=1),
            drive=read_only(self.drive, np.complex128, ndim=1),
            input=read_only(self.input, np.float64, ndim=1),
            edges=read_only(self.edges, np.int64, ndim=1),
        )

    @property
    def lines(self) -> int:
        """Lines that are used."""
        return self.omega_rad_s.size

    @property
    def single_lines(self) -> int:
        """Lines that are equations of their own."""
        return int(self.edges[0])

    @property
    def groups(self) -> int:
        """Groups of merged lines."""
        return self.edges.size - 1

    @cached_property
    def nodes_rad_s(self) -> FloatArray:
        """Where a response must be known: single lines, then the lower and the upper nodes of the groups."""
        middle, half = self._spans
        return np.concatenate([self.omega_rad_s[: self.single_lines], middle - _NODE * half, middle + _NODE * half])

    @cached_property
    def places(self) -> NDArray[np.int64]:
        """Nodes of each equation, shape ``(2, r)``."""
        single = np.arange(self.single_lines)
        low = self.single_lines + np.repeat(np.arange(self.groups), UNKNOWNS)
        return np.stack([np.concatenate([single, low]), np.concatenate([single, low + self.groups])])

    @cached_property
    def line_of(self) -> NDArray[np.int64]:
        """A line of each equation, to look up its noise, shape ``(r,)``."""
        return np.concatenate([np.arange(self.single_lines), np.repeat(self.edges[:-1], UNKNOWNS)])

    def at_rows(self, coefficients: ComplexArray, nodes: ComplexArray) -> ComplexArray:
        """Values at nodes, shape ``(..., n)``, as the equations see them, shape ``(..., r)``."""
        low, high = self.places
        return np.asarray(coefficients[0] * nodes[..., low] + coefficients[1] * nodes[..., high])

    def input_lines(self, samples: int) -> ComplexArray:
        """Transform of the input ``samples`` before the output, shape ``(f,)``."""
        if self.lines * abs(samples) > self.count:
            begin = self.first - samples
            return np.asarray(np.fft.rfft(self.input[begin : begin + self.count])[self.bins], dtype=np.complex128)
        # A window that moves loses samples at one end and gains some at the other.
        lower = self.first - max(samples, 0)
        moved = np.arange(lower, lower + abs(samples))
        turn = np.exp(-1j * self.sample_s * np.outer(self.omega_rad_s, np.arange(abs(samples))))
        change = turn @ (self.input[moved] - self.input[moved + self.count])
        phase = np.exp(-1j * self.sample_s * samples * self.omega_rad_s)
        unmoved = self.drive if samples > 0 else self.drive - change
        return np.asarray(phase * unmoved + (change if samples > 0 else 0.0), dtype=np.complex128)

    def equations(self, samples: int) -> Equations:
        """The equations for an input ``samples`` before the output."""
        return self._equations(samples)

    def thinned(self, step: int) -> RecordPart:
        """Every so many-th line, none merged."""
        omega = self.omega_rad_s[::step]
        return replace(
            self,
            omega_rad_s=omega,
            bins=self.bins[::step],
            output=self.output[::step],
            drive=self.drive[::step],
            edges=np.array([omega.size]),
        )

    @cached_property
    def _spans(self) -> tuple[FloatArray, FloatArray]:
        """Middles and half widths of the groups."""
        low, high = self.omega_rad_s[self.edges[:-1]], self.omega_rad_s[self.edges[1:] - 1]
        return 0.5 * (low + high), 0.5 * (high - low)

    @cached_property
    def _equations(self) -> Callable[[int], Equations]:
        return lru_cache(maxsize=_CACHED)(self._made)

    def _made(self, samples: int) -> Equations:
        drive, single = self.input_lines(samples), slice(0, self.single_lines)
        found = [self._merged(group, drive) for group in range(self.groups)]
        zero, one = np.zeros(self.single_lines, dtype=np.complex128), np.ones(self.single_lines, dtype=np.complex128)
        return Equations(
            output=np.concatenate([self.output[single], *(out for out, _, _ in found)]),
            drive=np.concatenate([np.stack([drive[single], zero]), *(above[:2] for _, above, _ in found)], axis=1),
            ends=np.concatenate([np.stack([one, zero]), *(above[2:] for _, above, _ in found)], axis=1),
            left=np.array([left for _, _, left in found]),
        )

    def _merged(self, group: int, drive: ComplexArray) -> tuple[ComplexArray, ComplexArray, float]:
        """Equations of one group, their coefficients by unknown, and the power of the output that they leave."""
        lines = slice(self.edges[group], self.edges[group + 1])
        middle, half = (span[group] for span in self._spans)
        x = 0.5 * (self.omega_rad_s[lines] - middle) / (_NODE * half)
        straight, u, y = np.stack([0.5 - x, 0.5 + x], axis=1), drive[lines], self.output[lines]
        q, r = np.linalg.qr(np.concatenate([u[:, None] * straight, straight], axis=1))
        out = q.conj().T @ y
        return out, r.T, max(float(np.vdot(y, y).real - np.vdot(out, out).real), 0.0)


def merging(lines: int, *, much: bool) -> NDArray[np.int64]:
    """Edges of the groups of a record with so many lines; none where there are not too many of them.

    Examples
    --------
    >>> merging(3000, much=False)
    array([3000])
    >>> merging(1612, much=True)[:3]
    array([800, 808, 816])
    """
    if not much:
        return np.array([lines])
    edges = [round(_FEWEST_MERGED / _WIDTH)]
    while edges[-1] < lines:
        edges.append(edges[-1] + int(_WIDTH * edges[-1]))
    # What is left over at the end joins the last group.
    kept = [edge for edge in edges if edge <= lines - _FEWEST_MERGED]
    return np.array([*kept, lines]) if kept else np.array([lines])


_POWER_SHARE = 0.9999
_HIGHEST_SHARE = 0.9
_THINNED = 400
_LONG = 20_000
_SMOOTHING_RATIO, _SMOOTHING_BINS = 1.3, 8
_RANK = 1e-11
_ROUNDS = 4
_SETTLED = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordSpectra(Immutable):
    """Records as the fit of a delay sees them, each with its own rate and hold.

    Parameters
    ----------
    parts
        One for each record.
    delays_s
        Least and largest delay that the margins allow.
    """

    parts: tuple[RecordPart, ...]
    delays_s: tuple[float, float]

    @property
    def count(self) -> int:
        """Real numbers that are fitted."""
        return 2 * sum(part.lines for part in self.parts)

    @property
    def band_rad_s(self) -> tuple[float, float]:
        """From the lowest line of any record to the highest."""
        omega = np.concatenate([part.omega_rad_s for part in self.parts])
        return float(omega.min()), float(omega.max())

    @property
    def white(self) -> tuple[FloatArray, ...]:
        """Noise of power one at every line."""
        return tuple(np.ones(part.lines) for part in self.parts)

    @cached_property
    def steps(self) -> tuple[int, ...]:
        """One in so many lines of each record is enough for the search."""
        enough = 1 + _THINNED // len(self.parts)
        return tuple(1 + (part.lines - 1) // enough for part in self.parts)

    @cached_property
    def thin(self) -> RecordSpectra:
        """Some of the lines of every record."""
        return replace(self, parts=tuple(p.thinned(step) for p, step in zip(self.parts, self.steps, strict=True)))


def record_spectra(
    histories: Sequence[TimeHistory],
    *,
    input: str,
    output: str,
    holds: Sequence[InputHold],
    delays_s: tuple[float, float],
    highest_rad_s: float = np.inf,
) -> RecordSpectra:
    """Transforms of one input and one output of records.

    The windows leave room for shifting the input. Lines go as far as the input has power, and no further than nine
    tenths of the Nyquist frequency; the one at zero is left out, and with it any constant. Where all records together
    have more lines than are needed, neighboring ones are merged.
    """
    parts = [
        part
        for history, hold in zip(histories, holds, strict=True)
        if (part := _part(history, input, output, hold, delays_s, highest_rad_s)) is not None
    ]
    much = sum(part.lines for part in parts) > MOST_LINES
    return RecordSpectra(
        parts=tuple(replace(part, edges=merging(part.lines, much=much)) for part in parts), delays_s=delays_s
    )


def _part(
    history: TimeHistory,
    input: str,
    output: str,
    hold: InputHold,
    delays_s: tuple[float, float],
    highest_rad_s: float,
) -> RecordPart | None:
    """One record, or ``None`` where it is too short for the delays."""
    sample_s, u, y = 1.0 / history.sample_rate_hz, history[input], history[output]
    ahead, behind = (int(np.ceil(max(limit, 0.0) / sample_s)) + 1 for limit in (delays_s[1], -delays_s[0]))
    if y.size <= 3 * (ahead + behind):
        return None
    count = _quick(y.size - ahead - behind)
    window = y[ahead : ahead + count]
    transform = np.fft.rfft(window - window.mean())
    omega = np.asarray(2.0 * np.pi * np.fft.rfftfreq(count, sample_s), dtype=np.float64)
    drive = np.fft.rfft(u[ahead : ahead + count])
    power = np.abs(drive[1:]) ** 2
    reach = np.searchsorted(np.cumsum(power), _POWER_SHARE * power.sum()) + 1
    top = min(omega[min(reach, omega.size - 1)], _HIGHEST_SHARE * np.pi / sample_s, highest_rad_s)
    bins = np.flatnonzero((omega > 0.0) & (omega <= top))
    return RecordPart(
        sample_s=sample_s,
        hold=hold,
        omega_rad_s=omega[bins],
        bins=bins,
        output=transform[bins],
        drive=drive[bins],
        input=u,
        first=ahead,
        count=count,
        edges=np.array([bins.size]),
    )


def _quick(samples: int) -> int:
    """The length of a window; long ones are cut to one whose transform takes no longer than it must."""
    from scipy.fft import next_fast_len

    if samples <= _LONG:
        return samples
    return next(size for size in range(samples, 0, -1) if next_fast_len(size, real=True) == size)


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordFit:
    """Residuals of a late lag on records; ``theta`` is that of :meth:`DelayedLag.response`.

    Parameters
    ----------
    noise
        Power of the noise at each line of each record.
    model
        The lag; its hold and its sample interval are those of each record instead.
    """

    data: RecordSpectra
    noise: tuple[FloatArray, ...]
    model: DelayedLag

    @property
    def count(self) -> int:
        """Real numbers that are fitted."""
        return self.data.count

    def thinned(self) -> RecordFit:
        """The fit of some of the lines."""
        noise = tuple(noise[::step] for noise, step in zip(self.noise, self.data.steps, strict=True))
        return replace(self, data=self.data.thin, noise=noise)

    def residuals(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals in standard deviations and their derivatives, shapes ``(n,)`` and ``(n, p)``.

        The derivatives leave out that the ends of the record depend on the poles (Kaufman's approximation), which
        changes the path to the minimum and not the minimum.
        """
        both = [self._of_part(part, noise, theta) for part, noise in zip(self.data.parts, self.noise, strict=True)]
        return np.concatenate([one for one, _ in both]), np.concatenate([one for _, one in both])

    def evidence(self) -> float:
        r"""Twice the logarithm of how much likelier the outputs are with the response than with none.

        With the spectrum of the noise estimated both times it is :math:`2 \sum \ln (S_0 / S)` over the lines.
        """
        still = np.concatenate([np.zeros(self.model.order.zeros + 1), np.ones(self.model.order.poles), [0.0]])
        none = self
        for _ in range(_SETTLED):
            none = none.reweighted(still)
        return float(2.0 * sum(np.log(s0 / s).sum() for s0, s in zip(none.noise, self.noise, strict=True)))

    def _of_part(self, part: RecordPart, noise: FloatArray, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        whole = _whole(theta, part)
        rest = theta.copy()
        rest[-1] -= whole * part.sample_s
        model = replace(self.model, hold=part.hold, sample_s=part.sample_s)
        values, derivatives = model.response(rest, part.nodes_rad_s)
        rows, weight = part.equations(whole), np.sqrt(2.0 / noise[part.line_of])
        basis = _basis(part, rows, self.model.poles_rad_s(theta), weight)
        error = real(weight * (rows.output - part.at_rows(rows.drive, values)))
        moves = -weight * part.at_rows(rows.drive, derivatives)
        slope = np.concatenate([moves.real, moves.imag], axis=1).T
        error, slope = error - basis @ (basis.T @ error), slope - basis @ (basis.T @ slope)
        if part.groups == 0:
            return error, slope
        # What merging leaves out is misfit all the same.
        left = np.sqrt(np.sum(2.0 * rows.left / noise[part.edges[:-1]]))
        return np.append(error, left), np.vstack([slope, np.zeros(theta.size)])

    def linear(self, delay_s: float, fastest_rad_s: float) -> tuple[FloatArray, float]:
        """Parameters at a given delay without a start, and their cost.

        The equation is multiplied by the denominator and divided by that of the round before (Sanathanan and Koerner,
        *Transfer function synthesis as a ratio of two complex polynomials*, IEEE Transactions on Automatic Control,
        1963). Poles that grow too fast are mirrored; the numerator is then found again.
        """
        order = self.model.order
        coefficients = self._iterated(delay_s)
        poles = np.asarray(np.roots(np.append(coefficients, 1.0)[::-1]), dtype=np.complex128) * self.model.scale_rad_s
        theta = np.zeros(order.coefficients + 1)
        theta[order.zeros + 1 : -1] = self.model.factors(poles, fastest_rad_s)
        theta[-1] = delay_s
        residual, jacobian = self.residuals(theta)
        above = slice(0, order.zeros + 1)
        theta[above] = np.linalg.lstsq(jacobian[:, above], -residual, rcond=_RANK)[0]
        left = residual + jacobian[:, above] @ theta[above]
        return theta, float(left @ left)

    def _iterated(self, delay_s: float) -> FloatArray:
        """Coefficients of the denominator, lowest power first, that of the highest being one."""
        order = self.model.order
        scales = [np.sqrt(2.0 / noise) for noise in self.noise]
        found = np.zeros(order.coefficients)
        for _ in range(_ROUNDS):
            blocks = [self._equation(p, delay_s, scale) for p, scale in zip(self.data.parts, scales, strict=True)]
            matrix, right = (
                np.concatenate([block for block, _ in blocks]),
                np.concatenate([block for _, block in blocks]),
            )
            length = np.sqrt(np.sum(matrix**2, axis=0))
            length = np.where(length > 0.0, length, 1.0)
            found = np.linalg.lstsq(matrix / length, right, rcond=_RANK)[0] / length
            for index, part in enumerate(self.data.parts):
                below = np.abs(np.append(found[order.zeros + 1 :], 1.0) @ self._powers(part))
                scales[index] = np.sqrt(2.0 / self.noise[index]) / np.maximum(below, 1e-9 * below.max())
        return found[order.zeros + 1 :]

    def _powers(self, part: RecordPart) -> ComplexArray:
        exponents = np.arange(self.model.order.poles + 1)[:, None]
        return np.asarray((1j * part.omega_rad_s / self.model.scale_rad_s) ** exponents, dtype=np.complex128)

    def _equation(self, part: RecordPart, delay_s: float, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rows of the equation multiplied by its denominator, without what the ends of the record add."""
        order, powers, whole = self.model.order, self._powers(part), round(delay_s / part.sample_s)
        drive = part.equations(whole).drive[0]
        late = drive * np.exp(-1j * part.omega_rad_s * (delay_s - whole * part.sample_s))
        if part.hold == "held":
            late = late * hold_spectrum(part.omega_rad_s, part.sample_s)
        columns = [power * late for power in powers[: order.zeros + 1]]
        columns += [-power * part.output for power in powers[:-1]]
        rows, right = np.stack([real(weight * c) for c in columns], axis=1), real(weight * powers[-1] * part.output)
        turn = np.exp(-1j * part.omega_rad_s * part.sample_s)
        basis = _orthonormal(np.stack([weight * turn**k for k in range(order.poles + 1)]))
        return rows - basis @ (basis.T @ rows), right - basis @ (basis.T @ right)

    def reweighted(self, theta: FloatArray) -> RecordFit:
        """The fit with the spectrum of the noise that the residuals at ``theta`` have."""
        lost = 1.0 - (theta.size + (self.model.order.poles + 1) * len(self.data.parts)) / self.data.count
        noise = []
        for part, old in zip(self.data.parts, self.noise, strict=True):
            residual, _ = self._of_part(part, old, theta)
            size = part.line_of.size
            # The projection has taken the ends of the record and leaves complex residuals in units of the old noise.
            power = (residual[:size] ** 2 + residual[size : 2 * size] ** 2) * old[part.line_of] / 2.0
            merged = (
                power[part.single_lines :].reshape(part.groups, UNKNOWNS).sum(axis=1)
                + part.equations(_whole(theta, part)).left
            )
            widths = np.diff(part.edges)
            noise.append(
                _smooth(np.append(power[: part.single_lines], np.repeat(merged / widths, widths))) / max(lost, 0.1)
            )
        return replace(self, noise=tuple(noise))


def _whole(theta: FloatArray, part: RecordPart) -> int:
    """Whole samples of a record in the delay."""
    return round(float(theta[-1]) / part.sample_s)


def _basis(part: RecordPart, rows: Equations, poles: ComplexArray, weight: FloatArray) -> FloatArray:
    """Orthonormal columns of what the ends of a record add through these poles, shape ``(2 r, n + 1)``."""
    turn = np.exp(-1j * part.nodes_rad_s * part.sample_s)
    below = np.prod(1.0 - np.exp(poles * part.sample_s)[:, None] * turn, axis=0)
    nodes = np.stack([turn**k / below for k in range(poles.size + 1)])
    return _orthonormal(weight * part.at_rows(rows.ends, nodes))


def _orthonormal(rows: ComplexArray) -> FloatArray:
    """Orthonormal real columns that span complex rows, shapes ``(n, r)`` and ``(2 r, n)``."""
    return np.asarray(np.linalg.qr(np.concatenate([rows.real, rows.imag], axis=1).T)[0])


def _smooth(power: FloatArray) -> FloatArray:
    """Mean over neighboring lines, more of them at high frequencies."""
    line = np.arange(power.size)
    low = np.minimum((line + 1) / _SMOOTHING_RATIO, line + 1 - _SMOOTHING_BINS).astype(int)
    high = np.maximum((line + 1) * _SMOOTHING_RATIO, line + 1 + _SMOOTHING_BINS).astype(int)
    low, high = np.clip(low, 0, power.size - 1), np.clip(high, 1, power.size)
    total = np.concatenate([[0.0], np.cumsum(power)])
    mean = (total[high] - total[low]) / (high - low)
    return np.asarray(np.maximum(mean, 1e-12 * mean.max()))
