"""What simulators for learning share: lags of rising and falling outputs, and many drawn vehicles in one file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rotorid.data.base import Immutable
from rotorid.errors import ModelError
from rotorid.exports.mujoco import FLU
from rotorid.exports.px4_sih import lag_of
from rotorid.exports.settings import ExportSettings
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle

AIR_OF_ROTATION = ("M_u", "L_v", "L_p", "M_q", "N_r")
"""Derivatives of moments by velocity and rate."""


@dataclass(frozen=True, kw_only=True)
class DrawnFiles(Immutable):
    """Drawn vehicles in the format of a target.

    Parameters
    ----------
    files
        Relative names to contents.
    start
        The lines that load them; empty where each is used as the identified vehicle is.
    """

    files: Mapping[str, str | bytes]
    start: str = ""

    def __post_init__(self) -> None:
        self._set(files=self.files)


def numbered(name: str, count: int) -> list[str]:
    """Names of drawn vehicles, which sort as they were drawn.

    Examples
    --------
    >>> numbered("bird", 10)[::9]
    ['bird_01', 'bird_10']
    """
    digits = len(str(count))
    return [f"{name}_{number:0{digits}}" for number in range(1, count + 1)]


def lags_of(vehicle: JoinedVehicle, choices: ExportSettings, target: str) -> tuple[float, float]:
    """Lags of outputs that rise and that fall, seconds, the delay included where that was chosen.

    Raises
    ------
    ModelError
        One is zero, by which these simulators divide.
    """
    mean = lag_of(vehicle, choices)
    assert mean is not None
    both = [vehicle.numbers.get(name) for name in ("T_motor_up", "T_motor_down")]
    late = mean - vehicle.numbers["T_motor"].value
    up, down = (mean if number is None else number.value + late for number in both)
    if not min(up, down) > 0.0:
        raise ModelError(
            f"the motor lag of {vehicle.name} is {min(up, down):g} s",
            needed=f"a positive one, which {target} divides by",
            remedy="give a short one, such as --set T_motor=0.005",
        )
    return up, down


def forward_left_up(matrix: FloatArray) -> FloatArray:
    """A matrix of forward, right, down in axes forward, left, up, without negative zeros."""
    return np.asarray(FLU @ matrix @ FLU + 0.0)


def plain(values: FloatArray | float) -> object:
    """Numbers for JSON and TOML: lists of floats with nine digits, which single precision keeps.

    Examples
    --------
    >>> plain(np.array([[0.1 + 0.2, -0.0]]))
    [[0.3, 0.0]]
    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0:
        return float(f"{float(array) + 0.0:.9g}")
    return [plain(item) for item in array]


def yaml_number(value: float) -> str:
    """A number with a point, without which YAML 1.1 reads one with an exponent as text.

    Examples
    --------
    >>> yaml_number(1e-9), yaml_number(0.25)
    ('1.0e-09', '0.25')
    """
    text = f"{value + 0.0:.9g}"
    mantissa, e, exponent = text.partition("e")
    return f"{mantissa}{'' if '.' in mantissa else '.0'}{e}{exponent}"
