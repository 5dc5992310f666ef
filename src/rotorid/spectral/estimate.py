"""Frequency responses from time histories: the one public verb of this layer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias, get_args

import numpy as np

from rotorid.data.disturbance import Disturbance
from rotorid.data.history import TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.spectral.composer import Composed, Composer, Composition
from rotorid.spectral.conditioning import OutputSpectra, output_spectra, separate
from rotorid.spectral.diagnostics import Diagnostics, diagnose
from rotorid.spectral.disturbances import disturbance_of, output_correlation
from rotorid.spectral.grid import refined, require_grid
from rotorid.spectral.leakage import derivatives, without_leakage
from rotorid.spectral.preconditions import require_finite, require_motion, require_windows
from rotorid.spectral.spectra import SpectralMatrix, spectral_matrices
from rotorid.spectral.windows import HANN, Taper
from rotorid.typing import ComplexArray, FloatArray

Leakage: TypeAlias = Literal["corrected", "ignored"]


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
        ``corrected`` takes out what windows add to a response by being windows (`rotorid.spectral.leakage`);
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
    >>> from rotorid.data.channel import Channel
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
) -> tuple[FrequencyResponse, Diagnostics]:
    """:func:`frequency_response`, with what stands behind it.

    Parameters and errors are those of :func:`frequency_response`.

    Returns
    -------
    FrequencyResponse, Diagnostics
        The response, and on the same grid shares and errors of the windows, multiple coherence, what was taken out as
        leakage, and how the inputs move together.
    """
    _require_choices(inputs, outputs, instruments, composition=composition, leakage=leakage)
    # The inputs as their own instruments, in whatever order, are the direct estimate.
    joint = bool(instruments) and set(instruments) != set(inputs)
    drivers = tuple(instruments) if joint else tuple(inputs)
    names = tuple(dict.fromkeys([*drivers, *inputs, *outputs]))
    chosen = [_select(record, names) for record in records]
    require_finite(chosen)
    require_motion(chosen)
    require_grid(omega_rad_s, chosen[0].sample_rate_hz)
    fine_rad_s, asked = refined(omega_rad_s)
    fitting, grid = spectral_matrices(
        chosen,
        fine_rad_s,
        windows_s=sorted(windows_s, reverse=True),
        overlap=overlap,
        taper=taper,
        slopes_of=tuple(inputs) if leakage == "corrected" else (),
        kept=len(drivers),
    )
    # As many inputs as windows explain any output perfectly: coherence one, error zero, and nothing behind it.
    matrices = tuple(matrix for matrix in fitting if len(matrix.transforms) > len(inputs))
    require_windows(matrices, chosen, windows_s)
    rows = {name: index for index, name in enumerate(names)}
    driver_rows, input_rows = [rows[name] for name in drivers], [rows[name] for name in inputs]
    composer = Composer(
        windows=[separate(matrix, instruments=driver_rows, inputs=input_rows) for matrix in matrices],
        omega_rad_s=max((matrix.omega_rad_s for matrix in matrices), key=len),
        grid=grid,
        blocks=sum(record.values.shape[1] // grid.samples_per_block for record in chosen),
        overlap=overlap,
        taper=taper,
        corrected=leakage == "corrected",
        composition=composition,
    )
    answers = [_respond(composer, matrices, input_rows, rows[output], leakage=leakage) for output in outputs]
    asked = asked[-composer.omega_rad_s.size :]
    parts = [part.at(asked) for part, _, _ in answers]
    share = np.mean([part.share for part, _, _ in answers], axis=0)
    densities = [spectra for _, _, spectra in answers]
    disturbance = disturbance_of(composer.windows, densities, [part for part, _, _ in answers], composer.left, asked)
    response = _stacked(
        parts,
        omega_rad_s=composer.omega_rad_s[asked],
        inputs=inputs,
        outputs=outputs,
        instruments=drivers if joint else (),
        windows_s=[matrix.window_s for matrix in matrices],
        disturbance=disturbance,
        input_correlation=composer.input_correlation(share, asked) if len(inputs) > 1 else None,
    )
    return response, diagnose(composer.windows, parts, [added[:, asked] for _, added, _ in answers], asked)


def _stacked(
    parts: Sequence[Composed],
    *,
    omega_rad_s: FloatArray,
    inputs: Sequence[str],
    outputs: Sequence[str],
    instruments: Sequence[str],
    windows_s: Sequence[float],
    disturbance: Disturbance,
    input_correlation: ComplexArray | None,
) -> FrequencyResponse:
    """One response of all outputs."""
    return FrequencyResponse(
        omega_rad_s=omega_rad_s,
        values=np.stack([part.values for part in parts]),
        coherence=np.stack([part.coherence for part in parts]),
        random_error=np.stack([part.random_error for part in parts]),
        covariance=np.stack([part.covariance for part in parts]),
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        estimate="joint" if instruments else "direct",
        instruments=tuple(instruments),
        windows_s=tuple(windows_s),
        # The same disturbance enters the responses to every input.
        output_correlation=np.stack([output_correlation(disturbance, omega_rad_s)] * len(inputs)),
        input_correlation=input_correlation,
        disturbance=disturbance,
    )


def _respond(
    composer: Composer, matrices: Sequence[SpectralMatrix], inputs: Sequence[int], output: int, *, leakage: Leakage
) -> tuple[Composed, ComplexArray, list[OutputSpectra]]:
    """One output, what the windows had added to it, known from a first answer that still has it, and its densities."""
    plain = [output_spectra(matrix, output) for matrix in matrices]
    if leakage == "ignored":
        composed = composer.responses(plain)
        return composed, np.zeros_like(composed.values), plain
    draft = composer.responses(plain, draft=True)
    corrected = []
    for matrix in matrices:
        points = slice(composer.omega_rad_s.size - matrix.omega_rad_s.size, None)
        # Seen at the scale of each window's own line: finer structure is noise of longer windows to it.
        slopes = derivatives(
            matrix.omega_rad_s, draft.values[:, points], draft.random_error[:, points], line_rad_s=matrix.line_rad_s
        )
        corrected.append(
            without_leakage(matrix, output=output, inputs=inputs, derivatives=slopes, taper=composer.taper)
        )
    composed = composer.responses(corrected)
    return composed, draft.values / composed.values - 1.0, corrected


def _require_choices(
    inputs: Sequence[str], outputs: Sequence[str], instruments: Sequence[str], *, composition: str, leakage: str
) -> None:
    """Refuse calls that would be answered, but not with what was meant."""
    if not inputs or not outputs:
        raise UsageError(f"{len(inputs)} inputs and {len(outputs)} outputs came", needed="at least one of each")
    if instruments and len(instruments) != len(inputs):
        raise UsageError(f"{len(instruments)} instruments for {len(inputs)} inputs came", needed="one for each input")
    for name in instruments:
        if name in outputs:
            raise UsageError(
                f"{name} came as an instrument and as an output",
                needed="instruments that excite the inputs and contain no feedback",
            )
    for what, given, kind in (("composition", composition, Composition), ("leakage", leakage, Leakage)):
        if given not in get_args(kind):
            raise UsageError(f"the {what} {given!r} came", needed=f"one of {', '.join(get_args(kind))}")


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
