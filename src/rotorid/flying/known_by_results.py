r"""What results know of a vehicle: numbers with their errors, and its rotors.

Results of motors know mass, inertia, thrust and lag, those of hover the damping by speed and rate, those of rates what
is left. A quantity that several know is their mean, weighted by variances,

.. math:: \hat\theta = \frac{\sum_i \theta_i / \sigma_i^2}{\sum_i 1 / \sigma_i^2}, \qquad
    \sigma^2 = \Big( \sum_i 1/\sigma_i^2 \Big)^{-1}

if each agrees with it within three standard deviations; else the results are not of one vehicle.

Accelerations know ratios. A known mass, thrust or inertia gives the scale of all three, and the length of the arm that
of inertia in roll and pitch.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from rotorid.data.record import AXES
from rotorid.errors import UsageError
from rotorid.flying.vehicle_air import (
    AIR_UNITS,
    PLACE,
    air_factors,
    curve_correlation,
    hover_parameters,
)
from rotorid.flying.vehicle_hover import knows_hover, layout_of_hover, numbers_of_hover
from rotorid.flying.vehicle_numbers import (
    AGREEMENT_SIGMAS,
    MOTION,
    SAME,
    SCALED,
    UNITS,
    Source,
    VehicleNumber,
    label_of,
    number_words,
)
from rotorid.models.families import family_of
from rotorid.models.flight import CURVE_TERMS
from rotorid.models.motors import SCALES, TERMS_OF_CURVE, Curve
from rotorid.models.rotors import RotorLayout
from rotorid.planning.responses import answers_setpoints

if TYPE_CHECKING:
    from rotorid.results.model import IdentifiedModel
    from rotorid.results.summary import DelayBudget, MotorPhysics, ParameterEstimate

_OF_MOTORS = ("T_motor", "L_p", "M_q", "N_r", "Z_w")

_UNIT_WORDS: Mapping[str, str] = {"rad/(s m)": "1/(m s)", "rad/(m s)": "1/(m s)"}


def rotors_of(
    models: Sequence[IdentifiedModel],
    known: Mapping[str, float],
    layout: RotorLayout | None,
    usual: Mapping[str, VehicleNumber],
) -> tuple[RotorLayout | None, VehicleNumber | None]:
    """Where the rotors are, and the length of the arm."""
    layouts = [(model, own) for model in models if (own := layout_of_result(model)) is not None]
    for model, other in layouts[1:]:
        first = layouts[0][1]
        if not np.array_equal(first.spins, other.spins) or not np.allclose(
            first.positions / first.arm, other.positions / other.arm, atol=1e-3
        ):
            raise _conflict("the places of the rotors", "", (None, label_of(layouts[0][0])), model)
    if layout is not None and layouts and layout.rotors != layouts[0][1].rotors:
        raise UsageError(
            f"{layout.name} has {layout.rotors} rotors, and {label_of(layouts[0][0])} {layouts[0][1].rotors}",
            needed="the layout that flew: the thrust of each rotor was identified separately",
        )
    sized = [(model, own) for model, own in layouts if own.arm_known]
    found = layout or (sized[0][1] if sized else layouts[0][1] if layouts else None)
    if found is None:
        return None, None
    if "arm" in known:
        return found.scaled(known["arm"]), None
    if not layouts and (arms := [(model, model.parameters["l"].value) for model in models if knows_hover(model)]):
        # Results without their rotors know the arm all the same.
        (model, arm_m), *_ = arms
        return found.scaled(arm_m), VehicleNumber(value=arm_m, unit="m", source="given", of=label_of(model))
    if sized and not found.arm_known:
        found = found.scaled(sized[0][1].arm)
    if found.arm_known:
        for model, item in sized:
            if not math.isclose(item.arm, found.arm, rel_tol=1e-3):
                raise _conflict("arm", "arm", (sized[0][1].arm, label_of(sized[0][0])), model, item.arm)
        of = label_of(sized[0][0]) if sized else found.source or found.name
        return found, VehicleNumber(value=found.arm, unit="m", source="given", of=of)
    if "arm" in usual:
        return found.scaled(usual["arm"].value), usual["arm"]
    return found, None


def layout_of_result(model: IdentifiedModel) -> RotorLayout | None:
    """The rotors that a result has; ``None`` where it has none."""
    motors = model.motors
    if motors is None:
        return layout_of_hover(model) if knows_hover(model) else None
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
        f"{first[1]} and {label_of(other)} contradict each other in {what}{values}",
        needed="results of one vehicle, within three standard deviations of each other",
        remedy=f"leave one out, or decide with --set {option}=NUMBER" if option else "leave one out",
    )


Estimates: TypeAlias = dict[str, list[VehicleNumber]]


def joined_numbers(
    models: Sequence[IdentifiedModel], flown: Sequence[IdentifiedModel], known: Mapping[str, float]
) -> dict[str, VehicleNumber]:
    """All numbers of the results, joined."""
    scaled = [model for model in flown if model.motors is not None and model.motors.scale is not None]
    others = [model for model in flown if model not in scaled]
    parts = [_of_motors(model, known, None) for model in scaled]
    masses = [part["m"] for part in parts if "m" in part]
    mass = combined("m", masses, known) if masses else None
    parts += [_of_motors(model, known, mass) for model in others]
    ordered = [*scaled, *others]
    numbers = _thrust(ordered, parts, known)
    for name in dict.fromkeys(key for part in parts for key in part if key not in CURVE_TERMS):
        numbers[name] = combined(name, [part[name] for part in parts if name in part], known)
    for name, number in _of_hover(models, numbers, known).items():
        numbers[name] = combined(name, [*([numbers[name]] if name in numbers else []), number], known)
    families = [(model, family_of(model.structure)) for model in models if model.motors is None]
    linear = [(model, family.of_rates) for model, family in families if family.needs != "motor speeds"]
    # Lags from measured speeds are those of the motors themselves: no sensor or mixer stands between.
    own = [model for model, family in families if family.needs == "motor speeds" and "T_motor" not in known]
    measured = [_of_speeds(model) for model in own]
    for name in dict.fromkeys(key for part in measured for key in part):
        numbers[name] = combined(name, [part[name] for part in measured if name in part], known)
    airframes = [model for model, of_rates in linear if not of_rates]
    rates = [model for model, of_rates in linear if of_rates]
    hover: Estimates = {}
    for model in airframes:
        for name, number in _of_airframe(model).items():
            hover.setdefault(name, []).append(number)
    for name, found in hover.items():
        # A lag from commands holds the mixer's straightening too: that of the motors counts.
        if name in MOTION or name not in numbers:
            numbers[name] = combined(name, [*([numbers[name]] if name in numbers else []), *found], known)
    left: Estimates = {}
    for model in rates:
        for name, number in _of_airframe(model).items():
            if name not in numbers:
                left.setdefault(name, []).append(number)
    return numbers | {name: combined(name, found, known) for name, found in left.items()}


def _of_hover(
    models: Sequence[IdentifiedModel], numbers: Mapping[str, VehicleNumber], known: Mapping[str, float]
) -> dict[str, VehicleNumber]:
    """Numbers of results of ``physical.hover``; a curve of thrust, torque and momentum of motors are known better."""
    found: Estimates = {}
    for model in models:
        if knows_hover(model):
            for name, number in numbers_of_hover(model, known).items():
                found.setdefault(name, []).append(number)
    left_out = {"arm"}
    if any(term in numbers for term in CURVE_TERMS):
        left_out |= {*CURVE_TERMS, "speed_max"}
    if any(name in numbers for name in ("kappa", "I_zz", "kappa_per_I_zz")):
        left_out |= {"kappa", "I_zz", "kappa_per_I_zz"}
    if any(name in numbers for name in ("h", "h_per_I_zz")):
        left_out |= {"h"}
    if any(name in numbers for name in ("disc_area",)):
        left_out |= {"disc_area"}
    alone = {name: parts[:1] if name in (*CURVE_TERMS, "speed_max") else parts for name, parts in found.items()}
    return {name: combined(name, parts, known) for name, parts in alone.items() if name not in left_out}


def number_of_estimate(name: str, found: ParameterEstimate, of: str, factor: float = 1.0) -> VehicleNumber:
    """A parameter of a result, times a factor, as a number of a vehicle."""
    source: Source = "given" if found.status == "fixed" else "derived" if found.status == "tied" else "identified"
    std = None if found.std is None or source == "given" else abs(factor) * found.std
    return VehicleNumber(value=factor * found.value, unit=UNITS[name], source=source, std=std, of=of)


def _of_motors(
    model: IdentifiedModel, known: Mapping[str, float], mass: VehicleNumber | None
) -> dict[str, VehicleNumber]:
    """Numbers of a motor result in meters, shares of output and kilograms, where these are known."""
    motors, of = model.motors, label_of(model)
    assert motors is not None
    kept = {name: estimate for name, estimate in hover_parameters(model).items() if estimate.status != "dropped"}
    factors = _unit_factors(motors, known)
    scale = _scale(model, factors, known, mass)
    found: dict[str, VehicleNumber] = {}
    for name in (*SCALED, "kappa_per_I_zz", "kappa", "I_zz"):
        power = -1.0 if name == "kappa_per_I_zz" else 0.0 if name in ("kappa", "I_zz") else 1.0
        known_factor = name in kept and name in factors and (scale is not None or power == 0.0)
        # Of kappa and I_zz only the one that was held is a measurement, the other follows below.
        if known_factor and (power != 0.0 or kept[name].status == "fixed"):
            found[name] = number_of_estimate(name, kept[name], of, factors[name] * (scale or 1.0) ** power)
    neither_held = {kept[name].status for name in ("kappa", "I_zz") if name in kept} == {"free"}
    if model.flight is not None and neither_held and scale is not None and "I_xx" in factors:
        # The result assumes a flat vehicle.
        flat = number_of_estimate("I_zz", kept["I_zz"], of, factors["I_xx"] * scale)
        found["I_zz"] = replace(flat, source="default", of="a flat vehicle, as nobody gave I_zz")
    found |= {name: number_of_estimate(name, kept[name], of) for name in _OF_MOTORS if name in kept}
    if "h_per_I_zz" in kept and "h_per_I_zz" in factors:
        found["h_per_I_zz"] = number_of_estimate("h_per_I_zz", kept["h_per_I_zz"], of, factors["h_per_I_zz"])
    found |= _of_air(model, factors, scale)
    delay = next((name for name in ("tau_gyro", "tau_accel") if name in kept), None)
    if delay is not None:
        found["delay"] = number_of_estimate("delay", kept[delay], of)
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
    of = label_of(model)
    of_air = air_factors(model, full=factors.get("c_1"), scale=scale, length=factors.get("I_xx", 1.0))
    found = {
        name: number_of_estimate(name, kept[name], of, of_air[name])
        for name in AIR_UNITS
        if name in kept and name in of_air
    }
    found |= {name: number_of_estimate(name, kept[name], of) for name in (*PLACE, "z_cg") if name in kept}
    if "J_r" in kept and "J_r" in of_air:
        found["h"] = number_of_estimate("h", kept["J_r"], of, of_air["J_r"])
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
    if not flown or set(CURVE_TERMS) <= set(known):
        return {}
    first, part = flown[0]
    assert first.motors is not None
    terms = _terms(first, first.motors)
    for model, _ in flown[1:]:
        assert model.motors is not None
        if model.motors.curve != first.motors.curve:
            raise _conflict("the curve of thrust", "", (first.motors.curve, label_of(first)), model)
    absent = {
        name: VehicleNumber(value=0.0, unit="N", source="derived", of=f"a {first.motors.curve} curve")
        for name in CURVE_TERMS
        if name not in terms
    }
    if len(flown) == 1:
        return {name: part[name] for name in terms} | absent
    volts = first.motors.reference_v
    alike = [_at_voltage(numbers, volts) for _, numbers in flown]
    return _joint_curve(flown, alike, terms, known) | absent


def _terms(model: IdentifiedModel, motors: MotorPhysics) -> tuple[str, ...]:
    """Coefficients of the curve of a result; the physics of flight has those that its flights show."""
    return (
        TERMS_OF_CURVE[_curve(motors)]
        if model.flight is None
        else tuple(n for n in CURVE_TERMS if n in model.parameters)
    )


def _curve(motors: MotorPhysics) -> Curve:
    return motors.curve if motors.curve in TERMS_OF_CURVE else "polynomial"  # type: ignore[return-value]


def _at_voltage(part: Mapping[str, VehicleNumber], volts: float | None) -> dict[str, VehicleNumber]:
    """The curve at another voltage, with the square of which thrust grows."""
    own = part.get("reference_v")
    factor = 1.0 if own is None or volts is None else (volts / own.value) ** 2
    return {
        name: replace(number, value=factor * number.value, std=None if number.std is None else factor * number.std)
        for name, number in part.items()
        if name in CURVE_TERMS
    }


def _joint_curve(
    flown: Sequence[tuple[IdentifiedModel, Mapping[str, VehicleNumber]]],
    alike: Sequence[Mapping[str, VehicleNumber]],
    terms: Sequence[str],
    known: Mapping[str, float],
) -> dict[str, VehicleNumber]:
    separate = {name: combined(name, [numbers[name] for numbers in alike], known) for name in terms}
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
    of = label_of(model)
    found = {
        name: number_of_estimate(name, estimate, of)
        for name, estimate in model.parameters.items()
        if name in MOTION
        and estimate.status != "dropped"
        and _UNIT_WORDS.get(estimate.unit, estimate.unit) == UNITS[name]
    }
    height = model.parameters.get("z_imu")
    if height is not None and height.status != "dropped":
        # Up in these models, down in a vehicle.
        found["z_imu"] = number_of_estimate("z_imu", height, of, -1.0)
    elif above_m := model.structure.constants.get("z_imu"):
        found["z_imu"] = VehicleNumber(value=-above_m, unit="m", source="given", of=of)
    lag = model.parameters.get("T_motor")
    if lag is not None and lag.status != "dropped":
        found["T_motor"] = number_of_estimate("T_motor", lag, of)
    late = [pair for pair, budget in model.delays.items() if budget.total_s > 0.0]
    # Behind a set-point the delay is one of the whole loop, and with it in front of the motors that loop would tumble.
    if late and not answers_setpoints(model.structure):
        of_axes = {f"delay_{axis}": _delay_of(model, f"{axis}_command", of) for axis in AXES}
        found |= {name: number for name, number in of_axes.items() if number is not None}
        found["delay"] = _own_delay(model.delays[late[0]], _delay_std(model, late[0]), of)
    return found


def _delay_of(model: IdentifiedModel, command: str, of: str) -> VehicleNumber | None:
    """Delay of a command to the first output that answers it."""
    pair = next((pair for pair in model.delays if pair.partition("/")[2] == command), None)
    if pair is None:
        return None
    return _own_delay(model.delays[pair], _delay_std(model, pair), of)


def _own_delay(budget: DelayBudget, std: float | None, of: str) -> VehicleNumber:
    own_s = max(budget.input_delay_s + budget.output_delay_s - (budget.known_filters_s or 0.0), 0.0)
    return VehicleNumber(value=own_s, unit="s", source="derived", std=std, of=of)


def _of_speeds(model: IdentifiedModel) -> dict[str, VehicleNumber]:
    """Lags of the motors from their speeds: up, down, and the mean for what knows one lag only."""
    of, estimates = label_of(model), model.parameters
    found = {name: number_of_estimate(name, estimates[name], of) for name in ("T_motor_up", "T_motor_down")}
    up, down = found.values()
    std = None if up.std is None or down.std is None else 0.5 * math.hypot(up.std, down.std)
    mean = VehicleNumber(value=0.5 * (up.value + down.value), unit="s", source="derived", std=std, of=of)
    return {**found, "T_motor": mean}


def dropped_numbers(
    models: Sequence[IdentifiedModel], numbers: Mapping[str, VehicleNumber]
) -> dict[str, VehicleNumber]:
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
            of = f"dropped from {label_of(model)}"
            found[name] = VehicleNumber(value=step.value_before, unit=UNITS[name], source="identified", std=std, of=of)
    return found


def _delay_std(model: IdentifiedModel, pair: str) -> float | None:
    """Of the delay of a response, by its own parameters: with a lag their sum is known better."""
    output, _, command = pair.partition("/")
    of = model.structure
    entries = of.input_delays[of.inputs.index(command)], of.output_delays[of.outputs.index(output)]
    names = {name for entry in entries for name in entry.names}
    stds = [estimate.std for name, estimate in model.parameters.items() if name in names and estimate.std]
    return math.hypot(*stds) if stds else model.delays[pair].total_std_s


def combined(name: str, found: Sequence[VehicleNumber], known: Mapping[str, float]) -> VehicleNumber:
    """One number from several, weighted by their variances; one that is certain counts alone.

    Raises
    ------
    UsageError
        They contradict each other, and nothing was given.
    """
    if len(found) == 1 or name in known:
        return found[0]
    if name.startswith("delay"):
        # Each log and each filter adds its own: what is not in all of them is not the vehicle's.
        return min(found, key=lambda number: number.value)
    if name == "reference_v":
        return found[0]
    if name == "z_imu":
        # Each axis has its own estimate of it, some of little worth: nothing else follows from it.
        return min(found, key=lambda number: math.inf if number.std is None else number.std)
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
            reach = max(AGREEMENT_SIGMAS * math.hypot(number.std or 0.0, other.std or 0.0), SAME * abs(other.value))
            if abs(number.value - other.value) > reach:
                raise UsageError(
                    f"{number.of} and {other.of} contradict each other in {name}: "
                    f"{number_words(number)} and {number_words(other)}",
                    needed="results of one vehicle, within three standard deviations of each other",
                    remedy=f"leave one out, or decide with --set {name}=NUMBER",
                )
    return best
