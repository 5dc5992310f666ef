"""Parts of documents that say how well a model does on data, and what the data were."""

from __future__ import annotations

from pydantic import Field

from rotorid.pipeline.document_base import Document
from rotorid.verify.verdict import Verdict


class PairCost(Document):
    """Cost of one response."""

    value: float
    band_rad_s: tuple[float, float]
    points: int


class ScoreDocument(Document):
    """How one output of the model predicts one unseen record."""

    nrmse_fit_percent: float
    tic: float
    rms: float
    bias: float
    reference_shift: float


class RangeDocument(Document):
    """What the fitted data covered of a quantity."""

    unit: str
    lowest: float
    highest: float
    rms: float


class TrimDocument(Document):
    """State about which a maneuver moves, SI units; in hover the speeds count as zero."""

    values: dict[str, float]
    hover: bool


class AheadScoreDocument(Document):
    """How one output is predicted over one horizon; a skill of 0 is that of "stays as it is"."""

    nrmse_fit_percent: float | None
    tic: float
    rms: float
    skill: float
    over_quiet: float | None = None


class AheadDocument(Document):
    """Predictions over one horizon, restarted at every sample from the state that the time before shows."""

    horizon_s: float
    outputs: dict[str, AheadScoreDocument]


class LoopScoreDocument(Document):
    """How one output or command is predicted in closed loop."""

    nrmse_fit_percent: float | None
    tic: float
    rms: float


class ClosedLoopDocument(Document):
    """The model under the controller that flew.

    ``setpoints`` names the channel that drove the controller of each command, ``controller_tic`` says how well that
    controller alone makes the measured command of the measured rate. Rates flatter the model, because the controller
    makes them; commands and accelerations tell more.
    """

    setpoints: dict[str, str]
    controller_tic: dict[str, float]
    scores: dict[str, LoopScoreDocument]


class ManeuverVerificationDocument(Document):
    """One unseen maneuver: open loop, prediction ahead, closed loop, and what follows."""

    record: str
    axis: str
    kind: str
    start_s: float
    stop_s: float
    verdict: Verdict
    scores: dict[str, ScoreDocument]
    j_rms: float
    biases: dict[str, float]
    growth_1_s: float
    low_pass_rad_s: float | None = None
    moved: list[str]
    ahead: list[AheadDocument] = Field(default_factory=list)
    holds_s: dict[str, float] = Field(default_factory=dict)
    closed_loop: ClosedLoopDocument | None = None
    trim: TrimDocument | None = None


class SweepVerificationDocument(Document):
    """Cost of the model against each response of sweeps that were not fitted."""

    records: list[str]
    pairs: dict[str, PairCost]
