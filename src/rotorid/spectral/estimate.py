"""Frequency responses from time histories.

The way of every estimate: records are cut into windows of several lengths and transformed, the inputs are separated,
what windows add is taken out, and the lengths are joined into one response with its coherence, errors and the
correlations of these. From spectra on (:func:`response_from`) it does not matter whether a flight was measured, or is
only planned and its spectra expected.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.record import TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.spectral.composite import Composed, Composer, Composition, disturbance_of, output_correlation
from rotorid.spectral.conditioning import (
    ConditionedResponse,
    OutputSpectra,
    conditioned_response,
    derivatives,
    output_spectra,
    without_leakage,
)
from rotorid.spectral.spectra import Spectra, record_spectra, require_finite, require_motion
from rotorid.spectral.windows import HANN, Taper, refined, require_grid
from rotorid.typing import BoolArray, ComplexArray, FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Diagnostics(Immutable):
    r"""Companion of a :class:`~rotorid.data.response.FrequencyResponse`, on its grid.

    Parameters
    ----------
    windows_s
        Window lengths, longest first, as in the response.
    share
        Share of each window in the composite, shape ``(y, u, w, f)``; sums to one over the windows.
    window_error
        Random error of each window alone after the textbook, shape ``(y, u, w, f)``; not a number where it does not
        count.
    multiple_coherence
        Share of each output's power that all inputs together explain, shape ``(y, f)``. For a joint estimate it may
        fall below zero, where feedback makes the explained part and the noise cancel.
    leakage
        What the windows would have added to the response, relative to it, shape ``(y, u, f)``; zero where it was not
        corrected.
    input_coherence
        Coherence between the inputs, shape ``(u, u, f)``.
    condition
        Condition number of the cross-spectra that separate the inputs, scaled to unit powers, shape ``(f,)``.
    """

    windows_s: tuple[float, ...]
    share: FloatArray
    window_error: FloatArray
    multiple_coherence: FloatArray
    leakage: ComplexArray
    input_coherence: FloatArray
    condition: FloatArray

    def __post_init__(self) -> None:
        dimensions = {
            "share": 4,
            "window_error": 4,
            "multiple_coherence": 2,
            "input_coherence": 3,
            "condition": 1,
        }
        arrays = {name: read_only(getattr(self, name), np.float64, ndim=ndim) for name, ndim in dimensions.items()}
        self._set(**arrays, leakage=read_only(self.leakage, np.complex128, ndim=3), windows_s=tuple(self.windows_s))


def diagnose(
    windows: Sequence[ConditionedResponse],
    parts: Sequence[Composed],
    leakage: Sequence[ComplexArray],
    points: BoolArray,
) -> Diagnostics:
    """Collect what composing every output told.

    Parameters
    ----------
    windows
        Inputs separated, for each window length.
    parts
        Composites, one for each output.
    leakage
        What was taken out of each, shape ``(u, f)``.
    points
        Which frequencies of the windows those of the composites are, shape ``(g,)`` with ``f`` of them true.
    """
    return Diagnostics(
        windows_s=tuple(window.matrix.window_s for window in windows),
        share=np.stack([part.share for part in parts]),
        window_error=np.stack([part.window_error for part in parts]),
        multiple_coherence=np.stack([part.multiple_coherence for part in parts]),
        leakage=np.stack(leakage),
        input_coherence=_mean_over_windows(windows, _input_coherence, points.size)[..., points],
        condition=_mean_over_windows(windows, _condition, points.size)[points],
    )


def _mean_over_windows(
    windows: Sequence[ConditionedResponse], quantity: Callable[[ConditionedResponse], FloatArray], count: int
) -> FloatArray:
    """Mean over the windows that count at a frequency, each weighed by how often it fits."""
    total, weight = np.zeros(0), np.zeros(count)
    for window in windows:
        values = quantity(window)
        padded = np.zeros((*values.shape[:-1], count))
        padded[..., count - values.shape[-1] :] = values * window.matrix.averages
        total = padded if not total.size else total + padded
        weight[count - values.shape[-1] :] += window.matrix.averages
    return np.asarray(total / weight)


def _input_coherence(window: ConditionedResponse) -> FloatArray:
    block = window.matrix.block(window.inputs, window.inputs)
    power = np.einsum("fii->fi", block).real
    return np.moveaxis(np.abs(block) ** 2 / (power[:, :, None] * power[:, None, :]), 0, -1)


def _condition(window: ConditionedResponse) -> FloatArray:
    cross = window.matrix.block(window.instruments, window.inputs)
    rows = np.einsum("fii->fi", window.matrix.block(window.instruments, window.instruments)).real
    columns = np.einsum("fii->fi", window.matrix.block(window.inputs, window.inputs)).real
    singular = np.linalg.svd(cross / np.sqrt(rows[:, :, None] * columns[:, None, :]), compute_uv=False)
    return np.asarray(singular[:, 0] / singular[:, -1])


Leakage: TypeAlias = Literal["corrected", "ignored"]
Known: TypeAlias = Callable[[FloatArray], ComplexArray]


def frequency_response(
    records: Sequence[TimeHistory],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    omega_rad_s: FloatArray,
    windows_s: Sequence[float],
    instruments: Sequence[str] = (),
    overlap: float = 0.8,
    taper: Taper = HANN,
    composition: Composition = "minimum_variance",
    leakage: Leakage = "corrected",
) -> FrequencyResponse:
    r"""Composite-window frequency responses, direct or joint input–output.

    Without instruments the direct estimate :math:`G_{xx}^{-1} G_{xy}`; with one instrument for each input the joint
    estimate :math:`G_{ru}^{-1} G_{ry}`, which feedback does not bias. Every window length gives an estimate with its
    error; the composite weighs them by :math:`\varepsilon^{-4}` at each frequency.

    Parameters
    ----------
    records
        Maneuvers with the same channels and rate.
    inputs, outputs, instruments
        Channel names. Instruments must excite the inputs and contain no feedback; nothing here can prove that they
        do not. The inputs as their own instruments are the direct estimate, and the response says so.
    omega_rad_s
        Rising grid, shape ``(f,)``. Points below two periods of the longest window are left out. Points that lie far
        apart get company while the estimate is made, so that a coarse grid gives the answers of a fine one.
    windows_s
        Window lengths. One that fits into the records at no more positions than there are inputs is left out.
    overlap, taper
        How windows overlap and fade.
    composition
        ``minimum_variance`` takes the shares of the windows that make the stated error least. ``least_squares`` over
        spectra and coherence is CIFER's, ``weights`` the mean from which it starts.
    leakage
        ``corrected`` takes out what windows add to a response by being windows (`rotorid.spectral.conditioning`);
        ``ignored`` leaves it in, as a bias and as noise that is none.

    Returns
    -------
    FrequencyResponse
        Values, coherence, random error and covariance between frequencies.

    Raises
    ------
    UsageError
        Channels are missing, an instrument is an output too or there is not one for each input, or the grid, the
        windows, or a choice is none that there is.
    InsufficientDataError
        Too few windows fit into the records, a channel is constant or holds samples that are not finite, or the
        inputs are proportional to each other.

    Notes
    -----
    A direct estimate in closed loop is biased toward the inverse of the controller wherever the disturbance rules,
    *with high coherence*. The joint one is not, as long as instrument and output stay coherent (above 0.3 or so).

    A resonance narrower than a few spectral lines, :math:`2 \zeta \omega_n < 8 \pi / T` for the longest window, comes
    out too low and too wide. Stated errors are those of noise: near such a peak they are several times too small. Fly
    longer and use longer windows there.

    References
    ----------
    Tischler and Remple, *Aircraft and Rotorcraft System Identification*, chapters 7, 9 and 10.

    Examples
    --------
    >>> from rotorid.data.record import Channel
    >>> u = np.random.default_rng(0).standard_normal(6000)
    >>> record = TimeHistory(
    ...     values=np.stack([u, 2.0 * u]), sample_rate_hz=100.0, start_s=0.0,
    ...     channels=(Channel(name="roll_command", unit="1"), Channel(name="p", unit="rad/s")),
    ... )
    >>> response = frequency_response(
    ...     [record], inputs=["roll_command"], outputs=["p"],
    ...     omega_rad_s=np.geomspace(3.0, 30.0, 5), windows_s=[8.0, 4.0],
    ... )
    >>> np.abs(response.values[0, 0]).round(6)
    array([2., 2., 2., 2., 2.])
    """
    response, _ = diagnosed_response(
        records,
        inputs=inputs,
        outputs=outputs,
        omega_rad_s=omega_rad_s,
        windows_s=windows_s,
        instruments=instruments,
        overlap=overlap,
        taper=taper,
        composition=composition,
        leakage=leakage,
    )
    return response


def diagnosed_response(
    records: Sequence[TimeHistory],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    omega_rad_s: FloatArray,
    windows_s: Sequence[float],
    instruments: Sequence[str] = (),
    overlap: float = 0.8,
    taper: Taper = HANN,
    composition: Composition = "minimum_variance",
    leakage: Leakage = "corrected",
    known: Known | None = None,
    within: float = math.inf,
) -> tuple[FrequencyResponse, Diagnostics]:
    """:func:`frequency_response`, with what stands behind it.

    Parameters and errors are those of :func:`frequency_response`.

    Parameters
    ----------
    known
        Response ``(y, u, f)`` at frequencies ``(f,)`` whose effect was taken off the outputs of the records. It is
        added to that of what they still hold, and windows add nothing to it, so that nothing is corrected. Multiple
        coherence and leakage of the diagnostics are then those of what the outputs still hold.
    within
        How far a window may be from its length, as a share; by rule they are rounded to whole hops of the shortest.

    Returns
    -------
    FrequencyResponse, Diagnostics
        The response, and on the same grid shares and errors of the windows, multiple coherence, what was taken out as
        leakage, and how the inputs move together.
    """
    spectra, asked = measured_spectra(
        records,
        inputs=inputs,
        outputs=outputs,
        instruments=instruments,
        omega_rad_s=omega_rad_s,
        windows_s=windows_s,
        overlap=overlap,
        taper=taper,
        slopes=leakage == "corrected",
        within=within,
    )
    return response_from(
        spectra,
        inputs=inputs,
        outputs=outputs,
        instruments=instruments,
        asked=asked,
        composition=composition,
        leakage=leakage,
        known=known,
    )


def measured_spectra(
    records: Sequence[TimeHistory],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    instruments: Sequence[str] = (),
    omega_rad_s: FloatArray,
    windows_s: Sequence[float],
    overlap: float = 0.8,
    taper: Taper = HANN,
    slopes: bool = True,
    within: float = math.inf,
) -> tuple[Spectra, BoolArray]:
    """Spectra from which :func:`response_from` makes the joint estimate of records, and the direct one.

    Parameters
    ----------
    records, inputs, outputs, instruments, omega_rad_s, windows_s, overlap, taper, within
        As in :func:`diagnosed_response`.
    slopes
        Whether leakage can be taken out.

    Returns
    -------
    Spectra, numpy.ndarray
        The spectra on a grid that is nowhere coarse, and which points of it were asked for.

    Raises
    ------
    UsageError, InsufficientDataError
        As :func:`frequency_response`.
    """
    _require_channels(inputs, outputs, instruments)
    drivers = tuple(dict.fromkeys([*(instruments if _separate(instruments, inputs) else ()), *inputs]))
    names = tuple(dict.fromkeys([*drivers, *outputs]))
    chosen = [_select(record, names) for record in records]
    require_finite(chosen)
    require_motion(chosen)
    require_grid(omega_rad_s, chosen[0].sample_rate_hz)
    fine_rad_s, asked = refined(omega_rad_s)
    spectra = record_spectra(
        chosen,
        fine_rad_s,
        inputs=inputs,
        windows_s=windows_s,
        overlap=overlap,
        taper=taper,
        slopes=slopes,
        kept=len(drivers),
        within=within,
    )
    return spectra, asked


def _separate(instruments: Sequence[str], inputs: Sequence[str]) -> bool:
    """Whether an estimate is joint: the inputs as their own instruments, in whatever order, are the direct one."""
    return bool(instruments) and set(instruments) != set(inputs)


def response_from(
    spectra: Spectra,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    instruments: Sequence[str] = (),
    asked: BoolArray,
    composition: Composition = "minimum_variance",
    leakage: Leakage = "corrected",
    fitted: bool = True,
    known: Known | None = None,
) -> tuple[FrequencyResponse, Diagnostics]:
    """The estimate that spectra hold, measured or expected ones.

    Parameters
    ----------
    spectra
        Of inputs, outputs and instruments; with the slopes of the taper on the inputs where leakage is taken out.
    inputs, outputs, instruments
        Channels of the spectra; without instruments the direct estimate.
    asked
        Which points of the grid of the spectra to answer for; its last ones are those of ``spectra.omega_rad_s``.
    composition, leakage
        As in :func:`frequency_response`.
    fitted
        Whether an estimate from these spectra adapts to their disturbance, which then holds less power than it had.
        It does to measured spectra; expected ones hold the whole disturbance.
    known
        As in :func:`diagnosed_response`.

    Raises
    ------
    UsageError
        A choice is none that there is.
    InsufficientDataError
        The inputs are proportional to each other.
    """
    _require_choices(composition=composition, leakage=leakage)
    instruments = instruments if _separate(instruments, inputs) else ()
    channels = spectra.matrices[0].channels
    input_rows = [channels.index(name) for name in inputs]
    driver_rows = [channels.index(name) for name in instruments or inputs]
    composer = Composer(
        windows=[
            conditioned_response(matrix, instruments=driver_rows, inputs=input_rows) for matrix in spectra.matrices
        ],
        spectra=spectra,
        corrected=leakage == "corrected",
        composition=composition,
        fitted=fitted,
    )
    added = [None] * len(outputs) if known is None else known(composer.omega_rad_s)
    answers = [_respond(composer, channels.index(name), own) for name, own in zip(outputs, added, strict=True)]
    whole = [answer.composed for answer in answers]
    asked = asked[-composer.omega_rad_s.size :]
    omega_rad_s, parts = composer.omega_rad_s[asked], [part.at(asked) for part in whole]
    held = [
        part if own is None else replace(part, values=part.values - own) for part, own in zip(whole, added, strict=True)
    ]
    disturbance = disturbance_of(
        composer.windows, [answer.densities for answer in answers], held, composer.left, asked, taper=spectra.taper
    )
    share = np.mean([part.share for part in whole], axis=0)
    response = FrequencyResponse(
        omega_rad_s=omega_rad_s,
        values=np.stack([part.values for part in parts]),
        coherence=np.stack([part.coherence for part in parts]),
        random_error=np.stack([part.random_error for part in parts]),
        covariance=np.stack([part.covariance for part in parts]),
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        estimate="joint" if instruments else "direct",
        instruments=tuple(instruments),
        windows_s=spectra.windows_s,
        # The same disturbance enters the responses to every input.
        output_correlation=np.stack([output_correlation(disturbance, omega_rad_s)] * len(inputs)),
        input_correlation=composer.input_correlation(share, asked) if len(inputs) > 1 else None,
        disturbance=disturbance,
        sample_rate_hz=spectra.grid.sample_rate_hz,
    )
    return response, diagnose(composer.windows, parts, [answer.leakage[:, asked] for answer in answers], asked)


class _Answer(NamedTuple):
    """One output: its composite, what the windows had added to it, shape ``(u, f)``, and its densities without that."""

    composed: Composed
    leakage: ComplexArray
    densities: list[OutputSpectra]


def _respond(composer: Composer, output: int, known: ComplexArray | None) -> _Answer:
    matrices = composer.spectra.matrices
    plain = [output_spectra(matrix, output) for matrix in matrices]
    if not composer.corrected or known is not None:
        composed = composer.responses(plain, known=known)
        return _Answer(composed, np.zeros_like(composed.values), plain)
    # What windows add is known from a first answer that still has it.
    draft = composer.responses(plain, draft=True)
    corrected = []
    for matrix in matrices:
        points = slice(composer.omega_rad_s.size - matrix.omega_rad_s.size, None)
        # Seen at the scale of each window's own line: finer structure is noise of longer windows to it.
        slopes = derivatives(
            matrix.omega_rad_s, draft.values[:, points], draft.random_error[:, points], line_rad_s=matrix.line_rad_s
        )
        inputs, taper = composer.windows[0].inputs, composer.spectra.taper
        corrected.append(without_leakage(matrix, output=output, inputs=inputs, derivatives=slopes, taper=taper))
    composed = composer.responses(corrected)
    return _Answer(composed, draft.values / composed.values - 1.0, corrected)


def _require_channels(inputs: Sequence[str], outputs: Sequence[str], instruments: Sequence[str]) -> None:
    """Refuse calls that would be answered, but not with what was meant."""
    if not inputs or not outputs:
        raise UsageError(f"got {len(inputs)} inputs and {len(outputs)} outputs", needed="at least one of each")
    if instruments and len(instruments) != len(inputs):
        raise UsageError(f"got {len(instruments)} instruments for {len(inputs)} inputs", needed="one for each input")
    for name in instruments:
        if name in outputs:
            raise UsageError(
                f"{name} is both an instrument and an output",
                needed="instruments that excite the inputs and contain no feedback",
            )


def _require_choices(*, composition: str, leakage: str) -> None:
    for what, given, kind in (("composition", composition, Composition), ("leakage", leakage, Leakage)):
        if given not in get_args(kind):
            raise UsageError(f"unknown {what} {given!r}", needed=f"one of {', '.join(get_args(kind))}")


def _select(record: TimeHistory, names: Sequence[str]) -> TimeHistory:
    missing = [name for name in names if name not in record.names]
    if missing:
        raise UsageError(
            f"there is no channel {', '.join(missing)} in the data", needed=f"one of {', '.join(record.names)}"
        )
    rows = [record.names.index(name) for name in names]
    return TimeHistory(
        values=record.values[rows],
        channels=tuple(record.channels[row] for row in rows),
        sample_rate_hz=record.sample_rate_hz,
        start_s=record.start_s,
        processing=record.processing,
    )
