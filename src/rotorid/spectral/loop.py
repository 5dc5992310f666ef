r"""Sensitivity, closed loop and products of a measured loop.

.. math:: L = C G, \quad S = \frac{1}{1 + L}, \quad T = \frac{L}{1 + L}

All are holomorphic functions :math:`F(H)` of one measured response, so that errors follow to first order from
:math:`\delta F = F'(H) \, \delta H` and the covariance between frequencies is scaled by :math:`F'_i F'^*_j`. That is
good where the relative error of the measured response is well below one (0.3 is the bound used elsewhere).

References
----------
Tischler, Berger, Ivler, Mansur, Cheung and Soong, *Practical Methods for Aircraft and Rotorcraft Flight Control Design*
(2017).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
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
                f"a controller of shape {exact.shape} came",
                needed=f"one value per frequency, {plant.omega_rad_s.shape}",
            )
        return _named(through(plant, exact * plant.values[0, 0], exact, note="in series with a known controller"))
    _require_single(controller)
    if (controller.inputs, controller.outputs) != (plant.outputs, plant.inputs):
        raise UsageError(
            f"a controller from {controller.inputs[0]} to {controller.outputs[0]} came",
            needed=f"one from {plant.outputs[0]} to {plant.inputs[0]}",
        )
    if not np.isin(controller.omega_rad_s, plant.omega_rad_s).all():
        raise UsageError(
            "plant and controller on different grids came", needed="a controller at the plant's frequencies"
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
        raise UsageError(f"{outputs} outputs and {inputs} inputs came", needed="one response", remedy="select a pair")
