"""A verification: what was measured, what the model predicted, and how far apart they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.data.maneuver import Maneuver
from rotorid.typing import FloatArray
from rotorid.verify.closed_loop import ClosedLoop
from rotorid.verify.prediction import Prediction


@dataclass(frozen=True, kw_only=True, slots=True)
class Scores:
    r"""How one output was predicted.

    Parameters
    ----------
    nrmse_fit_percent
        :math:`100 (1 - ||y - \hat y|| / ||y - \bar y||)`.
    tic
        Theil inequality coefficient of the motion about the trim: the mean of the measurement is taken off both
        signals. Up to 0.25 is good.
    rms
        Root mean square of the error, in the unit of the output.
    bias
        Estimated constant input to the first dynamic state equation. 0 where none was estimated: where it cannot be
        told from a reference shift or the initial state, or where the filter removes what it does.
    reference_shift
        Estimated constant offset of the output, in its unit, 0 where the filter removes it.
    """

    nrmse_fit_percent: float
    tic: float
    rms: float
    bias: float
    reference_shift: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Verification(Immutable):
    """One unseen maneuver, measured and predicted in open loop.

    Parameters
    ----------
    record
        Name of the file.
    maneuver
        The interval that was predicted.
    time_s
        Stamps on the log's own clock, shape ``(samples,)``.
    inputs
        Inputs of the model, shape ``(u, samples)``, trim removed.
    measured, predicted
        Outputs, shape ``(y, samples)``.
    input_names, output_names
        Channel names of the rows.
    scores
        Output name to scores.
    biases
        Estimated constants in all state equations, shape ``(x,)``.
    j_rms
        Root mean square of all errors in degrees and feet, see :func:`rotorid.verify.scores.j_rms`.
    growth_1_s
        Largest real part of a pole; above zero the airframe is unstable without its controller.
    low_pass_rad_s
        Matched low-pass that measurement and prediction passed beside the fitted band, or ``None``.
    moved
        Outputs that the maneuver moved clearly more than they moved before it: those that tell about the model.
    ahead
        Predictions over short horizons, restarted at every sample, or ``None`` where the record is too short.
    closed_loop
        The model under the controller that flew, or ``None`` where that is not known.
    """

    record: str
    maneuver: Maneuver
    time_s: FloatArray
    inputs: FloatArray
    measured: FloatArray
    predicted: FloatArray
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    scores: Mapping[str, Scores]
    biases: FloatArray = field(default_factory=lambda: np.zeros(0))
    j_rms: float = 0.0
    growth_1_s: float = 0.0
    low_pass_rad_s: float | None = None
    moved: tuple[str, ...] = ()
    ahead: Prediction | None = None
    closed_loop: ClosedLoop | None = None

    def __post_init__(self) -> None:
        self._set(
            time_s=read_only(self.time_s, np.float64, ndim=1),
            inputs=read_only(self.inputs, np.float64, ndim=2),
            measured=read_only(self.measured, np.float64, ndim=2),
            predicted=read_only(self.predicted, np.float64, ndim=2),
            scores=self.scores,
            biases=read_only(self.biases, np.float64, ndim=1),
            moved=tuple(self.moved),
        )
