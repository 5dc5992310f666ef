"""Choices of ``verify``."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

from rotorid.errors import UsageError
from rotorid.settings.measuring import MeasureSettings
from rotorid.settings.option import Option
from rotorid.settings.parsing import CONTROLLERS, LOW_PASS

if TYPE_CHECKING:
    from rotorid.settings.given_controllers import GivenController
    from rotorid.typing import Axis
    from rotorid.verification.sampled import LowPass


@dataclass(frozen=True, kw_only=True)
class VerifySettings(MeasureSettings):
    """Choices of one run of ``verify``.

    Parameters
    ----------
    band_rad_s, windows_s, input_windows_s, composition, taper, overlap
        As in :class:`MeasureSettings`; a band given here replaces that of the fit.
    coherence, estimate, instruments, segments, shifts, seed, correct_filters, filters
        As in :class:`MeasureSettings`.
    scale
        Diameter of a full-scale rotor over the size of the vehicle, for the guideline of J_rms.
    vibration_filter
        Cutoff of the matched low-pass in rad/s, ``None`` for none, ``auto`` to decide by the data.
    controllers
        Controllers to fly the model under; by default those whose gains the logs hold.
    """

    seed: int = 0
    scale: Annotated[
        float | None,
        Option("--scale", "Scale factor N of a full-size helicopter to this vehicle, for its guidelines.", "Judging"),
    ] = None
    vibration_filter: Annotated[
        "LowPass",
        Option("--low-pass", "Low-pass filter measurement and prediction alike; cutoff in rad/s.", "Judging", LOW_PASS),
    ] = "auto"
    controllers: Annotated[
        "Mapping[Axis, GivenController]",
        Option(
            "--controller", "TOML file with the gains of each axis, for closed-loop prediction.", "Judging", CONTROLLERS
        ),
    ] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(controllers=self.controllers)
        if self.scale is not None and not 0.0 < self.scale < math.inf:
            raise UsageError(f"--scale {self.scale:g} is out of range", needed="a positive number")
