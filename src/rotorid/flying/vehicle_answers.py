r"""How a vehicle answers commands as results say, where they know a ratio only.

A linear model of hover has accelerations by commands: of thrust over mass, :math:`Z_{thrust}`, and of moments over
inertia, :math:`L_{roll}, M_{pitch}, N_{yaw}`. One part of each ratio is assumed, from a similar vehicle or from what
somebody gave, and the other follows, so that the vehicle has the acceleration of the result:

- thrust from Z_thrust, with the mass; the shape of its curve is that of the similar vehicle
- inertia from the moment, with thrust and arm; or the arm, where the inertia was given
- yaw inertia with the torque of the rotors; the torque, where the inertia was given, or else would be that of no body

Delays of commands are known for each axis. What a log shows of them has the filters of the autopilot in it, and half a
turn of its loop for which a command is held: both are there again in a simulated log, and come off before.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from rotorid.autopilots.filters import butterworth_low_pass
from rotorid.autopilots.registry import named
from rotorid.data.findings import Finding, warn
from rotorid.data.quantity import with_error
from rotorid.data.record import AXES
from rotorid.errors import ModelError
from rotorid.flying.vehicle_hover import knows_hover
from rotorid.flying.vehicle_numbers import AGREEMENT_SIGMAS, UNITS, VehicleNumber, label_of
from rotorid.models.families import family_of
from rotorid.models.flight import CURVE_TERMS
from rotorid.planning.responses import answers_setpoints
from rotorid.simulation.autopilot import Autopilot
from rotorid.simulation.linearization import hover_derivatives_of
from rotorid.simulation.multirotor import Multirotor
from rotorid.simulation.multirotor_flight import Aircraft, changed
from rotorid.typing import Axis

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.results.model import IdentifiedModel

ANSWERS: Mapping[Axis, tuple[str, str]] = {
    "roll": ("I_xx", "L_roll"),
    "pitch": ("I_yy", "M_pitch"),
    "yaw": ("I_zz", "N_yaw"),
}
"""Axis to its moment of inertia, and to how a command accelerates it."""

THRUST = "Z_thrust"

_MOST_TURNS, _CLOSE = 60, 1e-10

_DIFFERS = 0.05
"""Relative difference of an acceleration by a command from which there is a remark."""

_LIFTS = 1.05
"""Full thrust over the weight that a vehicle needs at least."""

Made = Callable[[Mapping[str, VehicleNumber]], "JoinedVehicle"]
"""The vehicle, with these numbers in place of those of the similar one."""


def control_numbers(models: Sequence[IdentifiedModel]) -> dict[str, VehicleNumber]:
    """Accelerations by commands of roll, pitch, yaw and thrust: of several results the best known one.

    Models of the airframe come before those of a rate alone, which leave its slow motion out.
    """
    found: dict[str, list[tuple[bool, float, VehicleNumber]]] = {}
    for model in models:
        if model.motors is not None or answers_setpoints(model.structure):
            continue
        for name in (THRUST, *(control for _, control in ANSWERS.values())):
            own = model.parameters.get(name)
            if own is None or own.status == "dropped" or not (own.value < 0.0 if name == THRUST else own.value > 0.0):
                continue
            number = VehicleNumber(
                value=own.value, unit=own.unit, source="identified", std=own.std, of=f"{name} of {label_of(model)}"
            )
            of_rates = family_of(model.structure).of_rates
            found.setdefault(name, []).append((of_rates, abs((own.std or 0.0) / own.value), number))
    return {name: min(numbers, key=lambda entry: entry[:2])[2] for name, numbers in found.items()}


def answering(
    made: Made,
    craft_of: Callable[[JoinedVehicle], Aircraft],
    models: Sequence[IdentifiedModel],
    usual: Mapping[str, VehicleNumber],
) -> dict[str, VehicleNumber]:
    """Numbers that give a vehicle the accelerations by commands of its results; see the head.

    Parameters
    ----------
    made
        The vehicle with other numbers in place of usual ones.
    craft_of
        What flies, of a vehicle.
    models
        Its results. Of the physics of hover or of motors everything follows without this.
    usual
        Numbers of the similar vehicle.
    """
    known = control_numbers([model for model in models if not knows_hover(model)])
    found: dict[str, VehicleNumber] = {}
    joined = made(found)
    if THRUST in known and all(
        joined.numbers[term].source == "default" for term in CURVE_TERMS if term in joined.numbers
    ):
        found |= _thrust(joined, craft_of(joined), known[THRUST], usual["m"].of)
    for axis, (moment, control) in ANSWERS.items():
        if control not in known:
            continue
        joined = made(found)
        now = hover_derivatives_of(*_flown(craft_of(joined)))[control]
        if now > 0.0:
            found |= _moment(axis, moment, joined, known[control], now / known[control].value, usual)
    return found


def _flown(craft: Aircraft) -> tuple[Multirotor, Autopilot]:
    return craft.vehicle, craft.autopilot


def _thrust(joined: JoinedVehicle, craft: Aircraft, wanted: VehicleNumber, like: str) -> dict[str, VehicleNumber]:
    """The curve of thrust of the similar vehicle, stronger or weaker; none that does not lift the vehicle."""
    factor = 1.0
    try:
        for _ in range(_MOST_TURNS):
            body, autopilot = _flown(changed(craft, {"thrust": factor}))
            ratio = wanted.value / hover_derivatives_of(body, autopilot)[THRUST]
            if abs(ratio - 1.0) < _CLOSE:
                break
            factor *= ratio
    except ModelError:
        return {}
    rotors = craft.vehicle.rotors
    if factor * sum(rotors.thrust) < _LIFTS * joined.hover_force_n:
        return {}
    of = f"{wanted.of}, with {' and '.join(filter(None, (_of('m', joined), f'the curve of {like}')))}"
    # Thrust grows with at most the square of Z_thrust, that of rotors whose speed goes with the output.
    share = 2.0 * abs((wanted.std or 0.0) / wanted.value)
    return {
        term: VehicleNumber(
            value=factor * value, unit=UNITS[term], source="derived", std=share * abs(factor * value) or None, of=of
        )
        for term, value in zip(CURVE_TERMS, rotors.thrust, strict=True)
    }


def _of(name: str, joined: JoinedVehicle) -> str:
    """Where an assumed number comes from; empty where results know it."""
    number = joined.numbers[name]
    return "" if number.source in ("identified", "derived") else f"{name} of {number.of}"


def _moment(
    axis: Axis,
    moment: str,
    joined: JoinedVehicle,
    wanted: VehicleNumber,
    ratio: float,
    usual: Mapping[str, VehicleNumber],
) -> dict[str, VehicleNumber]:
    """The number that makes the ratio of moment and inertia that of the result, which is smaller by a ratio."""
    numbers, like = joined.numbers, usual["m"].of
    lever = "kappa" if axis == "yaw" else "arm"
    known_thrust = any(numbers[term].source != "default" for term in CURVE_TERMS if term in numbers)
    thrust = [] if known_thrust else [f"thrust of {like}"]
    share = abs((wanted.std or 0.0) / wanted.value)

    def number(name: str, value: float, *parts: str, more: Sequence[str] = ()) -> dict[str, VehicleNumber]:
        assumed = [*thrust, *(words for part in parts if (words := _of(part, joined))), *more]
        of = f"{wanted.of}, with {' and '.join(assumed)}" if assumed else wanted.of
        return {name: VehicleNumber(value=value, unit=UNITS[name], source="derived", std=share * value or None, of=of)}

    inertia = numbers[moment]
    if inertia.source == "default":
        value = ratio * inertia.value
        if axis != "yaw" or _is_body(numbers, value):
            return number(moment, value, lever)
        if numbers[lever].source != "default":
            return {}
        # The usual torque asks for a yaw inertia that no body has: the usual shape of the body is the better guess.
        before = inertia.value
        shape = usual["I_zz"].value / (usual["I_xx"].value + usual["I_yy"].value)
        value = shape * (numbers["I_xx"].value + numbers["I_yy"].value)
        words = f"{numbers['I_xx'].of}; in proportion to I_xx + I_yy, as of {like}"
        own = VehicleNumber(value=value, unit=UNITS[moment], source="derived", of=words)
        return {moment: own, **number(lever, numbers[lever].value * value / (ratio * before), more=["that I_zz"])}
    if inertia.source == "given" and numbers[lever].source == "default":
        return number(lever, numbers[lever].value / ratio, moment)
    return {}


def _is_body(numbers: Mapping[str, VehicleNumber], yaw: float) -> bool:
    roll, pitch = numbers["I_xx"].value, numbers["I_yy"].value
    return abs(roll - pitch) <= yaw <= roll + pitch


def answer_remarks(craft: Aircraft, models: Sequence[IdentifiedModel]) -> list[Finding]:
    """Accelerations by commands that are not those of the results: numbers that were given contradict them."""
    known = control_numbers(models)
    if not known:
        return []
    built = hover_derivatives_of(*_flown(craft))
    remarks = []
    for name, number in known.items():
        reach = max(AGREEMENT_SIGMAS * (number.std or 0.0), _DIFFERS * abs(number.value))
        if abs(built[name] - number.value) <= reach:
            continue
        message = (
            f"{name} of the vehicle is {built[name]:.4g} {number.unit}, and {with_error(number.value, number.std)} in "
            f"the result: its commands, or a given number, are not those of the flight."
        )
        remarks.append(warn("implausible_physics", name, message, vehicle=built[name], flown=number.value))
    return remarks


def delays_of(joined: JoinedVehicle, craft: Aircraft) -> tuple[tuple[float, float, float, float], list[str]]:
    """Delays of the commands of roll, pitch, yaw and thrust, and which of them are assumed, in words.

    Given ones come first, then those of results for the axis, then that of another axis, then usual ones.
    """
    numbers, hold_s = joined.numbers, 0.5 / craft.autopilot.rate_hz
    whole = numbers.get("delay")
    known = {axis: number for axis in AXES if (number := numbers.get(f"delay_{axis}")) is not None}
    path = {
        axis: number.value - hold_s - (0.0 if filters_known(joined.models, axis) else logged_late_s(craft, axis))
        for axis, number in known.items()
        if number.source != "given"
    }
    each, assumed = [], []
    for place, axis in enumerate(AXES):
        if axis in known and axis not in path:
            each.append(known[axis].value)
        elif whole is not None and whole.source == "given":
            each.append(whole.value)
        elif axis in path:
            each.append(path[axis])
        elif path:
            other, late_s = next(iter(path.items()))
            each.append(late_s)
            assumed.append(f"delay of {axis}: that of {other}")
        elif whole is not None and whole.source != "default":
            each.append(whole.value)
        else:
            each.append(craft.autopilot.delay_s[place])
    roll, pitch, yaw, thrust = (max(delay_s, 0.0) for delay_s in each)
    return (roll, pitch, yaw, thrust), assumed


def filters_known(models: Sequence[IdentifiedModel], axis: str) -> bool:
    """Whether the delays of an axis are those without the filters of the log."""
    budgets = (budget for model in models for pair, budget in model.delays.items() if pair.endswith(f"/{axis}_command"))
    return any(budget.known_filters_s for budget in budgets)


def logged_late_s(craft: Aircraft, axis: str) -> float:
    """How late the log shows the motion of an axis: the autopilot's filters, or the mean over a turn of its loop."""
    autopilot = craft.autopilot
    if named(autopilot.kind).adds_sweeps:
        # The force of rotors without lag does not change in a turn, so that its mean is not late.
        even = axis == "thrust" and not craft.vehicle.rotors.lag_up_s
        return 0.0 if even else 0.5 / autopilot.rate_hz
    cutoff_hz = autopilot.accelerometer_cutoff_hz if axis == "thrust" else autopilot.gyro_cutoff_hz
    lag_s = craft.sensors.accelerometer_lag_s if axis == "thrust" else craft.sensors.gyro_lag_s
    return lag_s + (butterworth_low_pass(cutoff_hz, autopilot.rate_hz).delay_s if cutoff_hz > 0.0 else 0.0)
