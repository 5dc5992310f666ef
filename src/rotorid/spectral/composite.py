r"""Composite windows: long ones for low frequencies, short ones for high, joined by their errors.

Each window length gives a response with an error; the composite takes of each the share that makes the error of the
mean least (or CIFER's weights), output by output. All outputs of an estimate have their disturbances from the same
gusts. Of two outputs of which one is the integral of the other each holds the whole error of both, so whoever fits
several responses at once must not count such errors as independent. What an output shows beside the response to the
inputs,

.. math:: V_y = Y_y - j H_y' U_{w'} - \tfrac12 \sigma_\omega^2 H_y'' U - H_y U

is a mixture of the channels of a window, and so the densities of all these disturbances follow from the spectral
matrix.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.response import Disturbance
from rotorid.spectral.conditioning import (
    Conditioned,
    ConditionedResponse,
    OutputSpectra,
    condition,
    instrument_coherence,
)
from rotorid.spectral.errors import (
    compacted,
    density_freedom,
    influence,
    random_error,
    residual_share,
    response_covariance,
    smear,
    weak_instrument_factor,
)
from rotorid.spectral.spectra import Spectra
from rotorid.spectral.windows import Taper
from rotorid.typing import BoolArray, ComplexArray, FloatArray

_COHERENCE_WEIGHT = 5.0
_RIDGE = 1e-9
_ITERATIONS = 30
_LARGEST_STEP = 0.3
_LEAST_SHARE = 0.05
_LARGEST_ERROR = 1e6

SMOOTHING_POINTS = 2
"""Points to either side over which densities of disturbances are averaged."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PairSpectra:
    """Spectra of one input and one output, window by window or composed.

    Parameters
    ----------
    input_auto, output_auto
        One-sided densities, shape ``(windows, f)``, or ``(f,)`` when composed.
    cross
        Cross density, same shape.
    """

    input_auto: FloatArray
    output_auto: FloatArray
    cross: ComplexArray

    @property
    def response(self) -> ComplexArray:
        """:math:`G_{xy} / G_{xx}`."""
        return np.asarray(self.cross / self.input_auto)

    @property
    def coherence(self) -> FloatArray:
        """:math:`|G_{xy}|^2 / (G_{xx} G_{yy})`."""
        return np.asarray(np.abs(self.cross) ** 2 / (self.input_auto * self.output_auto))


def smoothed(values: ComplexArray) -> ComplexArray:
    """Mean over neighboring points along the first axis: what comes from few windows scatters more than it varies."""
    reach = SMOOTHING_POINTS
    padded = np.pad(values, [(reach, reach), *[(0, 0)] * (values.ndim - 1)], mode="edge")
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=0).mean(axis=-1))


def window_weights(error: FloatArray, valid: BoolArray) -> FloatArray:
    r"""Weights of the windows at each frequency, :math:`W_i = (\varepsilon_i / \varepsilon_{min})^{-4}`.

    Parameters
    ----------
    error
        Random error of each window, shape ``(windows, f)``.
    valid
        Where a window counts, same shape.
    """
    bounded = np.where(valid, np.clip(error, 1e-12, _LARGEST_ERROR), np.inf)
    return np.asarray((bounded.min(axis=0) / bounded) ** 4)


def minimum_variance_share(covariance: FloatArray, valid: BoolArray) -> FloatArray:
    r"""Shares of the windows that make the error of their mean least, none of them negative.

    .. math:: \min_s \; s^T V s, \qquad \sum_i s_i = 1, \quad s_i \ge 0

    Windows over the same data err together, and the covariance between them shows how much one adds to another. The
    mean never errs by more than the best window alone. Negative shares would win a little more from differences
    between windows, in which their biases do not cancel.

    Parameters
    ----------
    covariance
        :math:`V` of the windows' estimates, real, shape ``(f, windows, windows)``.
    valid
        Where a window counts, shape ``(windows, f)``.

    Returns
    -------
    numpy.ndarray
        Shape ``(windows, f)``.

    Examples
    --------
    Two windows whose errors are independent, and one that the better of two already contains:

    >>> valid = np.ones((2, 1), dtype=bool)
    >>> minimum_variance_share(np.array([[[1.0, 0.0], [0.0, 3.0]]]), valid).ravel().round(6).tolist()
    [0.75, 0.25]
    >>> minimum_variance_share(np.array([[[1.0, 1.2], [1.2, 3.0]]]), valid).ravel().round(6).tolist()
    [1.0, 0.0]
    """
    kept = valid.T.copy()
    diagonal = np.einsum("fww->fw", covariance)
    share = np.zeros_like(diagonal)
    for _ in range(valid.shape[0]):
        # What is left out stands alone with a share of zero on the right-hand side.
        both = kept[:, :, None] & kept[:, None, :]
        scale = np.where(kept, diagonal, np.inf).min(axis=1)[:, None, None]
        system = np.where(both, covariance / scale, 0.0) + np.eye(valid.shape[0]) * (~kept[:, :, None] + _RIDGE)
        share = np.linalg.solve(system, kept[..., None].astype(np.float64))[..., 0]
        share /= share.sum(axis=1, keepdims=True)
        worst = np.argmin(share, axis=1)
        negative = share[np.arange(len(share)), worst] < 0.0
        if not negative.any():
            break
        kept[negative, worst[negative]] = False
    share = np.maximum(share, 0.0)
    return np.asarray((share / share.sum(axis=1, keepdims=True)).T)


def compose_by_weights(pairs: PairSpectra, weights: FloatArray) -> PairSpectra:
    r"""Weighted mean of the windows, :math:`\sum W_i^2 G_i / \sum W_i^2`.

    Parameters
    ----------
    pairs
        Spectra of each window.
    weights
        Weights :math:`W_i` of the windows, by pair and frequency.

    References
    ----------
    Tischler and Remple, *Aircraft and Rotorcraft System Identification*, section 10.2.
    """
    share = weights**2 / np.sum(weights**2, axis=0)
    return PairSpectra(
        input_auto=np.sum(share * pairs.input_auto, axis=0),
        output_auto=np.sum(share * pairs.output_auto, axis=0),
        cross=np.sum(share * pairs.cross, axis=0),
    )


def compose_by_least_squares(pairs: PairSpectra, weights: FloatArray) -> PairSpectra:
    r"""Least-squares composite of the windows, started from the weighted mean.

    Minimizes, at each frequency,

    .. math:: \sum_i W_i \left\{ \left[\tfrac{G_{xx} - G_{xx,i}}{\bar G_{xx}}\right]^2
       + \left[\tfrac{G_{yy} - G_{yy,i}}{\bar G_{yy}}\right]^2
       + \left|\tfrac{G_{xy} - G_{xy,i}}{\bar G_{xy}}\right|^2
       + 5 \left[\tfrac{\gamma^2 - \gamma_i^2}{\bar \gamma^2}\right]^2 \right\}

    The cross-spectrum is scaled by its magnitude: its real and imaginary parts pass through zero.

    Parameters
    ----------
    pairs
        Spectra of each window.
    weights
        Weights :math:`W_i` of the windows, by pair and frequency.
    """
    start = compose_by_weights(pairs, weights)
    scale = np.stack([start.input_auto, start.output_auto, np.abs(start.cross), np.abs(start.cross)])
    targets = np.stack([pairs.input_auto, pairs.output_auto, pairs.cross.real, pairs.cross.imag]) / scale[:, None]
    x = np.stack([start.input_auto, start.output_auto, start.cross.real, start.cross.imag]) / scale
    ratio = pairs.coherence / start.coherence
    total, sum_ratio = weights.sum(axis=0), np.sum(weights * ratio, axis=0)
    pull = np.sum(weights * targets, axis=1)
    for _ in range(_ITERATIONS):
        power = x[2] ** 2 + x[3] ** 2
        coherence = power / (x[0] * x[1])
        slope = np.stack([-coherence / x[0], -coherence / x[1], 2.0 * x[2] / (x[0] * x[1]), 2.0 * x[3] / (x[0] * x[1])])
        misfit = total * coherence - sum_ratio
        gradient = total * x - pull + _COHERENCE_WEIGHT * slope * misfit
        # The matrix of the normal equations is total (1 + 5 slope slope'), whose inverse is known.
        along = _COHERENCE_WEIGHT * np.sum(slope * gradient, axis=0)
        step = (gradient - slope * (along / (1.0 + _COHERENCE_WEIGHT * np.sum(slope**2, axis=0)))) / total
        # Windows of hardly any coherence contradict each other wildly; short steps keep such points near their start.
        x = x - np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
        x[:2] = np.maximum(x[:2], _LEAST_SHARE)
        if np.abs(step).max() < 1e-12:
            break
    return PairSpectra(input_auto=x[0] * scale[0], output_auto=x[1] * scale[1], cross=(x[2] + 1j * x[3]) * scale[2])


Composition: TypeAlias = Literal["minimum_variance", "least_squares", "weights"]

_MOMENTS_IN_WINDOW = 5
_MOMENTS_AT_ONCE = 4096
_LARGEST_PUBLISHED_ERROR = 1e3


@dataclass(frozen=True, kw_only=True, eq=False)
class Composed:
    """Responses of one output to every input.

    Parameters
    ----------
    values
        Shape ``(u, f)``.
    coherence, random_error
        Shape ``(u, f)``.
    covariance
        Shape ``(u, f, f)``; empty in a draft.
    share
        Share of each window in the composite, shape ``(u, w, f)``.
    window_error
        Random error of each window alone, shape ``(u, w, f)``; not a number where it does not count.
    multiple_coherence
        Share of the output's power that all inputs explain, shape ``(f,)``.
    weak_instrument
        Factor on the errors because instruments are weak, shape ``(u, f)``.
    """

    values: ComplexArray
    coherence: FloatArray
    random_error: FloatArray
    covariance: ComplexArray
    share: FloatArray
    window_error: FloatArray
    multiple_coherence: FloatArray
    weak_instrument: FloatArray

    def at(self, points: BoolArray) -> Composed:
        """The same at some of the frequencies only; ``points`` has shape ``(f,)``."""
        return Composed(
            values=self.values[:, points],
            coherence=self.coherence[:, points],
            random_error=self.random_error[:, points],
            covariance=self.covariance[:, points][:, :, points],
            share=self.share[..., points],
            window_error=self.window_error[..., points],
            multiple_coherence=self.multiple_coherence[points],
            weak_instrument=self.weak_instrument[:, points],
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Composer:
    """Composes one output at a time; holds what all of them share.

    Parameters
    ----------
    windows
        Inputs separated, for each window length of the spectra.
    spectra
        What they come from.
    corrected
        Whether leakage is taken out of the densities that come.
    composition
        How windows are joined.
    fitted
        Whether the responses are fitted to the disturbance that the spectra hold, as to every measured one; expected
        spectra hold all of it.
    """

    windows: Sequence[ConditionedResponse]
    spectra: Spectra
    corrected: bool
    composition: Composition
    fitted: bool

    @cached_property
    def omega_rad_s(self) -> FloatArray:
        """The frequencies of the responses, shape ``(f,)``."""
        return self.spectra.omega_rad_s

    def responses(
        self, spectra: Sequence[OutputSpectra], *, known: ComplexArray | None = None, draft: bool = False
    ) -> Composed:
        """Responses of the output whose densities came, one set for each window length.

        A draft has the textbook's random error of the composite and no covariance; it is for what needs a response
        before the final one can be formed. Densities of an output from which a known response was taken off give the
        whole response with it, shape ``(u, f)``, as if it were still there.
        """
        parts = [condition(window, output) for window, output in zip(self.windows, spectra, strict=True)]
        power = self._padded([window.input_power for window in self.windows], 1.0).real
        response = self._padded([part.response for part in parts], 1.0)
        response = response if known is None else response + known
        noise = self._padded([part.noise / left for part, left in zip(parts, self.left, strict=True)], 1.0).real
        pairs = PairSpectra(
            input_auto=power, output_auto=np.abs(response) ** 2 * power + noise[:, None], cross=response * power
        )
        single = random_error(pairs.coherence, self._averages, overlap=self.spectra.overlap)
        weights = window_weights(np.hypot(single, self._left_over[:, None]), self._valid[:, None])
        compose = compose_by_weights if self.composition == "weights" else compose_by_least_squares
        total = compose(pairs, weights)
        # Least squares weigh the windows once, the weighted mean by the squares of the same weights.
        share = weights ** (2 if self.composition == "weights" else 1) * power
        share = share / share.sum(axis=0)
        values, coherence = total.response, np.clip(total.coherence, 0.0, 1.0)
        if draft:
            error = random_error(coherence, np.sum(share * self._averages, axis=0), overlap=self.spectra.overlap)
            covariance, weak_instrument = np.zeros((len(error), 0), dtype=np.complex128), np.ones_like(error)
        else:
            if self.composition == "minimum_variance":
                share = self._best_shares(noise, np.abs(values))
                values, coherence = np.sum(share * response, axis=0), np.sum(share * pairs.coherence, axis=0)
            if not self._direct:
                each = [instrument_coherence(*both) for both in zip(self.windows, spectra, strict=True)]
                coherence = np.sum(share * self._padded(each, 0.0).real, axis=0)
            coherence = np.clip(coherence, 0.0, 1.0)
            columns = [self._covariance(parts, index, share[:, index], noise) for index in range(len(values))]
            covariance, weak_instrument = (np.stack(arrays) for arrays in zip(*columns, strict=True))
            error = np.sqrt(0.5 * np.einsum("uff->uf", covariance).real) / np.abs(values)
            error = np.minimum(error, _LARGEST_PUBLISHED_ERROR)
        mean = share.mean(axis=1)
        explained = 1.0 - np.sum(mean * self._padded([part.noise for part in parts], 0.0).real, axis=0) / np.sum(
            mean * self._padded([output.auto for output in spectra], 1.0).real, axis=0
        )
        return Composed(
            values=values,
            coherence=coherence,
            random_error=error,
            covariance=covariance,
            share=share.swapaxes(0, 1),
            window_error=np.where(self._valid[:, None], single, np.nan).swapaxes(0, 1),
            multiple_coherence=explained,
            weak_instrument=weak_instrument,
        )

    @property
    def _direct(self) -> bool:
        return self.windows[0].instruments == self.windows[0].inputs

    def _best_shares(self, noise: FloatArray, size: FloatArray) -> FloatArray:
        """Shares of the least error, from how a disturbance at each moment enters each window's estimate.

        Parameters
        ----------
        noise, size
            Of each window, and of the response to each input, shapes ``(w, f)`` and ``(u, f)``.
        """
        bias = (self._left_over[:, None] * size).transpose(1, 2, 0)
        level = np.sqrt(np.stack([_smooth(row) for row in noise]) * self._moment_s).T
        covariance = self._together * level[:, :, None] * level[:, None, :] + bias[..., :, None] * bias[..., None, :]
        inputs, count, windows = bias.shape
        valid = np.tile(self._valid, (1, inputs))
        share = minimum_variance_share(covariance.reshape(-1, windows, windows), valid)
        return share.reshape(windows, inputs, count)

    @cached_property
    def _together(self) -> FloatArray:
        """Products of the windows' influences for every input, shape ``(u, f, w, w)``."""
        products = [
            np.einsum("wfm,vfm->fwv", reached, reached.conj(), optimize=True).real for reached in self._influences
        ]
        return np.stack(products)

    @cached_property
    def _left_over(self) -> FloatArray:
        """Relative bias of each window that its correction leaves, shape ``(w, f)``; see :func:`smear`.

        The next term of the same series; without a correction the first one.
        """
        lengths_s = np.array([window.matrix.window_s for window in self.windows])[:, None]
        first = smear(self.omega_rad_s, lengths_s)
        return 3.0 * first**2 if self.corrected else first

    @cached_property
    def _valid(self) -> BoolArray:
        # Grids of shorter windows are tails of the longest one's.
        return np.stack([self.omega_rad_s >= window.matrix.omega_rad_s[0] for window in self.windows])

    @cached_property
    def _averages(self) -> FloatArray:
        return np.array([window.matrix.averages for window in self.windows])[:, None, None]

    @cached_property
    def left(self) -> tuple[FloatArray, ...]:
        """Share of the noise that estimating the response has left, of each window."""
        if not self.fitted:
            return tuple(np.ones(window.matrix.omega_rad_s.size) for window in self.windows)
        return tuple(residual_share(window, self.spectra.taper) for window in self.windows)

    def _padded(self, arrays: Sequence[FloatArray | ComplexArray], fill: float) -> ComplexArray:
        """Arrays ``(..., f)`` of the windows on the grid of the longest one, shape ``(w, ..., f)``."""
        padded = np.full((len(arrays), *arrays[0].shape[:-1], self.omega_rad_s.size), fill, dtype=np.complex128)
        for row, array in zip(padded, arrays, strict=True):
            row[..., row.shape[-1] - array.shape[-1] :] = array
        return padded

    @cached_property
    def _moments(self) -> int:
        # Little overlap makes long blocks, in which the taper would be seen too seldom for a variance.
        return math.ceil(_MOMENTS_IN_WINDOW / min(window.matrix.window.blocks for window in self.windows))

    @property
    def _moment_s(self) -> float:
        return self.spectra.grid.block_s / self._moments

    @cached_property
    def _influences(self) -> tuple[ComplexArray, ...]:
        """Influence of each moment on each window's estimate, for every input, shape ``(w, f, moments)``.

        Compacted where records are long: see :func:`rotorid.spectral.errors.compacted`.
        """
        return tuple(
            compacted(
                (self._reached(index, *stretch) for stretch in self._stretches), self.spectra.blocks * self._moments
            )
            for index in range(len(self.windows[0].inputs))
        )

    def input_correlation(self, share: FloatArray, points: BoolArray) -> ComplexArray:
        r"""Correlation of the errors of responses to two inputs, shape ``(u, u, f, f)``.

        Where one instrument moves several inputs, the same disturbance enters the responses to all of them:
        :math:`E[\delta H_{u,i} \, \delta H_{v,j}^*] \propto \sum_m g_{u,i}(t_m) g_{v,j}^*(t_m)`.

        Parameters
        ----------
        share
            Share of each window for each input, the mean over the outputs, shape ``(u, w, f)``.
        points
            Frequencies to answer for, shape ``(f,)``.
        """
        inputs, count = share.shape[0], int(np.count_nonzero(points))
        products = np.zeros((inputs * count, inputs * count), dtype=np.complex128)
        for reached in self._influences_by_stretch():
            weighed = [
                np.einsum("wf,wfm->fm", share[index][:, points], reached[index][:, points]) for index in range(inputs)
            ]
            together = np.concatenate(weighed)
            products += together @ together.conj().T
        omega = np.tile(self.omega_rad_s[points], inputs)
        products *= np.sinc(0.5 * (omega[:, None] - omega) * self._moment_s / np.pi)
        level = np.sqrt(np.einsum("nn->n", products).real)
        shape = (inputs, count, inputs, count)
        return np.asarray(np.moveaxis((products / (level[:, None] * level)).reshape(shape), 2, 1))

    def _influences_by_stretch(self) -> Iterator[Sequence[ComplexArray]]:
        """Influences of every input, not compacted, over adjoining stretches of time, each ``(w, f, moments)``."""
        if self._influences[0].shape[-1] == self.spectra.blocks * self._moments:
            yield self._influences
            return
        for stretch in self._stretches:
            yield [self._reached(index, *stretch) for index in range(len(self._influences))]

    @property
    def _stretches(self) -> list[tuple[int, int]]:
        step = max(1, _MOMENTS_AT_ONCE // self._moments)
        return [(first, min(step, self.spectra.blocks - first)) for first in range(0, self.spectra.blocks, step)]

    def _reached(self, index: int, first_block: int, blocks: int) -> ComplexArray:
        """Influences of a stretch of time, shape ``(w, f, moments)``."""
        reached = np.zeros((len(self.windows), self.omega_rad_s.size, blocks * self._moments), dtype=np.complex128)
        for row, window in zip(reached, self.windows, strict=True):
            here = influence(
                window, index, blocks=blocks, taper=self.spectra.taper, moments=self._moments, first_block=first_block
            )
            row[self.omega_rad_s.size - len(here) :] = here
        return reached

    def _covariance(
        self, parts: Sequence[Conditioned], index: int, share: FloatArray, noise: FloatArray
    ) -> tuple[ComplexArray, FloatArray]:
        total = np.einsum("wf,wfm->fm", share, self._influences[index])
        level = _smooth(np.sum(share * noise, axis=0))
        covariance = response_covariance([total], self.omega_rad_s, level, self._moment_s)
        if self._direct:
            return covariance, np.ones(len(covariance))
        unexplained = self._padded([window.input_noise[index] for window in self.windows], 0.0).real
        residual = self._padded([part.input_residual[index] for part in parts], 0.0)
        factor = weak_instrument_factor(
            np.einsum("ff->f", covariance).real,
            level,
            np.sum(share * unexplained, axis=0),
            np.sum(share * residual, axis=0),
        )
        return np.asarray(covariance * factor[:, None] * factor), factor


def _smooth(noise: FloatArray) -> FloatArray:
    return np.asarray(smoothed(np.asarray(noise, dtype=np.complex128)).real)


_TINY = 1e-300
_ROUNDING = 1e-12
_REACH = math.log(4.0 / 3.0)
_LEAST_FACTOR, _LARGEST_FACTOR = 0.5, 10.0
"""An estimate adapts to its disturbance by less than half; far more is a model that does not fit."""


def disturbance_of(
    windows: Sequence[ConditionedResponse],
    spectra: Sequence[Sequence[OutputSpectra]],
    parts: Sequence[Composed],
    left: Sequence[FloatArray],
    points: BoolArray,
    *,
    taper: Taper,
) -> Disturbance:
    """The disturbance of an estimate.

    Each window counts by its share in the composite; neighboring points are averaged.

    Parameters
    ----------
    windows
        Inputs separated, for each window length.
    spectra
        Densities that involve each output, for each output and window length.
    parts
        The composite of each output.
    left
        Share of a disturbance that the residuals of each window length still hold, see
        :func:`rotorid.spectral.errors.residual_share`.
    points
        Frequencies of the windows to answer for, shape ``(f,)``.
    taper
        Of the windows.
    """
    share = np.mean([part.share.mean(axis=0) for part in parts], axis=0)
    count, outputs = share.shape[1], len(parts)
    inputs, own = len(windows[0].inputs), np.arange(len(parts))
    total = np.zeros((count, outputs + inputs, outputs + inputs), dtype=np.complex128)
    level, freedom = np.zeros((count, outputs)), np.zeros(count)
    for index, window in enumerate(windows):
        here = slice(count - window.matrix.omega_rad_s.size, None)
        rows = [
            _disturbance(window, output[index], part.values[:, here])
            for output, part in zip(spectra, parts, strict=True)
        ]
        mixes = np.stack([*rows, *_inputs(window)], axis=1)
        densities = np.einsum("fam,fmn,fbn->fab", mixes.conj(), window.matrix.values, mixes, optimize=True)
        # Without noise there is nothing but rounding, a millionth of a millionth of the output, and no correlation.
        floor = _ROUNDING * np.stack([output[index].auto for output in spectra], axis=1)
        densities[:, own, own] += floor
        total[here] += share[index, here, None, None] * densities.conj()
        noise = np.stack([condition(window, output[index]).noise for output in spectra], axis=1)
        level[here] += share[index, here, None] * noise / left[index][:, None]
        freedom[here] += share[index, here] * density_freedom(window.matrix, taper, reach=SMOOTHING_POINTS)
    return Disturbance(
        densities=np.moveaxis(total, 0, -1)[..., points],
        level=smoothed(level.astype(np.complex128)).real.T[:, points],
        weak_instrument=np.stack([part.weak_instrument for part in parts])[..., points],
        freedom=freedom[points],
    )


def output_correlation(
    disturbance: Disturbance, omega_rad_s: FloatArray, difference: ComplexArray | None = None
) -> ComplexArray:
    r"""Correlation of the disturbances of the outputs, shape ``(y, y, f)``.

    .. math:: c_{ab} = \frac{E[V_a V_b^*]}{\sqrt{E|V_a|^2 \, E|V_b|^2}}

    Averaged over a third to either side in frequency, with weights that fall to zero there: ten independent windows, as
    many as there are at low frequencies, make of six independent outputs six that seem to hang together, and whoever
    weighs by that believes too much. What the correlation does within a third is lost.

    Parameters
    ----------
    disturbance
        Of an estimate.
    omega_rad_s
        Its frequencies, shape ``(f,)``.
    difference
        The estimate minus the response about which the disturbance is wanted, shape ``(y, u, f)``; none for the
        estimate itself.
    """
    each = np.moveaxis(_normalized(_density_about(disturbance, difference)), -1, 0)
    distance = np.abs(np.log(omega_rad_s) - np.log(omega_rad_s)[:, None]) / _REACH
    near = np.maximum(1.0 - distance, 0.0)
    return _normalized(np.moveaxis(np.einsum("fg,gab->fab", near, each), 0, -1))


def level_about(disturbance: Disturbance, difference: ComplexArray) -> FloatArray:
    """Factor from the standard deviations that an estimate states to those about another response, ``(y, u, f)``.

    Parameters
    ----------
    disturbance, difference
        As in :func:`output_correlation`.
    """
    power = np.einsum("yyf->yf", _density_about(disturbance, difference)).real
    # Without noise there is nothing but rounding on either side.
    factor = np.sqrt(np.maximum(power, _TINY) / np.maximum(disturbance.level, _TINY))
    return np.asarray(np.clip(factor, _LEAST_FACTOR, _LARGEST_FACTOR)[:, None, :] / disturbance.weak_instrument)


def _density_about(disturbance: Disturbance, difference: ComplexArray | None) -> ComplexArray:
    """Densities of the disturbances of the outputs about another response, smoothed, shape ``(y, y, f)``."""
    outputs = disturbance.level.shape[0]
    if difference is None:
        part = disturbance.densities[:outputs, :outputs]
        return np.moveaxis(smoothed(np.moveaxis(part, -1, 0)), 0, -1)
    frequencies = disturbance.level.shape[1]
    own = np.broadcast_to(np.eye(outputs)[:, :, None], (outputs, outputs, frequencies))
    mix = np.concatenate([own, difference], axis=1)
    about = np.einsum("amf,mnf,bnf->fab", mix, disturbance.densities, mix.conj(), optimize=True)
    return np.moveaxis(smoothed(about), 0, -1)


def _disturbance(window: ConditionedResponse, output: OutputSpectra, response: ComplexArray) -> ComplexArray:
    """The mixture of channels that is left of an output without its response, shape ``(f, channels)``."""
    mix = output.mix.copy()
    mix[:, list(window.inputs)] -= response.T
    return mix


def _inputs(window: ConditionedResponse) -> list[ComplexArray]:
    mixes = []
    for row in window.inputs:
        mix = np.zeros(window.matrix.values.shape[:2], dtype=np.complex128)
        mix[:, row] = 1.0
        mixes.append(mix)
    return mixes


def _normalized(densities: ComplexArray) -> ComplexArray:
    level = np.sqrt(np.maximum(np.einsum("aaf->af", densities).real, _TINY))
    scaled = densities / level[:, None, :] / level[None, :, :]
    rows = np.arange(len(densities))
    scaled[rows, rows] = 1.0
    return np.asarray(0.5 * (scaled + scaled.conj().swapaxes(0, 1)))
