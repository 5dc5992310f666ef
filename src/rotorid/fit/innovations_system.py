"""A model together with what disturbs it: its own states and those of the gusts, on the samples of a record."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rotorid.fit.noise_model import NoiseLevels, NoiseModel
from rotorid.fit.riccati import Predictor, gain_slopes, steady_predictor
from rotorid.models.state_space import StateSpace
from rotorid.simulate.hold import Hold
from rotorid.simulate.predictor import SampledModel, sampled_model
from rotorid.simulate.sensitivity import Slopes
from rotorid.typing import FloatArray


class Followed(NamedTuple):
    """A model with its predictor at one sample rate.

    Parameters
    ----------
    model
        On the samples, with derivatives by the parameters of model and noise.
    steady
        The predictor.
    dgain
        Derivatives of its gain, shape ``(p, x, y)``.
    """

    model: SampledModel
    steady: Predictor
    dgain: FloatArray


def follow(
    system: StateSpace, slopes: Slopes, noise: NoiseModel, theta: FloatArray, *, sample_rate_hz: float, hold: Hold
) -> Followed:
    """Give a model its best predictor under some noise.

    Parameters
    ----------
    system, slopes
        The model and its derivatives along the model's own directions.
    noise, theta
        The noise model and its parameters.
    sample_rate_hz, hold
        As in :func:`rotorid.simulate.predictor.sampled_model`.

    Raises
    ------
    ModelError
        There is no stable predictor, or the model cannot be put on samples.
    """
    levels = noise.at(theta)
    whole, moves = _with_gusts(system, slopes, noise, levels)
    model = sampled_model(whole, moves, sample_rate_hz=sample_rate_hz, hold=hold)
    process, dprocess = _process(whole, moves, noise, levels, 1.0 / sample_rate_hz)
    steady = steady_predictor(model.step.transition, model.C, process, levels.sensors)
    dgain = gain_slopes(
        steady,
        model.step.transition,
        model.C,
        dtransition=model.tangent.transition,
        dmeasured=model.dC,
        dprocess=dprocess,
        dsensor=_after(levels.dsensors, len(dprocess)),
    )
    return Followed(model=model, steady=steady, dgain=dgain)


def _after(slopes: FloatArray, count: int) -> FloatArray:
    """Derivatives along the noise's directions, after those of the model, along which they are zero."""
    padded = np.zeros((count, *slopes.shape[1:]))
    padded[count - len(slopes) :] = slopes
    return padded


def _with_gusts(
    system: StateSpace, slopes: Slopes, noise: NoiseModel, levels: NoiseLevels
) -> tuple[StateSpace, Slopes]:
    order, gusts = len(system.F), len(levels.gusts)
    count = len(slopes.F) + len(levels.dsensors)
    here = order + np.arange(gusts)
    F = _grown(system.F, gusts, gusts)
    F[list(noise.disturbed)[:gusts], here] = 1.0
    F[here, here] = -1.0 / levels.correlation_s
    M = _grown(system.M, gusts, gusts)
    M[here, here] = 1.0
    dF = _longer(_grown(slopes.F, gusts, gusts), count)
    dF[len(slopes.F) :, here, here] = (levels.dcorrelation_s / levels.correlation_s**2)[:, None]
    # A constant wind is one more input to each disturbed equation.
    G = _grown(system.G, gusts, len(noise.disturbed))
    G[list(noise.disturbed), system.G.shape[1] + np.arange(len(noise.disturbed))] = 1.0
    whole = StateSpace(
        M=M,
        F=F,
        G=G,
        H0=_grown(system.H0, 0, gusts),
        H1=_grown(system.H1, 0, gusts),
        input_delays_s=np.append(system.input_delays_s, np.zeros(len(noise.disturbed))),
        output_delays_s=system.output_delays_s,
    )
    still = np.zeros((len(slopes.F), len(noise.disturbed)))
    moves = Slopes(
        M=_longer(_grown(slopes.M, gusts, gusts), count),
        F=dF,
        G=_longer(_grown(slopes.G, gusts, len(noise.disturbed)), count),
        H0=_longer(_grown(slopes.H0, 0, gusts), count),
        H1=_longer(_grown(slopes.H1, 0, gusts), count),
        input_delays_s=_longer(np.hstack([slopes.input_delays_s, still]), count),
        output_delays_s=_longer(slopes.output_delays_s, count),
    )
    return whole, moves


def _grown(matrix: FloatArray, rows: int, columns: int) -> FloatArray:
    """A matrix, or many of them, with rows and columns of zeros after its own."""
    grown = np.zeros((*matrix.shape[:-2], matrix.shape[-2] + rows, matrix.shape[-1] + columns))
    grown[..., : matrix.shape[-2], : matrix.shape[-1]] = matrix
    return grown


def _longer(slopes: FloatArray, count: int) -> FloatArray:
    """Derivatives along the model's directions, before those of the noise, along which they are zero."""
    padded = np.zeros((count, *slopes.shape[1:]))
    padded[: len(slopes)] = slopes
    return padded


def _process(
    system: StateSpace, slopes: Slopes, noise: NoiseModel, levels: NoiseLevels, step_s: float
) -> tuple[FloatArray, FloatArray]:
    r"""What disturbs the state in one step, and its derivatives.

    The gusts are stationary, so a step brings what it decays by, :math:`(1 - e^{-2h/T}) \Sigma`. What a gust or a jolt
    has done within the step in which it arose is left out, an error of the order of the step.
    """
    order, gusts = len(system.F), len(levels.gusts)
    own = order - gusts
    process, dprocess = np.zeros((order, order)), np.zeros((len(slopes.F), order, order))
    after = len(slopes.F) - len(levels.dsensors)
    kept = np.exp(-2.0 * step_s / levels.correlation_s)
    dkept = kept * 2.0 * step_s / levels.correlation_s**2 * levels.dcorrelation_s
    process[own:, own:] = (1.0 - kept) * levels.gusts
    dprocess[after:, own:, own:] = (1.0 - kept) * levels.dgusts - dkept[:, None, None] * levels.gusts
    inverse = np.linalg.inv(system.M)
    reach = inverse[:, list(noise.disturbed)]
    dreach = -(inverse @ slopes.M @ reach)
    process += step_s * (reach * levels.jolts) @ reach.T
    half = step_s * (dreach * levels.jolts) @ reach.T
    dprocess += half + half.swapaxes(1, 2)
    dprocess[after:] += step_s * (reach * levels.djolts[:, None, :]) @ reach.T
    return process, dprocess
