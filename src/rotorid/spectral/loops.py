r"""Loops from flights: the broken-loop response, and sensitivity and closed loop that follow from it.

With the plant :math:`y = G u + v`, the feedback :math:`C` and a test signal :math:`d` added to the command,

.. math:: u = d + f, \quad f = C_r r - C y, \qquad L = C G, \quad S = \frac{1}{1 + L}, \quad T = \frac{L}{1 + L}

the loop is broken at the input of the plant. Which way to :math:`L` is open depends on what was flown:

========================  ================================================  ========================================
flown                     function                                          holds when
========================  ================================================  ========================================
test signal at the mixer  :func:`injected_loop`                             signal and command add up, unlimited
any, gains known          :func:`series`                                    the gains are those that flew
set-point sweep in gusts  :func:`feedback_controller`, then ``series``      set-point and output can be separated
set-point sweep           :func:`error_loop`                                the controller sees nothing but the error
========================  ================================================  ========================================

All else are holomorphic functions :math:`F(H)` of one measured response, so that errors follow to first order from
:math:`\delta F = F'(H) \, \delta H` and the covariance between frequencies is scaled by :math:`F'_i F'^*_j`. That is
good where the relative error of the measured response is well below one (0.3 is the bound used elsewhere).

References
----------
Ljung, *System Identification: Theory for the User*, 2nd ed. (1999), chapter 13; Tischler, Berger, Ivler, Mansur, Cheung
and Soong, *Practical Methods for Aircraft and Rotorcraft Flight Control Design* (2017).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.findings import refusal
from rotorid.data.record import Channel, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.spectral.derived import selected
from rotorid.spectral.estimate import frequency_response
from rotorid.typing import ComplexArray, FloatArray, IntArray

_LARGEST_PUBLISHED_ERROR = 1e3


def series(plant: FrequencyResponse, controller: FrequencyResponse | ComplexArray) -> FrequencyResponse:
    r"""Broken-loop response of a measured plant and a controller.

    .. math:: L = C G, \qquad \delta L = C \, \delta G + G \, \delta C

    Errors of plant and controller count as independent: those of the plant come from gusts, those of a measured
    controller from leakage and quantization.

    Parameters
    ----------
    plant
        :math:`G`, one response from command to output. Let it be a joint estimate: a direct one is biased by the very
        loop that is asked for.
    controller
        :math:`C`, from output to command with the sign of negative feedback: a measured response at the same
        frequencies or some of them, or exact values of shape ``(f,)`` from the gains in the log.

    Returns
    -------
    FrequencyResponse
        One response, shape ``(1, 1, f)``, without unit. Coherence is the lower one.

    Raises
    ------
    UsageError
        There is more than one response, or plant and controller do not belong together.

    Examples
    --------
    >>> plant = FrequencyResponse(
    ...     omega_rad_s=[2.0], values=[[[3.0]]], coherence=[[[1.0]]], random_error=[[[0.1]]],
    ...     covariance=[[[[0.18]]]], inputs=("roll_command",), outputs=("p",), estimate="joint",
    ... )
    >>> loop = series(plant, np.array([0.5j]))
    >>> complex(loop.values[0, 0, 0]), float(loop.random_error[0, 0, 0].round(6))
    (1.5j, 0.1)
    """
    _require_single(plant)
    if not isinstance(controller, FrequencyResponse):
        exact = np.asarray(controller, dtype=np.complex128)
        if exact.shape != plant.omega_rad_s.shape:
            raise UsageError(
                f"got a controller of shape {exact.shape}",
                needed=f"one value per frequency, {plant.omega_rad_s.shape}",
            )
        return _named(through(plant, exact * plant.values[0, 0], exact, note="in series with a known controller"))
    _require_single(controller)
    if (controller.inputs, controller.outputs) != (plant.outputs, plant.inputs):
        raise UsageError(
            f"got a controller from {controller.inputs[0]} to {controller.outputs[0]}",
            needed=f"one from {plant.outputs[0]} to {plant.inputs[0]}",
        )
    if not np.isin(controller.omega_rad_s, plant.omega_rad_s).all():
        raise UsageError(
            "plant and controller have different frequency grids", needed="a controller at the plant's frequencies"
        )
    plant = at_points(plant, np.flatnonzero(np.isin(plant.omega_rad_s, controller.omega_rad_s)))
    G, C = plant.values[0, 0], controller.values[0, 0]
    loop = through(plant, C * G, C, note="in series with the measured controller")
    covariance = loop.covariance + controller.covariance * G[:, None] * G.conj()
    return _named(
        replace(
            loop,
            covariance=covariance,
            random_error=_relative(loop.values[0, 0], covariance[0, 0])[None, None],
            coherence=np.minimum(plant.coherence, controller.coherence),
        )
    )


def sensitivity(loop: FrequencyResponse) -> FrequencyResponse:
    r"""Response of the loop to a disturbance at the point where it was broken.

    .. math:: S = \frac{1}{1 + L}, \qquad \delta S = -S^2 \, \delta L

    Parameters
    ----------
    loop
        Broken-loop response of shape ``(1, 1, f)``.

    Raises
    ------
    UsageError
        There is more than one response.

    Examples
    --------
    >>> loop = FrequencyResponse(
    ...     omega_rad_s=[2.0], values=[[[3.0]]], coherence=[[[1.0]]], random_error=[[[0.1]]],
    ...     covariance=[[[[0.18]]]], inputs=("roll_command",), outputs=("roll_feedback",), estimate="joint",
    ... )
    >>> complex(sensitivity(loop).values[0, 0, 0]), float(sensitivity(loop).random_error[0, 0, 0].round(6))
    ((0.25+0j), 0.075)
    """
    _require_single(loop)
    S = 1.0 / (1.0 + loop.values[0, 0])
    return through(loop, S, -(S**2), note="sensitivity of the closed loop")


def closed_loop(loop: FrequencyResponse) -> FrequencyResponse:
    r"""Complementary sensitivity: what comes back around the closed loop.

    .. math:: T = \frac{L}{1 + L} = 1 - S, \qquad \delta T = S^2 \, \delta L

    It is the response to the set-point only for a controller that sees nothing but the error.

    Parameters
    ----------
    loop
        Broken-loop response of shape ``(1, 1, f)``.

    Raises
    ------
    UsageError
        There is more than one response.
    """
    _require_single(loop)
    S = 1.0 / (1.0 + loop.values[0, 0])
    return through(loop, loop.values[0, 0] * S, S**2, note="closed loop")


def through(
    response: FrequencyResponse, values: ComplexArray, slope: ComplexArray | FloatArray, *, note: str
) -> FrequencyResponse:
    r"""A response that is a holomorphic function of another one, given values and slope of the function.

    .. math:: E[\delta F_i \, \delta F_j^*] = F'_i F'^*_j \, E[\delta H_i \, \delta H_j^*]

    Parameters
    ----------
    response
        Shape ``(1, 1, f)``.
    values, slope
        :math:`F(H)` and :math:`F'(H)`, shape ``(f,)``.
    note
        What was done, for ``processing``.
    """
    covariance = response.covariance[0, 0] * slope[:, None] * slope.conj()
    return replace(
        response,
        values=values[None, None],
        covariance=covariance[None, None],
        random_error=_relative(values, covariance)[None, None],
        processing=(*response.processing, note),
    )


def at_points(response: FrequencyResponse, rows: IntArray) -> FrequencyResponse:
    """The response at some of its frequencies, given their indices."""
    return replace(
        response,
        omega_rad_s=response.omega_rad_s[rows],
        values=response.values[..., rows],
        coherence=response.coherence[..., rows],
        random_error=response.random_error[..., rows],
        covariance=response.covariance[..., rows[:, None], rows],
        output_correlation=None if response.output_correlation is None else response.output_correlation[..., rows],
        input_correlation=(
            None if response.input_correlation is None else response.input_correlation[..., rows[:, None], rows]
        ),
        disturbance=None,
    )


def _relative(values: ComplexArray, covariance: ComplexArray) -> FloatArray:
    # Half of the variance of the complex error stands along the response and is the error of its magnitude.
    spread = np.sqrt(0.5 * np.einsum("ff->f", covariance).real)
    worst = np.full(values.size, _LARGEST_PUBLISHED_ERROR)
    ratio = np.divide(spread, np.abs(values), out=worst, where=np.abs(values) > 0.0)
    return np.asarray(np.minimum(ratio, _LARGEST_PUBLISHED_ERROR))


def _named(loop: FrequencyResponse) -> FrequencyResponse:
    (command,) = loop.inputs
    return replace(loop, outputs=(f"{command.removesuffix('_command')}_feedback",))


def _require_single(response: FrequencyResponse) -> None:
    if response.values.shape[:2] != (1, 1):
        outputs, inputs = response.values.shape[:2]
        raise UsageError(f"got {outputs} outputs and {inputs} inputs", needed="one response", remedy="select a pair")


_LARGEST_INPUT_COHERENCE = 0.8
"""Coherence of set-point and output up to which the two can be separated."""


def injected_loop(
    records: Sequence[TimeHistory],
    *,
    command: str,
    excitation: str,
    omega_rad_s: FloatArray,
    windows_s: Sequence[float],
    injection_delay_s: float = 0.0,
) -> FrequencyResponse:
    r"""Broken-loop response, from a test signal that was added to the command of the plant.

    .. math:: L_0 = -\frac{S_{df}}{S_{du}}, \quad f = u - d, \qquad
        L = e^{-j \omega \tau} (1 + L_0) - 1

    The joint estimate with the test signal :math:`d` as instrument: gusts do not bias it. All loops that were closed
    in the flight count, an attitude loop around the rate loop among them. The second equation corrects exactly for a
    signal that enters :math:`\tau` later than it is logged; at a crossover of 100 rad/s one loop of 2.5 ms is 14° of
    phase. Assumes that command and signal add up: a saturated mixer breaks it, and so does any other motion that the
    pilot adds in step with the signal.

    Parameters
    ----------
    records
        Maneuvers with both channels.
    command
        What the plant receives, test signal included, such as ``roll_command``.
    excitation
        The test signal alone in the same unit, such as ``roll_excitation``.
    omega_rad_s, windows_s
        As for :func:`rotorid.spectral.estimate.frequency_response`.
    injection_delay_s
        Time from the stamp of the test signal to the stamp of the command that contains it. ArduPilot's mixer chirp
        shows up one loop after it is logged.

    Returns
    -------
    FrequencyResponse
        One response, shape ``(1, 1, f)``, without unit. Its output is named after the axis: ``roll_feedback``.

    Raises
    ------
    UsageError
        A channel is missing or the delay is not finite.
    InsufficientDataError
        Too few windows fit, or a channel does not move.

    Examples
    --------
    A loop that feeds back 0.5 of the last sample:

    >>> d, u = np.random.default_rng(0).standard_normal(6000), np.zeros(6000)
    >>> for k in range(6000):
    ...     u[k] = d[k] - 0.5 * u[k - 1]
    >>> record = TimeHistory(
    ...     values=np.stack([d, u]), sample_rate_hz=100.0, start_s=0.0,
    ...     channels=(Channel(name="roll_excitation", unit="1"), Channel(name="roll_command", unit="1")),
    ... )
    >>> loop = injected_loop(
    ...     [record], command="roll_command", excitation="roll_excitation",
    ...     omega_rad_s=np.geomspace(10.0, 100.0, 3), windows_s=[4.0, 2.0],
    ... )
    >>> np.abs(loop.values[0, 0]).round(3)
    array([0.5, 0.5, 0.5])
    """
    if not np.isfinite(injection_delay_s):
        raise UsageError(f"got an injection delay of {injection_delay_s} s", needed="a finite number")
    returned = f"{command.removesuffix('_command')}_feedback"
    measured = frequency_response(
        [_with_difference(record, excitation, command, returned) for record in records],
        inputs=[command],
        outputs=[returned],
        instruments=[excitation],
        omega_rad_s=omega_rad_s,
        windows_s=windows_s,
    )
    late = np.exp(-1j * measured.omega_rad_s * injection_delay_s)
    loop = late * (1.0 + measured.values[0, 0]) - 1.0
    note = f"broken at {command}" + (f", {excitation} enters {injection_delay_s:g} s late" if injection_delay_s else "")
    return through(measured, loop, late, note=note)


def error_loop(
    records: Sequence[TimeHistory],
    *,
    setpoint: str,
    output: str,
    omega_rad_s: FloatArray,
    windows_s: Sequence[float],
    instrument: str | None = None,
) -> FrequencyResponse:
    r"""Broken-loop response, from set-point and output alone.

    .. math:: L = \frac{S_{ry}}{S_{re}}, \quad e = y_c - y

    Holds when the controller sees nothing but the error :math:`e`. Feedforward, a filter on the set-point or a
    derivative of the output alone break it, and nothing in the result shows that: the answer is then
    :math:`C_r G / (1 + (C - C_r) G)`.

    Parameters
    ----------
    records
        Maneuvers with the channels.
    setpoint, output
        :math:`y_c` and :math:`y` in the same unit, such as ``p_setpoint`` and ``p``.
    omega_rad_s, windows_s
        As for :func:`rotorid.spectral.estimate.frequency_response`.
    instrument
        What the pilot or the test gave, :math:`r`. The set-point by default, which is right only when no outer loop
        feeds back into it.

    Returns
    -------
    FrequencyResponse
        One response, shape ``(1, 1, f)``, without unit.

    Raises
    ------
    UsageError
        A channel is missing.
    InsufficientDataError
        Too few windows fit, or a channel does not move.
    """
    error = f"{output}_error"
    measured = frequency_response(
        [_with_difference(record, setpoint, output, error) for record in records],
        inputs=[error],
        outputs=[output],
        instruments=[instrument or setpoint],
        omega_rad_s=omega_rad_s,
        windows_s=windows_s,
    )
    return replace(measured, processing=(*measured.processing, f"broken at {error}"))


def feedback_controller(
    records: Sequence[TimeHistory],
    *,
    setpoint: str,
    output: str,
    command: str,
    omega_rad_s: FloatArray,
    windows_s: Sequence[float],
) -> FrequencyResponse:
    r"""The controller's response to what it feeds back, measured from the log.

    .. math:: u = C_r r - C y, \qquad \begin{bmatrix} C_r & -C \end{bmatrix} = S_{(r,y) u} S_{(r,y)(r,y)}^{-1}

    A controller is deterministic, so that a direct estimate of both paths is right although ``r`` and ``y`` are in one
    loop, as long as gusts separate them. In calm air both move in step, and the little in which a slowly logged
    set-point differs from the true one takes the place of the gusts: a calm PX4 flight gave half of the true gain with
    an error of 2 %. Points at which their coherence is above 0.8 are left out. What the controller does beyond these
    two paths (limits, gains that change, a third signal) is not independent of the inputs and biases the result. Take
    the gains from the parameters where they are in the log.

    Parameters
    ----------
    records
        Maneuvers with the channels.
    setpoint
        What drives the loops to be measured: ``p_setpoint`` gives the rate loop, a stick gives all loops closed around
        the rate, since the attitude is its integral.
    output, command
        What is fed back and what the controller gives.
    omega_rad_s, windows_s
        As for :func:`rotorid.spectral.estimate.frequency_response`.

    Returns
    -------
    FrequencyResponse
        :math:`C`, shape ``(1, 1, f)``, command per unit of the output, with the sign of negative feedback. Coherence is
        partial, given the set-point. Only the points at which set-point and output can be separated.

    Raises
    ------
    UsageError
        A channel is missing.
    InsufficientDataError
        Too few windows fit, or set-point and output move together at all frequencies; the finding is
        ``correlated_inputs``.
    """
    together = frequency_response(
        records, inputs=[setpoint], outputs=[output], omega_rad_s=omega_rad_s, windows_s=windows_s
    )
    independent = together.coherence[0, 0] <= _LARGEST_INPUT_COHERENCE
    if not independent.any():
        raise _inseparable(setpoint, output, float(together.coherence.min()))
    both = frequency_response(
        records, inputs=[output, setpoint], outputs=[command], omega_rad_s=omega_rad_s, windows_s=windows_s
    )
    rows = np.flatnonzero(np.isin(both.omega_rad_s, together.omega_rad_s[independent]))
    measured = at_points(selected(both, inputs=[output]), rows)
    note = f"feedback path, separated from {setpoint}"
    return through(measured, -measured.values[0, 0], -np.ones(rows.size), note=note)


def _inseparable(setpoint: str, output: str, least: float) -> InsufficientDataError:
    where = f"{setpoint}, {output}"
    message = f"{setpoint} and {output} move together at all frequencies, with a coherence of {least:.2f} at least."
    return InsufficientDataError(
        f"{setpoint} and {output} have a coherence of {least:.2f} at least",
        needed=f"at most {_LARGEST_INPUT_COHERENCE:g} somewhere",
        remedy="use the controller's gains, or fly in gusts",
        findings=[refusal("correlated_inputs", where, message, coherence=least)],
    )


def _with_difference(record: TimeHistory, minuend: str, subtrahend: str, name: str) -> TimeHistory:
    """The record with a channel ``minuend - subtrahend`` more."""
    for needed in (minuend, subtrahend):
        if needed not in record.names:
            raise UsageError(f"there is no channel {needed} in the data", needed=f"one of {', '.join(record.names)}")
    if name in record.names:
        raise UsageError(f"there is a channel {name} already", remedy="leave it out of the records")
    unit = record.channels[record.names.index(minuend)].unit
    return replace(
        record,
        values=np.vstack([record.values, record[minuend] - record[subtrahend]]),
        channels=(*record.channels, Channel(name=name, unit=unit)),
        processing=(*record.processing, f"{name} = {minuend} - {subtrahend}"),
    )
