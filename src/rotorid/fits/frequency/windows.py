r"""What windows add to measured responses, found with a model and taken out.

A window cuts a motion off, and what the input did before still sounds in it. Of a vehicle that forgets within a window
the estimate takes this out by itself (:mod:`rotorid.spectral.conditioning`), to second order. An angle on two
integrators never forgets: below some ten periods in a window its response stays 15 to 20 % off, alike in every flight,
and a smooth model error would take that for dynamics that the structure lacks. Such responses are always measured anew.

A model knows what the windows saw. Its response :math:`T` to the *logged* inputs is taken off the outputs, what is left
is measured by the same windows, grid and instruments, and :math:`T` is added again:

.. math:: \hat H = T + \frac{1}{F} \, \mathcal{M} \{ F \, (y - T u) \}, \qquad
    F(s) = \prod_{|p_i| < \omega_c} \frac{s - p_i}{s + \omega_c}

The operator :math:`\mathcal{M}` of a measurement is linear in the output. With the right model gusts and noise alone
are left, and windows add nothing; with a model that is a little off, they add to that little. The errors are those of
what is left, so that leakage is neither response nor noise. :math:`F` takes off the slow poles of the model: gusts that
an integrator adds up would leak as the response did. Initial states, steady forces and shifts of sensors are estimated
for each stretch of a record. Logged inputs hold the feedback of a closed loop, and motions that grow come to rest at
the end of the record instead of its beginning, so that neither needs a controller.

Inputs are taken as spectra of samples take them, without a hold: held between samples they would be half a sample late,
and every delay with them.

Not done for outputs whose known filters were taken off the response (``--correct-filters``), and with a model that does
not follow the data: it knows nothing of their windows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.data.record import TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.errors import ModelError
from rotorid.fitting.frequency.problem import FrequencyProblem, pair_names
from rotorid.flights.measure import Measured, Measurement
from rotorid.models.parameter import ParameterSet
from rotorid.models.state_space import StateSpace
from rotorid.settings.measuring import MeasureSettings
from rotorid.spectral.derived import multiplied
from rotorid.spectral.joined import joined_responses
from rotorid.typing import BoolArray, ComplexArray, FloatArray
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.uncertainty.model_error import SMALLEST_MODEL_ERROR
from rotorid.verification.sampled import adjust, bounded_responses, sampled

_LARGEST_REST = 0.5
"""Mean square of what the estimate's own correction leaves, over that of the stated error, from which a response is
measured anew. Responses of an angle on two integrators have 0.7 to 8, of others less than 0.25."""

_MISTAKEN = 2.0 * SMALLEST_MODEL_ERROR
"""What is left, as a relative error, and a model error that was found, above both of which windows may have made it."""

_TWO_INTEGRATORS = 2.0**1.5
"""Growth of a response over an octave below the lowest line of all windows from which two integrators stand in it: one
makes 2, two make 4."""

_DECAYS = np.linspace(5.0, 12.0, 15)
"""Decays of the weight of a transform over a record, of which the one farthest from all poles is taken."""


def windows_matter(measured: Measured, used: BoolArray, model_errors: Mapping[str, float]) -> bool:
    """Whether windows leave more in some response than its errors cover, or what was taken for a model error.

    The estimate takes two terms of a series in the leakage out. The next one is about the square of what it took out.

    Parameters
    ----------
    measured
        The responses.
    used
        Points that are fitted, shape ``(y, u, f)``.
    model_errors
        Sizes of the model errors of a fit, ``output/input`` to a relative error.
    """
    data, points = measured.response, np.maximum(np.count_nonzero(used, axis=-1), 1)
    rest = np.where(used, np.abs(measured.diagnostics.leakage) ** 2, 0.0)
    error = np.hypot(data.random_error, SMALLEST_MODEL_ERROR)
    hidden = np.sum((rest / error) ** 2, axis=-1) / points
    found = np.array([model_errors.get(name, 0.0) for name in pair_names(data)]).reshape(points.shape)
    size = np.sqrt(np.sum(rest**2, axis=-1) / points)
    mistaken = (size > _MISTAKEN) & (found > _MISTAKEN)
    return bool((mistaken | (hidden > _LARGEST_REST)).any())


def never_forgets(system: StateSpace, window_s: float) -> BoolArray:
    """Which responses of a model sum up their input twice, as an angle does a torque, shape ``(y, u)``.

    What the estimate took out says little of them: its slopes hold the error that they should show, and where a sweep
    ends, motions of its beginning are larger than what it moves there.

    Parameters
    ----------
    system
        The model.
    window_s
        Length of the longest window.
    """
    line_rad_s = 0.1 / window_s
    size = np.abs(system.response(np.array([line_rad_s, 2.0 * line_rad_s])))
    return np.asarray(size[..., 0] > _TWO_INTEGRATORS * size[..., 1])


def measured_with_model(
    problem: FrequencyProblem,
    parameters: ParameterSet,
    limits: Bounds,
    measured: Measured,
    settings: MeasureSettings,
) -> FrequencyProblem | None:
    """The problem with responses to which windows have added nothing; none where they have added little.

    Parameters
    ----------
    problem
        As it was fitted.
    parameters, limits
        What the fit found, with its model errors.
    measured
        The responses, and how they were measured.
    settings
        With which they were measured.
    """
    sizes = limits.model_error.sizes if limits.model_error else {}
    if measured.unfiltered or not measured.measurements:
        return None
    structure, data = problem.structure.condensed(parameters), problem.data
    modeled = {name for name, used in zip(data.outputs, problem.used, strict=True) if used.any()}
    try:
        system = structure.matrices(parameters.values)
        lasting = never_forgets(system, max(data.windows_s))[problem.used.any(axis=-1)].any()
        if not lasting and not windows_matter(measured, problem.used, sizes):
            return None
        parts = [_remeasured(one, system, data, modeled, settings) for one in measured.measurements]
    except ModelError:
        return None
    whole = parts[0] if len(parts) == 1 else joined_responses(parts, inputs=data.inputs, outputs=data.outputs)
    if whole.values.shape != data.values.shape or not np.isfinite(whole.values[problem.used]).all():
        return None
    note = f"leakage of windows removed with {problem.structure.name}"
    return replace(
        problem,
        data=replace(
            data,
            values=whole.values,
            covariance=whole.covariance,
            random_error=whole.random_error,
            output_correlation=whole.output_correlation,
            input_correlation=whole.input_correlation,
            disturbance=whole.disturbance,
            processing=(*data.processing, note),
        ),
    )


def _remeasured(
    measurement: Measurement,
    system: StateSpace,
    data: FrequencyResponse,
    modeled: set[str],
    settings: MeasureSettings,
) -> FrequencyResponse:
    """The response of one group of records, with that of the model known."""
    outputs = [name for name in measurement.outputs if name in modeled]
    own = [measurement.outputs.index(name) for name in outputs]
    rows = [data.outputs.index(name) for name in outputs]
    columns = [data.inputs.index(name) for name in measurement.inputs]
    model = replace(
        system,
        G=system.G[:, columns],
        H0=system.H0[rows],
        H1=system.H1[rows],
        input_delays_s=system.input_delays_s[columns],
        output_delays_s=system.output_delays_s[rows],
    )
    washout = _Washout.of(model, corner_rad_s=float(data.omega_rad_s[0]))

    def factor(omega_rad_s: FloatArray) -> ComplexArray:
        factors = np.ones((len(measurement.outputs), omega_rad_s.size), dtype=np.complex128)
        factors[own] = washout.response(np.asarray(1j * omega_rad_s))
        return factors

    def known(omega_rad_s: FloatArray) -> ComplexArray:
        values = np.zeros((len(measurement.outputs), len(columns), omega_rad_s.size), dtype=np.complex128)
        values[own] = model.response(omega_rad_s)
        return np.asarray(factor(omega_rad_s)[:, None] * values)

    left = [_left_over(record, model, washout, measurement.inputs, outputs) for record in measurement.records]
    found = measurement.repeated(left, settings, known)
    return multiplied(found, 1.0 / factor(found.omega_rad_s))


class _Washout(NamedTuple):
    """A filter that takes slow poles off a model, and puts others at the corner in their place."""

    slow: ComplexArray
    corner_rad_s: float

    @classmethod
    def of(cls, system: StateSpace, *, corner_rad_s: float) -> _Washout:
        poles = system.poles()
        return cls(poles[np.abs(poles) < corner_rad_s], corner_rad_s)

    def response(self, s: ComplexArray) -> ComplexArray:
        return np.asarray(np.prod((s[:, None] - self.slow) / (s[:, None] + self.corner_rad_s), axis=1))


class _Transform(NamedTuple):
    r"""The Laplace transform of a record along :math:`\sigma + j\omega`, and back.

    Poles to the left of this line sound from rest at the beginning, those to its right toward rest at the end.
    """

    s: ComplexArray
    weight: FloatArray

    @classmethod
    def of(cls, system: StateSpace, samples: int, rate_hz: float) -> _Transform:
        duration_s = samples / rate_hz
        growth = system.poles().real * duration_s
        decay = max(_DECAYS, key=lambda decay: float(np.abs(growth - decay).min(initial=np.inf))) / duration_s
        # As long again: what sounds after the record would come back at its beginning.
        omega = 2.0 * np.pi * np.fft.rfftfreq(2 * samples, 1.0 / rate_hz)
        return cls(decay + 1j * omega, np.exp(-decay * np.arange(samples) / rate_hz))

    def forward(self, values: FloatArray) -> ComplexArray:
        return np.asarray(np.fft.rfft(values * self.weight, 2 * self.weight.size))

    def back(self, values: ComplexArray) -> FloatArray:
        return np.asarray(np.fft.irfft(values, 2 * self.weight.size)[..., : self.weight.size] / self.weight)


def _left_over(
    record: TimeHistory, model: StateSpace, washout: _Washout, inputs: Sequence[str], outputs: Sequence[str]
) -> TimeHistory:
    """A record whose outputs are what a model leaves of them, washed out."""
    u, y = (np.stack([record[name] for name in names]) for names in (inputs, outputs))
    u, y = u - u.mean(axis=1, keepdims=True), y - y.mean(axis=1, keepdims=True)
    transform = _Transform.of(model, u.shape[1], record.sample_rate_hz)
    washed = washout.response(transform.s)
    forced = np.einsum("yuf,uf->yf", model.response(-1j * transform.s), transform.forward(u))
    residual = transform.back(washed * (transform.forward(y) - forced))
    responses = bounded_responses(sampled(model, u, sample_rate_hz=record.sample_rate_hz, before=np.zeros(len(u))))
    size = np.std(residual, axis=1)
    unknown = adjust(
        responses,
        residual,
        weights=np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0),
        filtered=lambda values: transform.back(washed * transform.forward(values)),
    )
    values = np.array(record.values)
    values[[record.names.index(name) for name in outputs]] = residual - unknown.response
    return replace(record, values=values)
