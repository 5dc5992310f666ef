"""A measured frequency response, with its coherence and its error.

Gusts and noise move the outputs beside the inputs; an estimate keeps that as a :class:`Disturbance`, from which the
disturbance about any other response follows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from rotorid._faces import attached
from rotorid.data.base import Immutable, optional, read_only
from rotorid.data.display import html_table, lines_of
from rotorid.data.findings import Finding, Findings
from rotorid.typing import ComplexArray, FloatArray

if TYPE_CHECKING:
    from rotorid.plot.accessors import ResponsePictures


@dataclass(frozen=True, kw_only=True, eq=False)
class Disturbance(Immutable):
    r"""Densities of disturbances and inputs, from which the disturbance about any other response follows.

    About another response :math:`T` the disturbance is :math:`Y - T U = V + (H - T) U`. Feedback correlates :math:`V`
    with :math:`U`, and an estimate has adapted to the disturbance that it saw: about the model that fits all of the
    data, the disturbance shows itself better.

    Parameters
    ----------
    densities
        :math:`E[a b^*]` of the disturbances :math:`V = Y - H U` of all outputs and then of all inputs, shape
        ``(y + u, y + u, f)``.
    level
        Densities of the disturbances as the errors of the estimate were stated with, shape ``(y, f)``.
    weak_instrument
        Factor on the stated errors because instruments are weak, shape ``(y, u, f)``; one for a strong one.
    freedom
        Degrees of freedom of each level, shape ``(f,)``: three windows show it to some 50 % only.
    """

    densities: ComplexArray
    level: FloatArray
    weak_instrument: FloatArray
    freedom: FloatArray

    def __post_init__(self) -> None:
        self._set(
            densities=read_only(self.densities, np.complex128, ndim=3),
            level=read_only(self.level, np.float64, ndim=2),
            weak_instrument=read_only(self.weak_instrument, np.float64, ndim=3),
            freedom=read_only(self.freedom, np.float64, ndim=1),
        )


Estimate: TypeAlias = Literal["direct", "joint"]


@dataclass(frozen=True, kw_only=True, eq=False)
class FrequencyResponse(Immutable):
    r"""Responses of several outputs to several inputs on one frequency grid.

    Parameters
    ----------
    omega_rad_s
        Frequencies, shape ``(f,)``, rising.
    values
        Complex response in SI units, shape ``(y, u, f)``.
    coherence
        Coherence of the estimate, shape ``(y, u, f)``: that of input and output for a direct estimate, that of
        instrument and output for a joint one, each with the other inputs accounted for. It says nothing about bias by
        feedback.
    random_error
        Relative standard deviation of the magnitude, which is that of the phase in radians, shape ``(y, u, f)``.
    covariance
        Covariance of the complex response between frequencies, :math:`E[\delta H_i \delta H_j^*]`, shape
        ``(y, u, f, f)``: neighboring frequencies share data and therefore errors.
    inputs, outputs
        Channel names.
    estimate
        ``direct``, or ``joint`` when the instruments removed the feedback.
    instruments
        Channels used as instruments, one for each input; empty for a direct estimate.
    windows_s
        Window lengths that were combined.
    findings
        Remarks of the estimator.
    processing
        What was done to the response since it was estimated, oldest first.
    output_correlation
        Correlation of the errors of two outputs at one frequency, for each input, shape ``(u, y, y, f)``: gusts move
        several outputs at once. ``None`` takes them as independent.
    input_correlation
        Correlation of the errors of the responses of one output to two inputs between all frequencies, shape
        ``(u, u, f, f)``: one instrument may move several inputs. ``None`` takes them as independent.
    disturbance
        What moved the outputs beside the inputs; ``None`` for what is no plain estimate any more.
    sample_rate_hz
        Of the records behind it; ``None`` where that is not known.
    clock_error_s
        Standard deviation of the time to which values of each channel belong
        (:func:`rotorid.signal.stamps.clock_error_s`); ``None`` where stamps do not show it.
    sensor_errors
        How far each output disagrees with the other sensors of its log, as a relative error of its scale and as a
        delay in seconds, shape ``(y, 2)``; ``None`` where nothing disagrees.
    slope_changes
        How much more or less than in the mean each input may have done at the time when it moved at each frequency,
        as a logarithm, shape ``(u, f)``; ``None`` where that is not known.
    lean_errors
        Relative error of every response to an input that the lean of the vehicle may have made at each frequency, one
        standard deviation, shape ``(u, f)``; ``None`` where that is not known.
    unchecked_errors
        Relative errors that the log does not let one look at, one standard deviation, smooth over frequency and of
        unknown course: of all responses to an input alike, and of each for itself, shape ``(2, u, f)``; ``None`` where
        all was looked at.
    sensor_shapes
        What errors of sensors that were corrected leave in the responses, relative to these, one standard deviation
        each and all independent of each other, shape ``(k, y, u, f)``; ``None`` where no sensor was corrected.
    units
        Of channels that the log has in another unit than the vocabulary.

    Examples
    --------
    >>> ones = np.ones((1, 1, 2))
    >>> FrequencyResponse(omega_rad_s=[1.0, 10.0], values=ones, coherence=0.9 * ones, random_error=0.02 * ones,
    ...                   covariance=np.zeros((1, 1, 2, 2)), inputs=("roll_command",), outputs=("p",),
    ...                   estimate="direct")
    FrequencyResponse: 2 frequencies, 1 to 10 rad/s, direct estimate
      p/roll_command  coherence 0.900 to 0.900  error 2.0 % (median)
    """

    omega_rad_s: FloatArray
    values: ComplexArray
    coherence: FloatArray
    random_error: FloatArray
    covariance: ComplexArray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    estimate: Estimate
    instruments: tuple[str, ...] = ()
    windows_s: tuple[float, ...] = ()
    findings: tuple[Finding, ...] = ()
    processing: tuple[str, ...] = ()
    output_correlation: ComplexArray | None = None
    input_correlation: ComplexArray | None = None
    disturbance: Disturbance | None = None
    sample_rate_hz: float | None = None
    clock_error_s: float | None = None
    sensor_errors: FloatArray | None = None
    slope_changes: FloatArray | None = None
    lean_errors: FloatArray | None = None
    unchecked_errors: FloatArray | None = None
    sensor_shapes: ComplexArray | None = None
    units: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        omega = read_only(self.omega_rad_s, np.float64, ndim=1)
        shape = (len(self.outputs), len(self.inputs), omega.size)
        arrays = {
            "values": read_only(self.values, np.complex128, ndim=3),
            "coherence": read_only(self.coherence, np.float64, ndim=3),
            "random_error": read_only(self.random_error, np.float64, ndim=3),
        }
        for name, array in arrays.items():
            if array.shape != shape:
                raise ValueError(f"{name} must have shape {shape}, not {array.shape}")
        covariance = read_only(self.covariance, np.complex128, ndim=4)
        if covariance.shape != (*shape, omega.size):
            raise ValueError(f"covariance must have shape {(*shape, omega.size)}, not {covariance.shape}")
        y, u, f = shape
        correlations = {"output_correlation": (u, y, y, f), "input_correlation": (u, u, f, f)}
        for name, needed in correlations.items():
            values = getattr(self, name)
            if values is not None:
                if np.shape(values) != needed:
                    raise ValueError(f"{name} must have shape {needed}, not {np.shape(values)}")
                self._set(**{name: read_only(values, np.complex128, ndim=4)})
        if self.sensor_errors is not None:
            if np.shape(self.sensor_errors) != (y, 2):
                raise ValueError(f"sensor_errors must have shape {(y, 2)}, not {np.shape(self.sensor_errors)}")
            self._set(sensor_errors=read_only(self.sensor_errors, np.float64, ndim=2))
        for name in ("slope_changes", "lean_errors"):
            values = getattr(self, name)
            if values is not None:
                if np.shape(values) != (u, f):
                    raise ValueError(f"{name} must have shape {(u, f)}, not {np.shape(values)}")
                self._set(**{name: read_only(values, np.float64, ndim=2)})
        if self.unchecked_errors is not None:
            if np.shape(self.unchecked_errors) != (2, u, f):
                raise ValueError(f"unchecked_errors must have shape {(2, u, f)}, not {np.shape(self.unchecked_errors)}")
            self._set(unchecked_errors=read_only(self.unchecked_errors, np.float64, ndim=3))
        if self.sensor_shapes is not None:
            if np.shape(self.sensor_shapes)[1:] != (y, u, f):
                raise ValueError(
                    f"sensor_shapes must have shape (k, {y}, {u}, {f}), not {np.shape(self.sensor_shapes)}"
                )
            self._set(sensor_shapes=read_only(self.sensor_shapes, np.complex128, ndim=4))
        self._set(
            omega_rad_s=omega,
            **arrays,
            covariance=covariance,
            inputs=tuple(self.inputs),
            outputs=tuple(self.outputs),
            instruments=tuple(self.instruments),
            windows_s=tuple(self.windows_s),
            findings=Findings(self.findings),
            processing=tuple(self.processing),
            units=self.units,
        )

    def pair(self, output: str, input: str) -> tuple[int, int]:
        """Indices of one response ``output/input``."""
        return self.outputs.index(output), self.inputs.index(input)

    @property
    def plot(self) -> ResponsePictures:
        """Its pictures: ``response.plot()``, ``response.plot.bode(output="p", input="roll_command")``."""
        pictures: ResponsePictures = attached(self)
        return pictures

    def to_xarray(self) -> Any:
        """An ``xarray.Dataset`` over output, input and frequency.

        Its variables are ``response`` (complex), ``coherence`` and ``random_error``; its ``attrs`` hold the estimate,
        instruments, windows and processing.

        Raises
        ------
        UsageError
            xarray is not installed.
        """
        dimensions = ("output", "input", "omega_rad_s")
        arrays = {"response": self.values, "coherence": self.coherence, "random_error": self.random_error}
        return optional("xarray").Dataset(
            {name: (dimensions, np.array(values)) for name, values in arrays.items()},
            coords={
                "output": list(self.outputs),
                "input": list(self.inputs),
                "omega_rad_s": np.array(self.omega_rad_s),
            },
            attrs={
                "estimate": self.estimate,
                "instruments": list(self.instruments),
                "windows_s": list(self.windows_s),
                "processing": list(self.processing),
            },
        )

    def __repr__(self) -> str:
        return lines_of(self._head, self._rows)

    def _repr_html_(self) -> str:
        findings_html = Findings(self.findings)._repr_html_() if self.findings else ""
        return html_table(self._head, ["response", "coherence", "random error"], self._rows) + findings_html

    @property
    def _head(self) -> str:
        omega = self.omega_rad_s
        span = f", {omega[0]:.4g} to {omega[-1]:.4g} rad/s" if omega.size else ""
        with_what = f" with {', '.join(self.instruments)}" if self.instruments else ""
        return f"FrequencyResponse: {omega.size} frequencies{span}, {self.estimate} estimate{with_what}"

    @property
    def _rows(self) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = []
        for y, output in enumerate(self.outputs):
            for u, input in enumerate(self.inputs):
                known = np.isfinite(self.values[y, u])
                coherence, error = self.coherence[y, u, known], self.random_error[y, u, known]
                coherence_words = (
                    f"coherence {coherence.min():.3f} to {coherence.max():.3f}" if known.any() else "unknown"
                )
                usual = f"error {100.0 * float(np.median(error)):.1f} % (median)" if known.any() else ""
                rows.append((f"{output}/{input}", coherence_words, usual))
        return rows
