"""Numbers that follow from a known ratio and one of its parts: torque and inertia of yaw, momentum of a rotor."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from rotorid.data.findings import Finding, remark, warn
from rotorid.errors import UsageError
from rotorid.flying.vehicle_numbers import (
    AGREEMENT_SIGMAS,
    INERTIA,
    UNITS,
    Source,
    VehicleNumber,
    label_of,
)
from rotorid.models.flight import CURVE_TERMS
from rotorid.models.rotors import RotorLayout
from rotorid.simulation.multirotor import Rotors
from rotorid.units import STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from rotorid.results.model import IdentifiedModel

_TRIANGLE_ROUNDING = 1e-3
"""Share of the yaw inertia by which it may violate the triangle of inertias, in addition to its errors."""


def turning_as_flown(
    rotors: RotorLayout | None, numbers: dict[str, VehicleNumber]
) -> tuple[RotorLayout | None, list[Finding]]:
    """Rotors that turn as the flight shows: a negative torque constant is that of the other direction."""
    ratio = numbers.get("kappa_per_I_zz")
    if rotors is None or ratio is None or ratio.value >= 0.0:
        return rotors, []
    numbers["kappa_per_I_zz"] = replace(ratio, value=-ratio.value)
    message = "Yaw answered against the layout: all rotors are taken to turn the other way round."
    return replace(rotors, spins=-rotors.spins), [warn("assumed_geometry", "yaw", message, identified=ratio.value)]


def fill_yaw(numbers: dict[str, VehicleNumber]) -> list[Finding]:
    """Fill in the one of torque constant and inertia of yaw that follows from the other."""
    ratio = numbers.get("kappa_per_I_zz")
    kappa, inertia = numbers.get("kappa"), numbers.get("I_zz")
    if ratio is None or ratio.value <= 0.0:
        return []
    share = (ratio.std or 0.0) / ratio.value
    if kappa is not None and inertia is not None:
        off = abs(kappa.value / inertia.value / ratio.value - 1.0)
        if off <= max(AGREEMENT_SIGMAS * share, 0.01):
            return []
        message = (
            f"kappa / I_zz = {kappa.value / inertia.value:.4g} 1/(kg m) as given, and {ratio.value:.4g} as the flight "
            "shows: yaw will answer otherwise than it did."
        )
        return [warn("implausible_physics", "kappa", message, flown=ratio.value, given=kappa.value / inertia.value)]
    if kappa is not None:
        value = kappa.value / ratio.value
        numbers["I_zz"] = _follows("I_zz", value, share, kappa)
    elif inertia is not None:
        value = ratio.value * inertia.value
        numbers["kappa"] = _follows("kappa", value, share, inertia)
    else:
        return []
    _require_body(numbers, share)
    return []


ANY_SPEED_RAD_S = 1000.0
"""Of rotors at full output, where it is not known: only its product with their inertia acts."""


def fill_momentum(
    numbers: dict[str, VehicleNumber], rotors: RotorLayout | None, models: Sequence[IdentifiedModel]
) -> list[Finding]:
    r"""Fill in the angular momentum of a rotor, from motors with the inertia of yaw, or from yaw with its torque.

    Yaw by a command knows what the spin-up adds to the torque: :math:`h = (N_{spin} / N_{yaw}) \, \kappa \, dF/dx` in
    hover, whatever the mixer makes of the command.
    """
    of_motors, inertia = numbers.get("h_per_I_zz"), numbers.get("I_zz")
    if "h" in numbers and numbers["h"].source == "given":
        return []
    if "h" not in numbers and of_motors is not None and inertia is not None:
        numbers["h"] = _product("h", of_motors, inertia.value, inertia)
    elif "h" not in numbers:
        lead = next((found for model in models if (found := _lead_of(model)) is not None), None)
        kappa = numbers.get("kappa")
        slope = None if lead is None else _hover_slope_n(numbers, rotors)
        if lead is None or slope is None or kappa is None:
            return []
        numbers["h"] = _product("h", lead, kappa.value * slope, kappa)
    message = (
        f"A rotor has an angular momentum of {numbers['h'].value:.3g} kg m^2/s at full output, which turns the vehicle "
        "in yaw when rotors spin up. rotorid simulate includes this; exported simulators only where they model it."
    )
    return [remark("spin_up", "h", message, kg_m2_s=numbers["h"].value)]


def _product(name: str, number: VehicleNumber, factor: float, other: VehicleNumber) -> VehicleNumber:
    std = None if number.std is None else abs(factor) * number.std
    source: Source = "default" if other.source == "default" else "derived"
    of = " and ".join(dict.fromkeys(text for text in (number.of, other.of) if text))
    return VehicleNumber(value=number.value * factor, unit=UNITS[name], source=source, std=std, of=of)


def _lead_of(model: IdentifiedModel) -> VehicleNumber | None:
    """Lead of yaw in seconds of torque, where a model from commands has one."""
    spin, torque = model.parameters.get("N_spin"), model.parameters.get("N_yaw")
    if spin is None or torque is None or spin.status == "dropped" or spin.value <= 0.0 or torque.value <= 0.0:
        return None
    share = math.hypot((spin.std or 0.0) / spin.value, (torque.std or 0.0) / torque.value)
    lead_s = spin.value / torque.value
    return VehicleNumber(value=lead_s, unit="s", source="derived", std=share * lead_s, of=label_of(model))


def _hover_slope_n(numbers: Mapping[str, VehicleNumber], rotors: RotorLayout | None) -> float | None:
    """Slope of thrust by output in hover, in newtons, where mass, curve and rotors are known."""
    if "m" not in numbers or not any(term in numbers for term in CURVE_TERMS) or rotors is None or not rotors.arm_known:
        return None
    c_0, c_1, c_2 = (numbers[term].value if term in numbers else 0.0 for term in CURVE_TERMS)
    weight_n = numbers["m"].value * STANDARD_GRAVITY_M_S2
    return c_1 + 2.0 * c_2 * Rotors(layout=rotors, thrust=(c_0, c_1, c_2)).share_of(weight_n / rotors.rotors)


def _follows(name: str, value: float, share: float, other: VehicleNumber) -> VehicleNumber:
    std = value * share if share else None
    of = f"the identified kappa/I_zz and {other.of}" if other.of else "the identified kappa/I_zz"
    source: Source = "default" if other.source == "default" else "derived"
    return VehicleNumber(value=value, unit=UNITS[name], source=source, std=std, of=of)


def _require_body(numbers: Mapping[str, VehicleNumber], share: float) -> None:
    """Refuse a yaw inertia that is impossible for these of roll and pitch, well beyond its uncertainty."""
    if not set(INERTIA) <= set(numbers):
        return
    roll, pitch, yaw = (numbers[name].value for name in INERTIA)
    spread = math.sqrt(sum((numbers[name].std or 0.0) ** 2 for name in INERTIA))
    room = AGREEMENT_SIGMAS * max(spread, share * yaw) + _TRIANGLE_ROUNDING * yaw
    low, high = abs(roll - pitch), roll + pitch
    if low - room <= yaw <= high + room:
        return
    ratio = numbers["kappa_per_I_zz"].value
    raise UsageError(
        f"kappa = {numbers['kappa'].value:.4g} m ({numbers['kappa'].of}) makes I_zz {yaw:.4g} kg m^2; with "
        f"I_xx = {roll:.4g} and I_yy = {pitch:.4g} no rigid body has that",
        needed=f"I_zz from {low:.3g} to {high:.3g} kg m^2 (kappa from {ratio * low:.3g} to {ratio * high:.3g} m)",
        remedy="add --set kappa=NUMBER or --set I_zz=NUMBER",
    )
