r"""One vehicle from several results: a rigid body with rotors, and the source of each number.

Results of motors know mass, inertia, thrust and lag, those of hover the damping by speed and rate, those of rates what
is left. A quantity that several know is their mean, weighted by variances,

.. math:: \hat\theta = \frac{\sum_i \theta_i / \sigma_i^2}{\sum_i 1 / \sigma_i^2}, \qquad
    \sigma^2 = \Big( \sum_i 1/\sigma_i^2 \Big)^{-1}

if each agrees with it within three standard deviations; else the results are not of one vehicle.

Accelerations know ratios. A known mass, thrust or inertia gives the scale of all three, the length of the arm that of
inertia in roll and pitch, and one of :math:`\kappa` and :math:`I_{zz}` the other.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.quantity import with_error
from rotorid.errors import UsageError
from rotorid.flying.vehicle_air import (
    AIR_UNITS,
    PLACE,
    air_factors,
    curve_correlation,
    hover_parameters,
    implied_derivatives,
    rotor_flow,
)
from rotorid.models.families import family_of
from rotorid.models.flight import AIR_DENSITY_KG_M3
from rotorid.models.motors import CURVE_TERMS, SCALES, Curve, yaw_range
from rotorid.models.parameter import no_such
from rotorid.models.rotors import RotorLayout
from rotorid.planning.responses import answers_setpoints
from rotorid.simulation.linearization import hover_slopes
from rotorid.simulation.multirotor import Multirotor, Rotors
from rotorid.units import STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from rotorid.results.model import IdentifiedModel
    from rotorid.results.summary import ControllerSettings, MotorPhysics, ParameterEstimate

Source: TypeAlias = Literal["identified", "given", "derived", "default"]

UNITS: Mapping[str, str] = MappingProxyType(
    {
        "m": "kg",
        "I_xx": "kg m^2",
        "I_yy": "kg m^2",
        "I_zz": "kg m^2",
        "I_xy": "kg m^2",
        "I_xz": "kg m^2",
        "I_yz": "kg m^2",
        "c_0": "N",
        "c_1": "N",
        "c_2": "N",
        "kappa": "m",
        "kappa_per_I_zz": "1/(kg m)",
        "h_per_I_zz": "rad/s",
        "h": "kg m^2/s",
        "T_motor": "s",
        "T_motor_up": "s",
        "T_motor_down": "s",
        "delay": "s",
        "X_u": "1/s",
        "Y_v": "1/s",
        "Z_w": "1/s",
        "M_u": "1/(m s)",
        "L_v": "1/(m s)",
        "L_p": "1/s",
        "M_q": "1/s",
        "N_r": "1/s",
        "arm": "m",
        "speed_max": "rad/s",
        "disc_area": "m^2",
        "spin_min": "1",
        "spin_max": "1",
        "reference_v": "V",
        **dict.fromkeys((*PLACE, "z_cg"), "m"),
        **AIR_UNITS,
    }
)
"""Numbers of a vehicle. ``I_xy I_xz I_yz`` are entries of the matrix of inertia, forward, right, down; thrust of one
rotor in hover is ``c_0 + c_1 x + c_2 x^2`` of the lagged output x from zero to one, and its angular momentum ``h x``;
what moving air adds are the terms of `rotorid.models.flight`."""

MOTION: Mapping[str, tuple[int, int]] = MappingProxyType(
    {
        "X_u": (0, 0),
        "Y_v": (1, 1),
        "Z_w": (2, 2),
        "M_u": (4, 0),
        "L_v": (3, 1),
        "L_p": (3, 3),
        "M_q": (4, 4),
        "N_r": (5, 5),
    }
)
"""Acceleration by motion: rows and columns of ``u v w p q r``."""

_POSITIVE = ("m", "I_xx", "I_yy", "I_zz", "kappa", "arm", "speed_max", "disc_area", "reference_v")
_FROM_ZERO = ("T_motor", "T_motor_up", "T_motor_down", "spin_min", "spin_max", "h", "h_per_I_zz")
_INERTIA = ("I_xx", "I_yy", "I_zz")
_PRODUCTS: Mapping[str, tuple[int, int]] = {"I_xy": (0, 1), "I_xz": (0, 2), "I_yz": (1, 2)}
_TERMS = ("c_0", "c_1", "c_2")
_SCALED = ("m", *_TERMS, "I_xx", "I_yy")
_OF_MOTORS = ("T_motor", "L_p", "M_q", "N_r", "Z_w")
_BODY = ("m", "I_xx", "I_yy", "I_zz", "kappa", "arm")

_AGREEMENT_SIGMAS = 3.0
"""Standard deviations within which two results say the same."""

_SAME = 1e-6
"""Relative difference of numbers that are the same but for how they were written."""

_HOVER_DIFFERS = 0.05
"""Relative difference of the hover output of vehicle and result from which there is a remark."""

_HOVER_LOAD = 0.05
"""How far the mean thrust of a flight may lie from the weight for its mean output to be that of hover."""

_TRIANGLE_ROUNDING = 1e-3
"""Share of the yaw inertia by which it may violate the triangle of inertias, in addition to its errors."""

_UNIT_WORDS: Mapping[str, str] = {"rad/(s m)": "1/(m s)", "rad/(m s)": "1/(m s)"}


@dataclass(frozen=True, kw_only=True)
class VehicleNumber(Immutable):
    """A number of a vehicle, with its source.

    Parameters
    ----------
    value, unit
        SI.
    source
        ``identified`` from a log, ``given`` by the user, ``derived`` from others, ``default`` of something named.
    std
        One standard deviation of an identified number, random and model error together.
    of
        The result, the option or the vehicle that it comes from, for people.
    """

    value: float
    unit: str
    source: Source
    std: float | None = None
    of: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class JoinedVehicle(Immutable):
    """A vehicle joined from several results.

    Parameters
    ----------
    name
        What files and messages call it.
    multirotor
        The rigid body with its rotors; ``None`` where one of mass, inertia, thrust, arm and torque constant is missing.
    numbers
        By the names of :data:`UNITS`; what is not known is absent.
    dropped
        Motion derivatives that fits dropped and nothing else knows, as they were before, with the least that their
        errors can be.
    models
        What it was joined from.
    controller
        Gains of the first log that held some.
    altitude_m
        Of the flight above sea level, where known.
    draws
        The same joined from results drawn from their covariance, as many as an interval takes; none where nothing was
        drawn.
    findings
        Remarks.
    """

    name: str
    multirotor: Multirotor | None
    numbers: Mapping[str, VehicleNumber]
    dropped: Mapping[str, VehicleNumber] = field(default_factory=dict)
    models: tuple[IdentifiedModel, ...] = ()
    controller: ControllerSettings | None = None
    altitude_m: float | None = None
    draws: tuple[JoinedVehicle, ...] = field(default=(), repr=False)
    findings: tuple[Finding, ...] = field(default=())

    def __post_init__(self) -> None:
        self._set(
            numbers=self.numbers,
            dropped=self.dropped,
            models=tuple(self.models),
            draws=tuple(self.draws),
            findings=tuple(self.findings),
        )

    @property
    def stated_hover_output(self) -> float:
        """Mean output that a result states of its flights, if they hovered; by mass and thrust, where none does.

        Raises
        ------
        UsageError
            The vehicle is not known in full.
        """
        stated = (
            model.motors.hover_output
            for model in self.models
            if model.motors is not None and model.motors.outputs != "speed" and _hovered(model.motors)
        )
        return next(stated, self.hover_output)

    @property
    def hover_output(self) -> float:
        """Lagged output at which a rotor carries its share of the weight.

        Raises
        ------
        UsageError
            The vehicle is not known in full.
        """
        body = self._body
        return body.rotors.share_of(self.hover_force_n)

    @property
    def hover_force_n(self) -> float:
        """Share of the weight of one rotor, in newtons."""
        body = self._body
        return body.mass_kg * STANDARD_GRAVITY_M_S2 / body.rotors.layout.rotors

    @property
    def hover_slope_n(self) -> float:
        """Slope of thrust by output in hover, in newtons."""
        _, c_1, c_2 = self._body.rotors.thrust
        return c_1 + 2.0 * c_2 * self.hover_output

    @property
    def _body(self) -> Multirotor:
        return require(self, target="hover")


def require(vehicle: JoinedVehicle, *names: str, target: str) -> Multirotor:
    """The body of a vehicle of which some numbers have to be known.

    Parameters
    ----------
    vehicle
        What was joined.
    names
        Of :data:`UNITS`; a body needs mass, inertia, thrust, arm and torque constant in any case.
    target
        What they are needed for.

    Raises
    ------
    UsageError
        Some are missing. All of them are named, with the options that give them.
    """
    known = vehicle.numbers
    missing = [name for name in dict.fromkeys((*names, *_BODY)) if name not in known]
    if not any(name in known for name in _TERMS):
        missing.append("c_1")
    if vehicle.multirotor is not None and not missing:
        return vehicle.multirotor
    of_motors = [model for model in vehicle.models if model.motors is not None]
    asked = _asked_for(missing, from_motors=bool(of_motors) or "kappa_per_I_zz" in known)
    if not asked:
        raise UsageError(
            f"{target} needs the positions of the rotors of {vehicle.name}",
            remedy="add a result of physical.motors, or name a layout with --layout",
        )
    # Motors identified in yaw give the ratio of both, as soon as their scale is known.
    ratio = "kappa_per_I_zz" in known or any("N_r" in model.parameters for model in of_motors)
    follows = ratio and "kappa" in asked
    words = ", ".join(f"{name} ({', '.join(filter(None, (UNITS[name], _MEANINGS.get(name))))})" for name in asked)
    raise UsageError(
        f"{target} needs {words} of {vehicle.name}{_yaw_words(asked, known)}",
        remedy="add "
        + " ".join(
            f"--set {name}={_PLACES.get(UNITS[name], 'NUMBER')}" for name in asked if name != "I_zz" or not follows
        ),
    )


_PLACES = {"kg": "KG", "m": "M"}
"""What stands for a number of a unit in a command."""

_MEANINGS = {
    "kappa": "torque of a rotor over its thrust",
    "c_1": "thrust of a rotor per output",
    "arm": "from the center to a rotor",
}


def _asked_for(missing: Sequence[str], *, from_motors: bool) -> list[str]:
    """Of what is missing, that which does not follow from the rest: mass gives the scale of thrust and inertia."""
    follows = set(_SCALED[1:]) if "m" in missing and from_motors else set()
    if "arm" in missing and from_motors:
        follows |= {"I_xx", "I_yy"}
    return [name for name in missing if name not in follows]


def _yaw_words(asked: Sequence[str], known: Mapping[str, VehicleNumber]) -> str:
    """Bounds of physics where neither the torque constant nor the yaw inertia is known."""
    if not {"kappa", "I_zz"} <= set(asked) or "kappa_per_I_zz" not in known:
        return ""
    words = "; the flight gives their ratio, so one of the two is enough"
    if "I_xx" in known and "I_yy" in known:
        bound = yaw_range({name: known[name].value for name in ("I_xx", "I_yy", "kappa_per_I_zz")})
        words += f"; I_zz is at most {bound.I_zz.high:.3g} kg m^2 and kappa at most {bound.kappa.high:.3g} m"
    return words


def joined_vehicle(
    models: Sequence[IdentifiedModel],
    *,
    given: Mapping[str, float] | None = None,
    name: str = "vehicle",
    layout: RotorLayout | None = None,
    usual: Mapping[str, VehicleNumber] | None = None,
) -> JoinedVehicle:
    """Join results of one vehicle.

    Parameters
    ----------
    models
        Identified from logs of one vehicle: ``physical.motors``, ``hover.*``, ``rate.*`` and others.
    given
        Numbers by the names of :data:`UNITS` that were measured otherwise. They count where results disagree; one of
        mass, thrust and inertia scales the others of a result that knows no scale or has it from that number.
    name
        Of the vehicle.
    layout
        Rotors, where results do not hold them or hold others.
    usual
        Numbers for what neither results nor ``given`` hold, with where they come from.

    Raises
    ------
    UsageError
        There is no such number, it cannot be, or two results contradict each other.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> known = {"m": 1.2, "I_xx": 0.012, "I_yy": 0.012, "I_zz": 0.02, "c_2": 9.0, "kappa": 0.02, "arm": 0.25}
    >>> vehicle = joined_vehicle([], given=known, layout=library_layout("quad.x"))
    >>> round(vehicle.hover_output, 4), round(vehicle.hover_slope_n, 3)
    (0.5717, 10.291)
    """
    known = dict(given or {})
    _require_given(known)
    flown = [model for model in models if model.motors is not None]
    assumed = _assumed(flown, known, usual or {})
    in_force = {**known, **{key: number.value for key, number in assumed.items()}}
    rotors, arm = _rotors(flown, in_force, layout, usual or {})
    numbers = _joined_numbers(models, flown, in_force)
    if arm is not None:
        numbers["arm"] = arm
    numbers |= {key: _given(key, value) for key, value in known.items()} | assumed
    of_rotors = dict.fromkeys(_shown_by_air(numbers))
    numbers |= _usual(numbers, {name: number for name, number in (usual or {}).items() if name not in of_rotors})
    rotors, findings = _turning(rotors, numbers)
    findings += _yaw(numbers)
    findings += _spinning_up(numbers, rotors, models)
    if "h" not in numbers and usual is not None and "h" in usual:
        numbers["h"] = usual["h"]
    density_kg_m3 = next(
        (model.flight.density_kg_m3 for model in models if model.flight is not None), AIR_DENSITY_KG_M3
    )
    body = _multirotor(name, numbers, rotors, models, density_kg_m3=density_kg_m3)
    vehicle = JoinedVehicle(
        name=name,
        multirotor=body,
        numbers=numbers,
        dropped=_dropped(models, numbers),
        models=tuple(models),
        controller=next((model.controller for model in (*flown, *models) if model.controller is not None), None),
    )
    return replace(vehicle, findings=(*findings, *_hover_remarks(vehicle, flown)))


def _assumed(
    flown: Sequence[IdentifiedModel], known: Mapping[str, float], usual: Mapping[str, VehicleNumber]
) -> dict[str, VehicleNumber]:
    """Mass and arm that nobody gave, where results need them for their scale."""
    motors = [model.motors for model in flown if model.motors is not None]
    scaled = any(physics.scale is not None for physics in motors) or any(name in known for name in SCALES)
    sized = any(physics.arm_m is not None for physics in motors) or "arm" in known
    wanted = [name for name, there in (("m", scaled), ("arm", sized)) if motors and not there and name in usual]
    return {name: usual[name] for name in wanted}


def _usual(numbers: Mapping[str, VehicleNumber], usual: Mapping[str, VehicleNumber]) -> dict[str, VehicleNumber]:
    """Missing numbers that do not follow from known ones: curves are whole, and kappa and I_zz have a ratio.

    The momentum of a rotor may follow from what is filled in here, and comes after it.
    """
    found = {name: number for name, number in usual.items() if name not in numbers and name != "h"}
    follows = set(_TERMS) if any(term in numbers for term in _TERMS) else set()
    if "kappa_per_I_zz" in numbers:
        follows |= {"kappa", "I_zz"} if "kappa" in numbers or "I_zz" in numbers else {"I_zz"}
    return {name: number for name, number in found.items() if name not in follows}


def _given(name: str, value: float) -> VehicleNumber:
    return VehicleNumber(value=value, unit=UNITS[name], source="given", of=f"--set {name}")


def _require_given(known: Mapping[str, float]) -> None:
    for name, value in known.items():
        if name not in UNITS:
            wrong = no_such("number of a vehicle", name, UNITS)
            raise UsageError(wrong.came, needed=wrong.needed, remedy=wrong.remedy)
        low = 0.0 if name in _FROM_ZERO else -math.inf
        if not math.isfinite(value) or value < low or (name in _POSITIVE and value <= 0.0):
            raise UsageError(
                f"{name} = {value:g} {UNITS[name]} is out of range",
                needed="a positive number" if name in _POSITIVE else "zero or a positive number",
            )


def _label(model: IdentifiedModel) -> str:
    logs = [Path(path).name for path in model.provenance.inputs]
    return f"{model.name} of {', '.join(logs[:2])}{' …' if len(logs) > 2 else ''}" if logs else model.name


def _rotors(
    flown: Sequence[IdentifiedModel],
    known: Mapping[str, float],
    layout: RotorLayout | None,
    usual: Mapping[str, VehicleNumber],
) -> tuple[RotorLayout | None, VehicleNumber | None]:
    """Where the rotors are, and the length of the arm."""
    layouts = [(model, _layout_of(model.motors)) for model in flown if model.motors is not None]
    for model, other in layouts[1:]:
        first = layouts[0][1]
        if not np.array_equal(first.spins, other.spins) or not np.allclose(
            first.positions / first.arm, other.positions / other.arm, atol=1e-3
        ):
            raise _conflict("the places of the rotors", "", (layouts[0][0].motors, _label(layouts[0][0])), model)
    if layout is not None and layouts and layout.rotors != layouts[0][1].rotors:
        raise UsageError(
            f"{layout.name} has {layout.rotors} rotors, and {_label(layouts[0][0])} {layouts[0][1].rotors}",
            needed="the layout that flew: the thrust of each rotor was identified separately",
        )
    sized = [(model, layout) for model, layout in layouts if layout.arm_known]
    found = layout or (sized[0][1] if sized else layouts[0][1] if layouts else None)
    if found is None:
        return None, None
    if "arm" in known:
        return found.scaled(known["arm"]), None
    if found.arm_known:
        for model, item in sized:
            if not math.isclose(item.arm, found.arm, rel_tol=1e-3):
                raise _conflict("arm", "arm", (sized[0][1].arm, _label(sized[0][0])), model, item.arm)
        of = found.source or (_label(sized[0][0]) if sized else found.name)
        return found, VehicleNumber(value=found.arm, unit="m", source="given", of=of)
    if "arm" in usual:
        return found.scaled(usual["arm"].value), usual["arm"]
    return found, None


def _layout_of(motors: MotorPhysics) -> RotorLayout:
    return RotorLayout(
        name=motors.layout,
        positions=np.array(motors.rotors, dtype=np.float64),
        spins=np.array(motors.spins, dtype=np.float64),
        arm_known=motors.arm_m is not None,
        source="",
    )


def _conflict(
    what: str, option: str, first: tuple[object, str], other: IdentifiedModel, value: float | None = None
) -> UsageError:
    """Two results that contradict each other."""
    values = f": {first[0]:.4g} and {value:.4g}" if isinstance(first[0], float) and value is not None else ""
    return UsageError(
        f"{first[1]} and {_label(other)} contradict each other in {what}{values}",
        needed="results of one vehicle, within three standard deviations of each other",
        remedy=f"leave one out, or decide with --set {option}=NUMBER" if option else "leave one out",
    )


Estimates: TypeAlias = dict[str, list[VehicleNumber]]


def _joined_numbers(
    models: Sequence[IdentifiedModel], flown: Sequence[IdentifiedModel], known: Mapping[str, float]
) -> dict[str, VehicleNumber]:
    """All numbers of the results, joined."""
    scaled = [model for model in flown if model.motors is not None and model.motors.scale is not None]
    others = [model for model in flown if model not in scaled]
    parts = [_of_motors(model, known, None) for model in scaled]
    masses = [part["m"] for part in parts if "m" in part]
    mass = _combined("m", masses, known) if masses else None
    parts += [_of_motors(model, known, mass) for model in others]
    ordered = [*scaled, *others]
    numbers = _thrust(ordered, parts, known)
    for name in dict.fromkeys(key for part in parts for key in part if key not in _TERMS):
        numbers[name] = _combined(name, [part[name] for part in parts if name in part], known)
    families = [(model, family_of(model.structure)) for model in models if model.motors is None]
    linear = [(model, family.of_rates) for model, family in families if family.needs != "motor speeds"]
    # Lags from measured speeds are those of the motors themselves: no sensor or mixer stands between.
    own = [model for model, family in families if family.needs == "motor speeds" and "T_motor" not in known]
    measured = [_of_speeds(model) for model in own]
    for name in dict.fromkeys(key for part in measured for key in part):
        numbers[name] = _combined(name, [part[name] for part in measured if name in part], known)
    airframes = [model for model, of_rates in linear if not of_rates]
    rates = [model for model, of_rates in linear if of_rates]
    hover: Estimates = {}
    for model in airframes:
        for name, number in _of_airframe(model).items():
            hover.setdefault(name, []).append(number)
    for name, found in hover.items():
        # A lag from commands holds the mixer's straightening too: that of the motors counts.
        if name in MOTION or name not in numbers:
            numbers[name] = _combined(name, [*([numbers[name]] if name in numbers else []), *found], known)
    left: Estimates = {}
    for model in rates:
        for name, number in _of_airframe(model).items():
            if name not in numbers:
                left.setdefault(name, []).append(number)
    return numbers | {name: _combined(name, found, known) for name, found in left.items()}


def _number(name: str, found: ParameterEstimate, of: str, factor: float = 1.0) -> VehicleNumber:
    source: Source = "given" if found.status == "fixed" else "derived" if found.status == "tied" else "identified"
    std = None if found.std is None or source == "given" else abs(factor) * found.std
    return VehicleNumber(value=factor * found.value, unit=UNITS[name], source=source, std=std, of=of)


def _of_motors(
    model: IdentifiedModel, known: Mapping[str, float], mass: VehicleNumber | None
) -> dict[str, VehicleNumber]:
    """Numbers of a motor result in meters, shares of output and kilograms, where these are known."""
    motors, of = model.motors, _label(model)
    assert motors is not None
    kept = {name: estimate for name, estimate in hover_parameters(model).items() if estimate.status != "dropped"}
    factors = _unit_factors(motors, known)
    scale = _scale(model, factors, known, mass)
    found: dict[str, VehicleNumber] = {}
    for name in (*_SCALED, "kappa_per_I_zz", "kappa", "I_zz"):
        power = -1.0 if name == "kappa_per_I_zz" else 0.0 if name in ("kappa", "I_zz") else 1.0
        known_factor = name in kept and name in factors and (scale is not None or power == 0.0)
        # Of kappa and I_zz only the one that was held is a measurement, the other follows below.
        if known_factor and (power != 0.0 or kept[name].status == "fixed"):
            found[name] = _number(name, kept[name], of, factors[name] * (scale or 1.0) ** power)
    neither_held = {kept[name].status for name in ("kappa", "I_zz") if name in kept} == {"free"}
    if model.flight is not None and neither_held and scale is not None and "I_xx" in factors:
        # The result assumes a flat vehicle.
        flat = _number("I_zz", kept["I_zz"], of, factors["I_xx"] * scale)
        found["I_zz"] = replace(flat, source="default", of="a flat vehicle, as nobody gave I_zz")
    found |= {name: _number(name, kept[name], of) for name in _OF_MOTORS if name in kept}
    if "h_per_I_zz" in kept and "h_per_I_zz" in factors:
        found["h_per_I_zz"] = _number("h_per_I_zz", kept["h_per_I_zz"], of, factors["h_per_I_zz"])
    found |= _of_air(model, factors, scale)
    delay = next((name for name in ("tau_gyro", "tau_accel") if name in kept), None)
    if delay is not None:
        found["delay"] = _number("delay", kept[delay], of)
    if motors.reference_v is not None:
        found["reference_v"] = VehicleNumber(value=motors.reference_v, unit="V", source="derived", of=of)
    # What a fit assumed, from other numbers and what is usual, nobody gave.
    assumed = model.flight.missing if model.flight is not None else {}
    return {name: replace(number, source="derived") if name in assumed else number for name, number in found.items()}


def _of_air(model: IdentifiedModel, factors: Mapping[str, float], scale: float | None) -> dict[str, VehicleNumber]:
    """What a result of ``physical.flight`` knows of the air, of the rotors' inertia and of the accelerometer."""
    flight, motors = model.flight, model.motors
    if flight is None or motors is None:
        return {}
    kept = {name: estimate for name, estimate in model.parameters.items() if estimate.status != "dropped"}
    of = _label(model)
    of_air = air_factors(model, full=factors.get("c_1"), scale=scale, length=factors.get("I_xx", 1.0))
    found = {name: _number(name, kept[name], of, of_air[name]) for name in AIR_UNITS if name in kept and name in of_air}
    found |= {name: _number(name, kept[name], of) for name in (*PLACE, "z_cg") if name in kept}
    if "J_r" in kept and "J_r" in of_air:
        found["h"] = _number("h", kept["J_r"], of, of_air["J_r"])
    if scale is not None:
        # Only thrust over disc acts: with another mass the disc is another one.
        area_m2 = len(motors.rotors) * flight.disc_m2 * scale
        source: Source = "default" if flight.disc_assumed else "given"
        words = "rotors of the usual size for this frame" if flight.disc_assumed else of
        found["disc_area"] = VehicleNumber(value=area_m2, unit="m^2", source=source, of=words)
    return found


def _unit_factors(motors: MotorPhysics, known: Mapping[str, float]) -> dict[str, float]:
    """What brings each number into meters and shares of output; absent where that is not known."""
    factors = dict.fromkeys(("m", "c_0", "kappa_per_I_zz", "kappa", "I_zz"), 1.0)
    own_m = motors.arm_m
    if own_m is not None or "arm" in known:
        length = known.get("arm", own_m or 1.0) / (own_m or 1.0)
        factors |= {"I_xx": length, "I_yy": length}
    full = known.get("speed_max") if motors.outputs == "speed" else 1.0
    if full is not None:
        factors |= {"c_1": full, "c_2": full**2, "h_per_I_zz": full}
    return factors


def _scale(
    model: IdentifiedModel, factors: Mapping[str, float], known: Mapping[str, float], mass: VehicleNumber | None
) -> float | None:
    """Factor of mass, thrust and inertia; ``None`` where a result knows them by the kilogram only and nothing helps."""
    motors = model.motors
    assert motors is not None
    own = motors.scale
    wanted, parameters = SCALES if own is None else (own,), hover_parameters(model)
    for name in wanted:
        found = parameters.get(name)
        if name in known and name in factors and found is not None and found.value:
            return known[name] / (factors[name] * found.value)
    if own is None and mass is not None:
        return mass.value / model.parameters["m"].value
    return None if own is None else 1.0


def _thrust(
    models: Sequence[IdentifiedModel], parts: Sequence[Mapping[str, VehicleNumber]], known: Mapping[str, float]
) -> dict[str, VehicleNumber]:
    """The curve of thrust, joined as a whole: its coefficients are known together much better than alone."""
    flown = [
        (model, part)
        for model, part in zip(models, parts, strict=True)
        if model.motors is not None and {*_terms(model, model.motors)} <= set(part)
    ]
    if not flown or set(_TERMS) <= set(known):
        return {}
    first, part = flown[0]
    assert first.motors is not None
    terms = _terms(first, first.motors)
    for model, _ in flown[1:]:
        assert model.motors is not None
        if model.motors.curve != first.motors.curve:
            raise _conflict("the curve of thrust", "", (first.motors.curve, _label(first)), model)
    absent = {
        name: VehicleNumber(value=0.0, unit="N", source="derived", of=f"a {first.motors.curve} curve")
        for name in _TERMS
        if name not in terms
    }
    if len(flown) == 1:
        return {name: part[name] for name in terms} | absent
    volts = first.motors.reference_v
    alike = [_at_voltage(numbers, volts) for _, numbers in flown]
    return _joint_curve(flown, alike, terms, known) | absent


def _terms(model: IdentifiedModel, motors: MotorPhysics) -> tuple[str, ...]:
    """Coefficients of the curve of a result; the physics of flight has those that its flights show."""
    return CURVE_TERMS[_curve(motors)] if model.flight is None else tuple(n for n in _TERMS if n in model.parameters)


def _curve(motors: MotorPhysics) -> Curve:
    return motors.curve if motors.curve in CURVE_TERMS else "polynomial"  # type: ignore[return-value]


def _at_voltage(part: Mapping[str, VehicleNumber], volts: float | None) -> dict[str, VehicleNumber]:
    """The curve at another voltage, with the square of which thrust grows."""
    own = part.get("reference_v")
    factor = 1.0 if own is None or volts is None else (volts / own.value) ** 2
    return {
        name: replace(number, value=factor * number.value, std=None if number.std is None else factor * number.std)
        for name, number in part.items()
        if name in _TERMS
    }


def _joint_curve(
    flown: Sequence[tuple[IdentifiedModel, Mapping[str, VehicleNumber]]],
    alike: Sequence[Mapping[str, VehicleNumber]],
    terms: Sequence[str],
    known: Mapping[str, float],
) -> dict[str, VehicleNumber]:
    separate = {name: _combined(name, [numbers[name] for numbers in alike], known) for name in terms}
    if any(numbers[name].std is None for numbers in alike for name in terms):
        return separate
    information, weighted = np.zeros((len(terms),) * 2), np.zeros(len(terms))
    for (model, _), numbers in zip(flown, alike, strict=True):
        std = np.array([numbers[name].std or 0.0 for name in terms])
        precision = np.linalg.inv(curve_correlation(model, terms) * np.outer(std, std))
        information += precision
        weighted += precision @ np.array([numbers[name].value for name in terms])
    covariance = np.linalg.inv(information)
    values = covariance @ weighted
    spread = np.sqrt(covariance.diagonal())
    return {name: replace(separate[name], value=float(values[i]), std=float(spread[i])) for i, name in enumerate(terms)}


def _of_airframe(model: IdentifiedModel) -> dict[str, VehicleNumber]:
    """Damping, lag and delay of a model from commands to motion."""
    of = _label(model)
    found = {
        name: _number(name, estimate, of)
        for name, estimate in model.parameters.items()
        if name in MOTION
        and estimate.status != "dropped"
        and _UNIT_WORDS.get(estimate.unit, estimate.unit) == UNITS[name]
    }
    lag = model.parameters.get("T_motor")
    if lag is not None and lag.status != "dropped":
        found["T_motor"] = _number("T_motor", lag, of)
    late = [budget for budget in model.delays.values() if budget.total_s > 0.0]
    # Behind a set-point the delay is one of the whole loop, and with it in front of the motors that loop would tumble.
    if late and not answers_setpoints(model.structure):
        first = late[0]
        known_s = first.known_filters_s or 0.0
        own_s = max(first.input_delay_s + first.output_delay_s - known_s, 0.0)
        found["delay"] = VehicleNumber(value=own_s, unit="s", source="derived", std=_delay_std(model), of=of)
    return found


def _of_speeds(model: IdentifiedModel) -> dict[str, VehicleNumber]:
    """Lags of the motors from their speeds: up, down, and the mean for what knows one lag only."""
    of, estimates = _label(model), model.parameters
    found = {name: _number(name, estimates[name], of) for name in ("T_motor_up", "T_motor_down")}
    up, down = found.values()
    std = None if up.std is None or down.std is None else 0.5 * math.hypot(up.std, down.std)
    mean = VehicleNumber(value=0.5 * (up.value + down.value), unit="s", source="derived", std=std, of=of)
    return {**found, "T_motor": mean}


def _dropped(models: Sequence[IdentifiedModel], numbers: Mapping[str, VehicleNumber]) -> dict[str, VehicleNumber]:
    """Derivatives that a reduction took out of the models, by their last estimates and Cramér–Rao bounds."""
    found = {}
    for model in models:
        for step in model.fit.reduction:
            name, percent = step.parameter, step.cramer_rao_percent
            if step.action != "dropped" or name not in MOTION or name in numbers or not percent:
                continue
            if _UNIT_WORDS.get(model.parameters[name].unit, model.parameters[name].unit) != UNITS[name]:
                continue
            std = abs(step.value_before) * percent / 100.0
            of = f"dropped from {_label(model)}"
            found[name] = VehicleNumber(value=step.value_before, unit=UNITS[name], source="identified", std=std, of=of)
    return found


def _delay_std(model: IdentifiedModel) -> float | None:
    """Of the delay to the first output that has one, by its own parameters: with a lag their sum is known better."""
    (pair, first), *_ = ((pair, budget) for pair, budget in model.delays.items() if budget.total_s > 0.0)
    output, _, command = pair.partition("/")
    of = model.structure
    entries = of.input_delays[of.inputs.index(command)], of.output_delays[of.outputs.index(output)]
    names = {name for entry in entries for name in entry.names}
    stds = [estimate.std for name, estimate in model.parameters.items() if name in names and estimate.std]
    return math.hypot(*stds) if stds else first.total_std_s


def _combined(name: str, found: Sequence[VehicleNumber], known: Mapping[str, float]) -> VehicleNumber:
    """One number from several, weighted by their variances; one that is certain counts alone.

    Raises
    ------
    UsageError
        They contradict each other, and nothing was given.
    """
    if len(found) == 1 or name in known:
        return found[0]
    if name == "delay":
        # Each log and each filter adds its own: what is not in all of them is not the vehicle's.
        return min(found, key=lambda number: number.value)
    if name == "reference_v":
        return found[0]
    certain = [number for number in found if not number.std]
    measured = [number for number in found if number.std]
    if certain:
        best = certain[0]
        mean, std = best.value, 0.0
    else:
        weights = np.array([1.0 / number.std**2 for number in measured if number.std])
        mean = float(weights @ [number.value for number in measured] / weights.sum())
        std = float(weights.sum() ** -0.5)
        best = VehicleNumber(
            value=mean,
            unit=measured[0].unit,
            source=measured[0].source,
            std=std,
            of=" and ".join(dict.fromkeys(number.of for number in measured)),
        )
    for number in found:
        for other in found:
            reach = max(_AGREEMENT_SIGMAS * math.hypot(number.std or 0.0, other.std or 0.0), _SAME * abs(other.value))
            if abs(number.value - other.value) > reach:
                raise UsageError(
                    f"{number.of} and {other.of} contradict each other in {name}: {_words(number)} and {_words(other)}",
                    needed="results of one vehicle, within three standard deviations of each other",
                    remedy=f"leave one out, or decide with --set {name}=NUMBER",
                )
    return best


def _words(number: VehicleNumber) -> str:
    return f"{with_error(number.value, number.std)} {number.unit}"


def _turning(rotors: RotorLayout | None, numbers: dict[str, VehicleNumber]) -> tuple[RotorLayout | None, list[Finding]]:
    """Rotors that turn as the flight shows: a negative torque constant is that of the other direction."""
    ratio = numbers.get("kappa_per_I_zz")
    if rotors is None or ratio is None or ratio.value >= 0.0:
        return rotors, []
    numbers["kappa_per_I_zz"] = replace(ratio, value=-ratio.value)
    message = "Yaw answered against the layout: all rotors are taken to turn the other way round."
    return replace(rotors, spins=-rotors.spins), [warn("assumed_geometry", "yaw", message, identified=ratio.value)]


def _yaw(numbers: dict[str, VehicleNumber]) -> list[Finding]:
    """Fill in the one of torque constant and inertia of yaw that follows from the other."""
    ratio = numbers.get("kappa_per_I_zz")
    kappa, inertia = numbers.get("kappa"), numbers.get("I_zz")
    if ratio is None or ratio.value <= 0.0:
        return []
    share = (ratio.std or 0.0) / ratio.value
    if kappa is not None and inertia is not None:
        off = abs(kappa.value / inertia.value / ratio.value - 1.0)
        if off <= max(_AGREEMENT_SIGMAS * share, 0.01):
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


_ANY_SPEED_RAD_S = 1000.0
"""Of rotors at full output, where it is not known: only its product with their inertia acts."""


def _spinning_up(
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
    return VehicleNumber(value=lead_s, unit="s", source="derived", std=share * lead_s, of=_label(model))


def _hover_slope_n(numbers: Mapping[str, VehicleNumber], rotors: RotorLayout | None) -> float | None:
    """Slope of thrust by output in hover, in newtons, where mass, curve and rotors are known."""
    if "m" not in numbers or not any(term in numbers for term in _TERMS) or rotors is None or not rotors.arm_known:
        return None
    c_0, c_1, c_2 = (numbers[term].value if term in numbers else 0.0 for term in _TERMS)
    weight_n = numbers["m"].value * STANDARD_GRAVITY_M_S2
    return c_1 + 2.0 * c_2 * Rotors(layout=rotors, thrust=(c_0, c_1, c_2)).share_of(weight_n / rotors.rotors)


def _follows(name: str, value: float, share: float, other: VehicleNumber) -> VehicleNumber:
    std = value * share if share else None
    of = f"the identified kappa/I_zz and {other.of}" if other.of else "the identified kappa/I_zz"
    source: Source = "default" if other.source == "default" else "derived"
    return VehicleNumber(value=value, unit=UNITS[name], source=source, std=std, of=of)


def _require_body(numbers: Mapping[str, VehicleNumber], share: float) -> None:
    """Refuse a yaw inertia that is impossible for these of roll and pitch, well beyond its uncertainty."""
    if not set(_INERTIA) <= set(numbers):
        return
    roll, pitch, yaw = (numbers[name].value for name in _INERTIA)
    spread = math.sqrt(sum((numbers[name].std or 0.0) ** 2 for name in _INERTIA))
    room = _AGREEMENT_SIGMAS * max(spread, share * yaw) + _TRIANGLE_ROUNDING * yaw
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


def _multirotor(
    name: str,
    numbers: dict[str, VehicleNumber],
    rotors: RotorLayout | None,
    models: Sequence[IdentifiedModel],
    *,
    density_kg_m3: float,
) -> Multirotor | None:
    """The rigid body, where everything that it needs is known; what its rotors do about hover goes to the numbers."""
    curve = any(term in numbers for term in _TERMS)
    if rotors is None or not rotors.arm_known or not curve or not set(_BODY) <= set(numbers):
        return None
    value = {key: number.value for key, number in numbers.items()}
    inertia = np.diag([value[key] for key in _INERTIA])
    for key, (i, j) in _PRODUCTS.items():
        inertia[i, j] = inertia[j, i] = value.get(key, 0.0)
    c_0, c_1, c_2 = (value.get(term, 0.0) for term in _TERMS)
    body = Multirotor(
        name=name,
        mass_kg=value["m"],
        inertia_kg_m2=inertia,
        rotors=Rotors(
            layout=rotors,
            thrust=(c_0, c_1, c_2),
            torque_per_thrust_m=value["kappa"],
            lag_up_s=value.get("T_motor_up", value.get("T_motor", 0.0)),
            lag_down_s=value.get("T_motor_down"),
            induced_drag_n_s_m=value.get("k_d", 0.0),
            inflow_n_s_m=value.get("c_lambda", 0.0),
            inertia_kg_m2=value.get("h", 0.0) / value.get("speed_max", _ANY_SPEED_RAD_S),
            full_speed_rad_s=value.get("speed_max", _ANY_SPEED_RAD_S) if "h" in value else 0.0,
            flow=rotor_flow(value, rotors=rotors.rotors, density_kg_m3=density_kg_m3),
        ),
        vertical_drag_n_s2_m2=value.get("d_z", 0.0),
        center_of_gravity_m=(0.0, 0.0, value.get("z_cg", 0.0)),
        source=", ".join(dict.fromkeys(map(_label, models))),
    )
    of_rotors = np.zeros((6, 6))
    if shown := _shown_by_air(numbers):
        of_rotors = hover_slopes(body)
        for key, std in _slope_stds(models, numbers, shown).items():
            of = " and ".join(dict.fromkeys(numbers[cause].of for cause in _CAUSES[key] if cause in numbers))
            own = VehicleNumber(value=float(of_rotors[MOTION[key]]), unit=UNITS[key], source="derived", std=std, of=of)
            other = numbers.get(key)
            if other is None:
                numbers[key] = own
            elif other.source != "given":
                numbers[key] = _combined(key, [own, other], {})
    size = np.array([value["m"]] * 3 + [value[key] for key in _INERTIA])
    air = np.zeros((6, 6))
    for key, place in MOTION.items():
        # A derivative is that of rotors and body together.
        total = numbers[key].value if key in numbers else float(of_rotors[place])
        rest = total - float(of_rotors[place])
        air[place] = 0.0 if abs(rest) <= _SAME * abs(total) else size[place[0]] * rest
    return replace(body, aerodynamics=air)


_CAUSES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "X_u": ("k_d",),
        "Y_v": ("k_d",),
        "Z_w": ("c_lambda",),
        "M_u": ("m_f", "m_fx", "k_d", "z_cg"),
        "L_v": ("m_f", "k_d", "z_cg"),
        "L_p": ("c_lambda", "k_d", "m_f"),
        "M_q": ("c_lambda", "k_d", "m_f", "m_fx"),
        "N_r": ("k_d", "k_r"),
    }
)
"""What of the rotors' air makes a derivative of hover; the first has to be known for it, or the last if a height."""


def _shown_by_air(numbers: Mapping[str, VehicleNumber]) -> tuple[str, ...]:
    """Derivatives of hover that follow from what the rotors do in moving air."""
    return tuple(
        key
        for key, causes in _CAUSES.items()
        if causes[0] in numbers or (causes[-1] == "z_cg" and {"k_d", "z_cg"} <= numbers.keys())
    )


def _slope_stds(
    models: Sequence[IdentifiedModel], numbers: Mapping[str, VehicleNumber], shown: Sequence[str]
) -> dict[str, float | None]:
    """Standard deviation of each derivative that follows, by the results of flight that know it."""
    given = [name for name, number in numbers.items() if number.source == "given"]
    precision: dict[str, float] = {}
    for model in models:
        if model.flight is None:
            continue
        implied = implied_derivatives(model, (0.0,), exact=given)
        for key, std in zip(implied.names, implied.std[0].tolist(), strict=True):
            if std > 0.0:
                precision[key] = precision.get(key, 0.0) + 1.0 / std**2
    return {key: precision[key] ** -0.5 if key in precision else None for key in shown}


def _hovered(motors: MotorPhysics) -> bool:
    """Whether the mean output of the fitted stretches is one of hover; as older results do not state it, they did."""
    return motors.load_factor is None or abs(motors.load_factor - 1.0) <= _HOVER_LOAD


def _hover_remarks(vehicle: JoinedVehicle, flown: Iterable[IdentifiedModel]) -> list[Finding]:
    """Whether the rotors carry the weight where they did in flight; turns and climbs do not show it."""
    if vehicle.multirotor is None:
        return []
    hover = vehicle.hover_output
    found = []
    for model in flown:
        motors = model.motors
        if motors is None or motors.outputs == "speed" or not _hovered(motors):
            continue
        if abs(hover / motors.hover_output - 1.0) <= _HOVER_DIFFERS:
            continue
        message = (
            f"Mass and thrust give a hover output of {hover:.3f}; the mean in {_label(model)} was "
            f"{motors.hover_output:.3f}. The vehicle hovers at the former."
        )
        numbers = {"hover_output": hover, "flown_output": motors.hover_output}
        found.append(remark("implausible_physics", "hover", message, **numbers))
    return found
