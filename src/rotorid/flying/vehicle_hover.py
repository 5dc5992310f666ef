r"""What ``physical.hover`` knows of a vehicle: mass, inertia, thrust and torque of its rotors, their momentum, the arm.

The model has the slopes of its rotors about hover, at the speed :math:`n_h`. A rotor carries :math:`W = m g/N` there,
and an output of one more adds :math:`s = 2 k_n c_T \rho n_h D^4` to it, so that

.. math::

    T(x) = \frac{2 W - s x_h}{x_h} x + \frac{s x_h - W}{x_h^2} x^2, \qquad
    \kappa = \frac{c_P D}{2 \pi c_T}, \qquad h = 2 \pi k_n J_r

with the output of hover :math:`x_h` that the log has, where the thrust is between a line and a square of the output,
:math:`W \le s x_h \le 2 W`. Less than a line is one with an offset, :math:`T = W + s (x - x_h)`, and more than a
square, as of motors that start late, :math:`T = W + s (x^2 - x_h^2) / (2 x_h)`. Where it has none, speed is taken in
proportion to the output: :math:`x_h = n_h/k_n = 2 W/s`, and the thrust is :math:`W (x/x_h)^2`; or thrust, where the
vehicle would hover near full output. All of them give the control derivatives of the result.

The scale of the result is its mass, and its length the arm. With another mass by the factor f and another arm by the
factor :math:`\lambda` the flight is the same for thrust and h times f, the inertia of roll and pitch times
:math:`f \lambda`, of yaw times :math:`f \lambda^2`, and :math:`\kappa` times :math:`\lambda^2`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rotorid.data.quantity import with_error
from rotorid.flying.vehicle_numbers import UNITS, Source, VehicleNumber, label_of
from rotorid.models.families import family_of
from rotorid.models.rotors import RotorLayout
from rotorid.uncertainty.propagation import covariance_of
from rotorid.units import STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from rotorid.results.model import IdentifiedModel

_PHYSICS = ("m", "I_xx", "I_yy", "I_zz", "c_T", "c_P", "J_r", "D", "l", "rho", "k_n")

_LEAST_SHARE, _MOST_SHARE = 0.3, 6.0
"""Slope of the thrust in hover times the output over the thrust: one of a line, two of a square. Beyond these, k_n and
the outputs of the log are not of one unit."""

_MOST_HOVER = 0.9
"""Output of hover above which a vehicle could hardly climb."""

_CUT_SIGMAS, _LEAST_SPREAD = 5.0, 1e-3
"""Standard deviations to a possible yaw inertia beyond which the nearest is taken; the least spread, of the value."""

_OF: Mapping[str, tuple[str, ...]] = {
    "m": ("m",),
    "I_xx": ("I_xx",),
    "I_yy": ("I_yy",),
    "I_zz": ("I_zz",),
    "arm": ("l",),
    "disc_area": ("D",),
}
"""Numbers that are parameters of the result, to which of them; all others follow from several."""


def knows_hover(model: IdentifiedModel) -> bool:
    """Whether a result has the physics of a hovering vehicle."""
    kept = {name for name, found in model.parameters.items() if found.status != "dropped"}
    return family_of(model.structure).drags_by_rotors and {"m", "l", "c_T", "D", "rho", "k_n", "n_h"} <= kept


def layout_of_hover(model: IdentifiedModel) -> RotorLayout | None:
    """The rotors of a result with its arm; ``None`` where it does not have them, as older ones do not."""
    rotors = model.rotors
    if rotors is None or "l" not in model.parameters:
        return None
    shape = RotorLayout(
        name=rotors.layout,
        positions=np.array(rotors.rotors, dtype=np.float64),
        spins=np.array(rotors.spins, dtype=np.float64),
        arm_known=False,
        source=label_of(model),
    )
    return shape.scaled(model.parameters["l"].value)


def numbers_of_hover(model: IdentifiedModel, known: Mapping[str, float]) -> dict[str, VehicleNumber]:
    """Numbers of a result of ``physical.hover`` with their errors.

    Parameters
    ----------
    model
        Such a result.
    known
        Given numbers: a mass and an arm scale the others, and one of ``kappa`` and ``I_zz`` gives the other by their
        ratio.
    """
    kept = {name: found for name, found in model.parameters.items() if found.status != "dropped"}
    values = {name: found.value for name, found in kept.items() if name in _PHYSICS}
    count = _count(model)
    output = None if model.rotors is None else model.rotors.hover_output
    measured = output is not None and _has_curve(values, count, output)

    def made(of: Mapping[str, float]) -> list[float]:
        return list(_followed(of, known, count, output if measured else None).values())

    found = _followed(values, known, count, output if measured else None)
    spread = covariance_of(made, values, model.bounds).diagonal().tolist()
    numbers: dict[str, VehicleNumber] = {}
    for (name, value), variance in zip(found.items(), spread, strict=True):
        held = all(kept[part].status == "fixed" for part in _OF[name]) if name in _OF else False
        source: Source = "given" if held else "identified"
        std = math.sqrt(variance) if variance > 0.0 and not held else None
        numbers[name] = VehicleNumber(value=value, unit=UNITS[name], source=source, std=std, of=label_of(model))
    for name in ("c_0", "c_1", "c_2", "speed_max"):
        if not measured and name in numbers:
            words = f"{label_of(model)}, with {'thrust' if found['c_1'] else 'speed'} in proportion to output"
            numbers[name] = replace(numbers[name], of=words)
    numbers |= _inside_body(numbers, known)
    for name, other in (("kappa", "I_zz"), ("I_zz", "kappa")):
        # The flight shows their ratio well, and each alone badly or not at all.
        if other in known and name not in known:
            numbers.pop(name, None)
    return numbers


def _inside_body(numbers: Mapping[str, VehicleNumber], known: Mapping[str, float]) -> dict[str, VehicleNumber]:
    """Yaw inertia of a rigid body where the flight gives none: a normal distribution cut at what a body allows.

    Roll and pitch are known much better, and the ratio of torque and inertia of yaw is kept.
    """
    if not {"I_xx", "I_yy", "I_zz", "kappa_per_I_zz"} <= set(numbers) or {"I_zz", "kappa"} & set(known):
        return {}
    roll, pitch, yaw = (known.get(name, numbers[name].value) for name in ("I_xx", "I_yy", "I_zz"))
    low, high = abs(roll - pitch), roll + pitch
    if low <= yaw <= high:
        return {}
    from scipy.stats import truncnorm

    own = numbers["I_zz"]
    spread = max(own.std or 0.0, _LEAST_SPREAD * yaw)
    away = max(low - yaw, yaw - high) / spread
    value, std = min(max(yaw, low), high), numbers["I_xx"].std
    if away <= _CUT_SIGMAS:
        value, std = (float(n) for n in truncnorm.stats((low - yaw) / spread, (high - yaw) / spread, yaw, spread))
        std = math.sqrt(std)
    of = f"{own.of}, which gives {with_error(own.value, own.std)} {own.unit}, within what a rigid body allows"
    ratio = numbers["kappa_per_I_zz"]
    return {
        "I_zz": replace(own, value=value, std=std, source="derived", of=of),
        "kappa": replace(
            numbers["kappa"],
            value=ratio.value * value,
            std=None if std is None else ratio.value * std,
            source="derived",
            of=f"{ratio.of}, by kappa/I_zz and this I_zz",
        ),
    }


def _count(model: IdentifiedModel) -> int:
    """Rotors, by those of the result or by the speed at which they carry the weight."""
    if model.rotors is not None:
        return len(model.rotors.rotors)
    m, c_T, rho, D, n_h = (model.parameters[name].value for name in ("m", "c_T", "rho", "D", "n_h"))
    return max(round(m * STANDARD_GRAVITY_M_S2 / (c_T * rho * D**4 * n_h**2)), 1)


def _has_curve(values: Mapping[str, float], count: int, output: float) -> bool:
    """Whether the slope of the result and the outputs of its log go together."""
    weight_n, slope_n, _ = _hover(values, count)
    return _LEAST_SHARE <= slope_n * output / weight_n <= _MOST_SHARE


def _hover(of: Mapping[str, float], count: int) -> tuple[float, float, float]:
    """Thrust of a rotor in hover, its slope by the output, and the speed in revolutions a second."""
    weight_n = of["m"] * STANDARD_GRAVITY_M_S2 / count
    static = of["c_T"] * of["rho"] * of["D"] ** 4
    speed = math.sqrt(weight_n / static)
    return weight_n, 2.0 * of["k_n"] * static * speed, speed


def _assumed_hover(weight_n: float, slope_n: float) -> float:
    """Output of hover of rotors whose speed goes with the output, or else whose thrust does."""
    return 2.0 * weight_n / slope_n if 2.0 * weight_n / slope_n <= _MOST_HOVER else weight_n / slope_n


def curve_through(weight_n: float, slope_n: float, hover: float) -> tuple[float, float, float]:
    """Coefficients of a thrust that has its value and its slope in hover; see the head."""
    share = slope_n * hover / weight_n
    if share < 1.0:
        return weight_n - slope_n * hover, slope_n, 0.0
    if share > 2.0:
        return weight_n - 0.5 * slope_n * hover, 0.0, 0.5 * slope_n / hover
    return 0.0, (2.0 - share) * weight_n / hover, (share - 1.0) * weight_n / hover**2


def _followed(
    of: Mapping[str, float], known: Mapping[str, float], count: int, output: float | None
) -> dict[str, float]:
    """All numbers by the equations at the head."""
    scale, length = known.get("m", of["m"]) / of["m"], known.get("arm", of["l"]) / of["l"]
    weight_n, slope_n, speed = _hover(of, count)
    hover = _assumed_hover(weight_n, slope_n) if output is None else output
    c_0, c_1, c_2 = curve_through(weight_n, slope_n, hover)
    found = {"m": scale * of["m"], "arm": length * of["l"]}
    found |= {name: scale * length * of[name] for name in ("I_xx", "I_yy") if name in of}
    found |= {"c_0": scale * c_0, "c_1": scale * c_1, "c_2": scale * c_2}
    found["disc_area"] = scale * count * math.pi * of["D"] ** 2 / 4.0
    found["speed_max"] = 2.0 * math.pi * speed * math.sqrt((c_0 + c_1 + c_2) / weight_n)
    if "I_zz" in of:
        found["I_zz"] = scale * length**2 * of["I_zz"]
    if "c_P" in of:
        found["kappa"] = length**2 * of["c_P"] * of["D"] / (2.0 * math.pi * of["c_T"])
        if "I_zz" in of:
            found["kappa_per_I_zz"] = found["kappa"] / found["I_zz"]
    if "J_r" in of:
        found["h"] = scale * length**2 * 2.0 * math.pi * of["k_n"] * of["J_r"]
    return found
