"""One vehicle from several results: a rigid body with rotors, and the source of each number.

Each number is the first of: what somebody gave, what results know (:mod:`rotorid.flying.known_by_results`), what
follows from a ratio that they know (:mod:`rotorid.flying.vehicle_ratios`), and what is usual for a similar vehicle.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, remark
from rotorid.errors import UsageError
from rotorid.flying.known_by_results import combined, dropped_numbers, joined_numbers, rotors_of
from rotorid.flying.vehicle_air import (
    implied_derivatives,
    rotor_flow,
)
from rotorid.flying.vehicle_numbers import (
    BODY,
    INERTIA,
    MOTION,
    PRODUCTS,
    SAME,
    SCALED,
    UNITS,
    VehicleNumber,
    given_number,
    label_of,
    require_given,
)
from rotorid.flying.vehicle_ratios import ANY_SPEED_RAD_S, fill_momentum, fill_yaw, turning_as_flown
from rotorid.models.flight import AIR_DENSITY_KG_M3, CURVE_TERMS
from rotorid.models.motors import SCALES, yaw_range
from rotorid.models.rotors import RotorLayout
from rotorid.simulation.linearization import hover_slopes
from rotorid.simulation.multirotor import Multirotor, Rotors
from rotorid.units import STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from rotorid.results.model import IdentifiedModel
    from rotorid.results.summary import ControllerSettings, MotorPhysics

_HOVER_DIFFERS = 0.05
"""Relative difference of the hover output of vehicle and result from which there is a remark."""

_HOVER_LOAD = 0.05
"""How far the mean thrust of a flight may lie from the weight for its mean output to be that of hover."""


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
    layout
        Its rotors, in units of the arm where that is not known; ``None`` where nothing says where they are.
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
    layout: RotorLayout | None = None
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
    missing = [name for name in dict.fromkeys((*names, *BODY)) if name not in known]
    if not any(name in known for name in CURVE_TERMS):
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
    follows = set(SCALED[1:]) if "m" in missing and from_motors else set()
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
    require_given(known)
    flown = [model for model in models if model.motors is not None]
    assumed = _assumed(flown, known, usual or {})
    in_force = {**known, **{key: number.value for key, number in assumed.items()}}
    rotors, arm = rotors_of(models, in_force, layout, usual or {})
    numbers = joined_numbers(models, flown, in_force)
    if arm is not None:
        numbers["arm"] = arm
    numbers |= {key: given_number(key, value) for key, value in known.items()} | assumed
    of_rotors = dict.fromkeys(_shown_by_air(numbers))
    numbers |= _usual(numbers, {name: number for name, number in (usual or {}).items() if name not in of_rotors})
    rotors, findings = turning_as_flown(rotors, numbers)
    findings += fill_yaw(numbers)
    findings += fill_momentum(numbers, rotors, models)
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
        dropped=dropped_numbers(models, numbers),
        models=tuple(models),
        controller=next((model.controller for model in (*flown, *models) if model.controller is not None), None),
        layout=rotors,
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
    follows = set(CURVE_TERMS) if any(term in numbers for term in CURVE_TERMS) else set()
    if "kappa_per_I_zz" in numbers:
        follows |= {"kappa", "I_zz"} if "kappa" in numbers or "I_zz" in numbers else {"I_zz"}
    return {name: number for name, number in found.items() if name not in follows}


def _multirotor(
    name: str,
    numbers: dict[str, VehicleNumber],
    rotors: RotorLayout | None,
    models: Sequence[IdentifiedModel],
    *,
    density_kg_m3: float,
) -> Multirotor | None:
    """The rigid body, where everything that it needs is known; what its rotors do about hover goes to the numbers."""
    curve = any(term in numbers for term in CURVE_TERMS)
    if rotors is None or not rotors.arm_known or not curve or not set(BODY) <= set(numbers):
        return None
    value = {key: number.value for key, number in numbers.items()}
    inertia = np.diag([value[key] for key in INERTIA])
    for key, (i, j) in PRODUCTS.items():
        inertia[i, j] = inertia[j, i] = value.get(key, 0.0)
    c_0, c_1, c_2 = (value.get(term, 0.0) for term in CURVE_TERMS)
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
            inertia_kg_m2=value.get("h", 0.0) / value.get("speed_max", ANY_SPEED_RAD_S),
            full_speed_rad_s=value.get("speed_max", ANY_SPEED_RAD_S) if "h" in value else 0.0,
            flow=rotor_flow(value, rotors=rotors.rotors, density_kg_m3=density_kg_m3),
        ),
        vertical_drag_n_s2_m2=value.get("d_z", 0.0),
        center_of_gravity_m=(0.0, 0.0, value.get("z_cg", 0.0)),
        source=", ".join(dict.fromkeys(map(label_of, models))),
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
                numbers[key] = combined(key, [own, other], {})
    size = np.array([value["m"]] * 3 + [value[key] for key in INERTIA])
    air = np.zeros((6, 6))
    for key, place in MOTION.items():
        # A derivative is that of rotors and body together.
        total = numbers[key].value if key in numbers else float(of_rotors[place])
        rest = total - float(of_rotors[place])
        air[place] = 0.0 if abs(rest) <= SAME * abs(total) else size[place[0]] * rest
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
            f"Mass and thrust give a hover output of {hover:.3f}; the mean in {label_of(model)} was "
            f"{motors.hover_output:.3f}. The vehicle hovers at the former."
        )
        numbers = {"hover_output": hover, "flown_output": motors.hover_output}
        found.append(remark("implausible_physics", "hover", message, **numbers))
    return found
