"""How a planned flight will be identified."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from rotorid.data.immutable import Immutable
from rotorid.errors import UsageError

EstimateChoice: TypeAlias = Literal["auto", "direct", "joint"]
WeightsChoice: TypeAlias = Literal["auto", "cifer", "covariance"]

_JOINT_COHERENCE, _DIRECT_COHERENCE = 0.2, 0.6
"""The limits of an identification."""


@dataclass(frozen=True, kw_only=True)
class FitChoices(Immutable):
    """How the flight will be identified; the defaults are those of an identification.

    Parameters
    ----------
    band_rad_s
        Band to look at; by default that of the sweeps, as the log declares or shows it.
    windows_s
        Window lengths; by default five by rule.
    coherence
        Least coherence of a point; by default 0.6 for a direct and 0.2 for a joint estimate.
    estimate
        ``auto`` is the joint one, as the test inputs will be logged.
    weights
        ``auto`` takes CIFER's for one response and those of the covariance of all errors for several.
    outputs
        Outputs to fit; by default all of the structure that the loop has.
    """

    band_rad_s: tuple[float, float] | None = None
    windows_s: tuple[float, ...] = ()
    coherence: float | None = None
    estimate: EstimateChoice = "auto"
    weights: WeightsChoice = "auto"
    outputs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self._set(windows_s=tuple(self.windows_s), outputs=tuple(self.outputs))
        for what, given, kind in (
            ("estimate", self.estimate, EstimateChoice),
            ("weights", self.weights, WeightsChoice),
        ):
            if given not in get_args(kind):
                raise UsageError(f"the {what} {given!r} came", needed=f"one of {', '.join(get_args(kind))}")

    @property
    def joint(self) -> bool:
        """Whether test inputs will be the instruments."""
        return self.estimate != "direct"

    @property
    def least_coherence(self) -> float:
        """The limit in force."""
        if self.coherence is not None:
            return self.coherence
        return _JOINT_COHERENCE if self.joint else _DIRECT_COHERENCE
