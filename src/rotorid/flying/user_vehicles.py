"""A user's vehicle that flies: identified numbers, with autopilot and sensors of a similar library vehicle.

Missing numbers are taken from that vehicle, with a remark. Gains are those of the log where its autopilot is of
the same kind. Thrust at hover, the shape of the mixer and the place of each rotor follow from the results.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.autopilots.registry import named
from rotorid.autopilots.thrust import Linearization
from rotorid.data.base import Immutable
from rotorid.data.record import AXES
from rotorid.errors import UsageError
from rotorid.fitting.flight.fit import FlightRange
from rotorid.flights.controllers import controllers_of_result
from rotorid.flying.known_by_results import layout_of_result
from rotorid.flying.vehicle_air import PLACE
from rotorid.flying.vehicle_answers import ANSWERS, answer_remarks, answering, delays_of
from rotorid.flying.vehicle_from_results import JoinedVehicle, joined_vehicle, require
from rotorid.flying.vehicle_hover import curve_through, knows_hover
from rotorid.flying.vehicle_numbers import MOTION, UNITS, VehicleNumber
from rotorid.models.flight import CURVE_TERMS
from rotorid.models.rotors import RotorLayout, named_by
from rotorid.results.model import IdentifiedModel
from rotorid.simulation.autopilot import Autopilot, Three
from rotorid.simulation.linearization import hover_derivatives_of, hover_slopes
from rotorid.simulation.multirotor import Multirotor, Sensors
from rotorid.simulation.multirotor_flight import Aircraft, changed
from rotorid.typing import Axis
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.vehicles.catalog import aircraft
from rotorid.vehicles.px4 import rotor_parameters, with_gains


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnVehicle(Immutable):
    """A vehicle that was joined from results, and what flies.

    Parameters
    ----------
    joined
        Its numbers with their sources.
    aircraft
        Body, autopilot, sensors.
    like
        Name of the vehicle that gave the rest.
    taken
        What was taken from it, in words.
    answers
        Axes whose answer to a command is that of the results.
    whole
        Whether results know all of the body, so that autopilot and sensors alone are of another vehicle.
    """

    joined: JoinedVehicle
    aircraft: Aircraft
    like: str
    taken: tuple[str, ...]
    answers: tuple[Axis, ...] = ()
    whole: bool = False

    @property
    def tested(self) -> FlightRange | None:
        """Range that all results were identified on, rotors by shares of full speed; ``None`` where none says so."""
        spans = []
        for model in self.joined.models:
            flight, motors = model.flight, model.motors
            if flight is None or motors is None:
                continue
            full = self.joined.numbers["speed_max"].value if motors.outputs == "speed" else 1.0
            own = flight.limits
            low, high = own.motors
            spans.append((own.edge_m_s, own.climb_m_s, (low / full, high / full), own.load))
        if not spans:
            return None
        widest = [(min(span[0] for span in each), max(span[1] for span in each)) for each in zip(*spans, strict=True)]
        return FlightRange(*widest)

    @property
    def has_motors(self) -> bool:
        """Whether thrust and hover are those of the results, and not of the other vehicle."""
        return any(model.motors is not None or knows_hover(model) for model in self.joined.models)

    @property
    def has_thrust_slope(self) -> bool:
        """Whether thrust is known by its slope alone, from what a command of it makes, and hover is assumed."""
        numbers = self.joined.numbers
        return not self.has_motors and any(numbers[term].source == "derived" for term in CURVE_TERMS if term in numbers)


def numbers_of(craft: Aircraft) -> dict[str, VehicleNumber]:
    """The numbers of a vehicle by the names of :data:`rotorid.flying.vehicle_numbers.UNITS`.

    Examples
    --------
    >>> from rotorid.vehicles import aircraft
    >>> numbers = numbers_of(aircraft("px4_quad"))
    >>> numbers["X_u"].value, numbers["kappa"].value, numbers["m"].of
    (-1.0, 0.02, 'px4_quad')
    """
    vehicle, rotors = craft.vehicle, craft.vehicle.rotors
    moments = vehicle.inertia_kg_m2.diagonal()
    slopes = hover_slopes(vehicle)
    lag_down_s = rotors.lag_down_s or 0.0
    values = {"m": vehicle.mass_kg, **dict(zip(("I_xx", "I_yy", "I_zz"), moments.tolist(), strict=True))}
    values |= dict(zip(("c_0", "c_1", "c_2"), rotors.thrust, strict=True))
    values |= {"T_motor": 0.5 * (rotors.lag_up_s + lag_down_s), "arm": rotors.layout.arm}
    values |= {name: float(slopes[place]) for name, place in MOTION.items()}
    share = rotors.share_of(vehicle.mass_kg * STANDARD_GRAVITY_M_S2 / rotors.layout.rotors)
    torque = float(np.polynomial.polynomial.polyval(share, rotors.torque_curve))
    if torque > 0.0:
        values["kappa"] = torque / rotors.thrust_at(share)
    elif vehicle.effectiveness is not None:
        values["kappa"] = float(np.abs(vehicle.effectiveness[5]).mean())
    if rotors.inertia_kg_m2:
        values["h"] = rotors.inertia_kg_m2 * rotors.full_speed_rad_s
    values["delay"] = float(np.mean(craft.autopilot.delay_s))
    return {
        name: VehicleNumber(value=float(value), unit=UNITS[name], source="default", of=craft.name)
        for name, value in values.items()
    }


def own_vehicle(
    models: Sequence[IdentifiedModel],
    *,
    like: Aircraft | None,
    given: Mapping[str, float] | None = None,
    name: str = "vehicle",
    layout: RotorLayout | None = None,
) -> OwnVehicle:
    """A vehicle that flies, from results.

    Parameters
    ----------
    models
        Results of one vehicle.
    like
        A vehicle whose autopilot and sensors it has, and whose numbers fill in what the results do not hold. Without
        one the results have to know the body; gains are those of the log, or are derived.
    given
        Numbers that were measured otherwise; see :func:`rotorid.flying.vehicle_from_results.joined_vehicle`.
    name
        What the vehicle is called.
    layout
        Rotors, where results do not have them; by default those of the other vehicle.

    Raises
    ------
    UsageError
        No vehicle was named for what results do not hold, or they contradict each other.
    """
    if like is None:
        return _alone(joined_vehicle(models, given=given, name=name, layout=layout))
    usual = numbers_of(like)
    flown = [model.motors for model in models if model.motors is not None]
    of_speeds = any(physics.outputs == "speed" for physics in flown)
    delayed = flown or any(_identified(model, name) for model in models for name in _DELAYS)
    if delayed and not of_speeds and not any(_identified(model, "T_motor") for model in models):
        # The delay that was identified stands for the lag too.
        del usual["T_motor"]
    # Its arm is one of the usual numbers.
    known = any(layout_of_result(model) is not None for model in models)
    taken_rotors = layout is None and not known
    layout = replace(like.vehicle.rotors.layout, arm_known=False) if taken_rotors else layout

    def made(others: Mapping[str, VehicleNumber]) -> JoinedVehicle:
        return joined_vehicle(models, given=given, name=name, usual={**usual, **others}, layout=layout)

    def craft_of(joined: JoinedVehicle) -> Aircraft:
        body = require(joined, target="simulation")
        autopilot = _autopilot(joined, body, like)[0]
        return Aircraft(vehicle=body, autopilot=autopilot, sensors=_sensors(joined, like.sensors))

    joined = made(answering(made, craft_of, models, usual))
    craft = craft_of(joined)
    joined = replace(joined, findings=(*joined.findings, *answer_remarks(craft, models)))
    _, taken = _autopilot(joined, craft.vehicle, like)
    if taken_rotors:
        taken = ["the places of the rotors", *taken]
    words = [
        f"{key} = {number.value:.4g} {number.unit}"
        for key, number in joined.numbers.items()
        if number.source == "default" and (number.value != 0.0 or key == "T_motor")
    ]
    return OwnVehicle(
        joined=joined,
        aircraft=craft,
        like=like.name,
        taken=(*words, *taken, *_sensor_words(joined, like.sensors)),
        answers=tuple(axis for axis, (moment, _) in ANSWERS.items() if joined.numbers[moment].source != "default"),
    )


def _alone(joined: JoinedVehicle) -> OwnVehicle:
    """A vehicle all of whose body results know, with the autopilot that flew, or one with gains that follow from it.

    Raises
    ------
    UsageError
        Results do not know the body.
    """
    if joined.multirotor is None:
        absent = [key for key in ("m", "arm", "kappa", *MOTION) if key not in joined.numbers]
        others = f", nor {', '.join(absent)}" if absent else ""
        raise UsageError(
            f"autopilot and sensors of {joined.name} are unknown{others}",
            remedy="take those of a similar vehicle, such as --like px4_quad (rotorid vehicles lists them)",
        )
    body, like = joined.multirotor, _flew(joined)
    autopilot, taken = _autopilot(joined, body, like)
    if autopilot.kind == like.autopilot.kind == "simple" and autopilot.mixer is like.autopilot.mixer:
        autopilot = replace(autopilot, mixer=None)
    if _GAINS in taken:
        autopilot = _with_derived_gains(autopilot, body, like)
        taken = [words for words in taken if words != _GAINS]
        taken.append(f"gains of {like.name}, for the answer and the lag of this vehicle")
    craft = Aircraft(vehicle=body, autopilot=autopilot, sensors=_sensors(joined, like.sensors))
    joined = replace(joined, findings=(*joined.findings, *answer_remarks(craft, joined.models)))
    still = [key for key in MOTION if key not in joined.numbers]
    taken = [*taken, *_sensor_words(joined, like.sensors), *([f"no {', '.join(still)}"] if still else [])]
    return OwnVehicle(
        joined=joined,
        aircraft=craft,
        like=like.name,
        taken=tuple(taken),
        answers=tuple(ANSWERS),
        whole=True,
    )


def _flew(joined: JoinedVehicle) -> Aircraft:
    """The vehicle of the library with the autopilot of the log; a plain one where gains of that are not known."""
    flew = joined.controller
    kind = named("" if flew is None else flew.autopilot)
    gains = controllers_of_result(flew).parameters if flew is not None else {}
    return aircraft(kind.vehicle if kind.takes_gains and kind.gain in gains else _PLAIN)


_PLAIN = "hummingbird"
"""Its autopilot is that of no firmware."""


def _with_derived_gains(own: Autopilot, body: Multirotor, like: Aircraft) -> Autopilot:
    r"""Loops as fast as those of another vehicle, or slower where lag and delay :math:`T` are longer.

    With the acceleration by a command :math:`A` and :math:`s = \min(1, T'/T)`,

    .. math:: P = s \frac{A'}{A} P', \qquad I = s^2 \frac{A'}{A} I', \qquad D = \frac{A'}{A} D'

    and loops of angle, speed and place are s times as fast.
    """
    mine, other = hover_derivatives_of(body, own), hover_derivatives_of(like.vehicle, like.autopilot)
    power = [other[control] / mine[control] for _, control in ANSWERS.values()]
    lags_s = [
        np.array(pilot.delay_s) + max(vehicle.rotors.lag_up_s, vehicle.rotors.lag_down_s or 0.0)
        for vehicle, pilot in ((body, own), (like.vehicle, like.autopilot))
    ]
    slow = np.minimum(1.0, lags_s[1] / np.maximum(lags_s[0], 1e-6)).tolist()
    tilt = min(slow[:2])
    rates, guidance = own.rates, own.guidance

    def scaled(gains: Three, by: int, slower: int) -> Three:
        roll, pitch, yaw = (s**slower * a**by * gain for s, a, gain in zip(slow, power, gains, strict=False))
        return roll, pitch, yaw

    return replace(
        own,
        rates=replace(
            rates,
            proportional=scaled(rates.proportional, 1, 1),
            integral=scaled(rates.integral, 1, 2),
            derivative=scaled(rates.derivative, 1, 0),
        ),
        angle_1_s=scaled(own.angle_1_s, 0, 1),
        guidance=replace(
            guidance,
            velocity_p_1_s=tilt * guidance.velocity_p_1_s,
            velocity_i_1_s2=tilt**2 * guidance.velocity_i_1_s2,
            position_p_1_s=tilt * guidance.position_p_1_s,
            climb_p=slow[3] * guidance.climb_p,
            climb_i=slow[3] ** 2 * guidance.climb_i,
            height_p_1_s=slow[3] * guidance.height_p_1_s,
        ),
    )


def _sensors(joined: JoinedVehicle, usual: Sensors) -> Sensors:
    """Those of another vehicle, with the accelerometer where results have it."""
    places = zip(PLACE, usual.accelerometer_place_m, strict=True)
    x, y, z = (joined.numbers[name].value if name in joined.numbers else other for name, other in places)
    return replace(usual, accelerometer_place_m=(x, y, z))


def _sensor_words(joined: JoinedVehicle, usual: Sensors) -> list[str]:
    """What of the sensors is that of another vehicle."""
    places = zip(PLACE, usual.accelerometer_place_m, strict=True)
    placed = any(place_m and name not in joined.numbers for name, place_m in places)
    return ["noise of the sensors", *(["the place of the accelerometer"] if placed else [])]


def _identified(model: IdentifiedModel, name: str) -> bool:
    """Whether a model has a parameter: of a dropped one nothing but zero is left."""
    return name in model.parameters and model.parameters[name].value != 0.0


_DELAYS = ("tau_roll", "tau_pitch", "tau_yaw", "tau_thrust", "tau")


_GAINS = "gains and filters"


def _autopilot(joined: JoinedVehicle, body: Multirotor, like: Aircraft) -> tuple[Autopilot, list[str]]:
    """The autopilot of a library vehicle adapted to this one, and which parts are not this one's."""
    own, taken = like.autopilot, [f"the autopilot, {like.autopilot.kind} at {like.autopilot.rate_hz:g} Hz"]
    flew = joined.controller
    gains = controllers_of_result(flew).parameters if flew is not None else {}
    flies = named(own.kind)
    if flies.takes_gains and flies.gain in gains:
        own = with_gains(like, gains, source="the log").autopilot
    else:
        taken.append(_GAINS)
    delays_s, assumed = delays_of(joined, replace(like, vehicle=body, autopilot=own))
    own, taken = replace(own, delay_s=delays_s), [*taken, *assumed]
    known = [model.motors for model in joined.models if model.motors is not None]
    if any(physics.outputs == "thrust_demand" and physics.straightening is not None for physics in known):
        taken.append("no curve from demand to output: the logs knew demands of thrust, and outputs here are these")
    same_rotors = like.vehicle.rotors.layout.rotors == body.rotors.layout.rotors
    mixers = [model.rotors.mixer for model in joined.models if model.rotors is not None]
    if own.kind == "simple" and mixers and len(mixers[0]) == body.rotors.layout.rotors:
        own = replace(own, mixer=np.array(mixers[0]))
    elif own.kind != "simple" or not same_rotors:
        own = replace(own, mixer=None)
    line = _linearization(joined, own)
    own = replace(own, linearization=line, parameters={**own.parameters, **_logged(own, body.rotors.layout, line)})
    return _hovering(own, body, like), taken


def _linearization(joined: JoinedVehicle, own: Autopilot) -> Linearization:
    """What turns demands into outputs: of a thrust by demand nothing does, for its curve is in the thrust."""
    motors = next((model.motors for model in joined.models if model.motors is not None), None)
    if motors is None:
        return own.linearization
    if motors.outputs != "output":
        return Linearization()
    known = motors.straightening
    if known is None:
        return own.linearization if named(own.kind).log.straightened else Linearization()
    return Linearization(expo=known.expo, low=known.low, high=known.high)


def _logged(own: Autopilot, layout: RotorLayout, line: Linearization) -> dict[str, float]:
    """Parameters of the log for rotor geometry and thrust linearization."""
    if own.kind == "px4":
        return {**rotor_parameters(layout), "THR_MDL_FAC": line.expo}
    if own.kind != "ardupilot":
        return {}
    frame = {"MOT_THST_EXPO": line.expo, "MOT_SPIN_MIN": line.low, "MOT_SPIN_MAX": line.high}
    numbers = [
        (kind, form)
        for kind in range(1, 15)
        for form in range(20)
        if named_by("ardupilot", [kind, form]) == layout.name
    ]
    return frame | ({"FRAME_CLASS": float(numbers[0][0]), "FRAME_TYPE": float(numbers[0][1])} if numbers else {})


_TURNS, _CLOSE = 20, 1e-6


def hovering_at(
    craft: Aircraft, throttle: float, *, answers: Sequence[Axis] = (), slope_known: bool = False
) -> Aircraft:
    """A vehicle whose rotors are as strong as one that hovers at a throttle.

    Parameters
    ----------
    throttle
        Thrust command in hover, from zero to one.
    answers
        Axes whose answer to a command is known and stays; others answer as much more as the rotors are stronger.
    slope_known
        Whether the slope of thrust in hover is known and stays, and with it the answers of all axes: the curve is then
        the one of :mod:`rotorid.flying.vehicle_hover` through both.

    Examples
    --------
    >>> from rotorid.vehicles import aircraft
    >>> craft = hovering_at(aircraft("px4_quad"), 0.3)
    >>> round(float(craft.autopilot.hover_commands(craft.vehicle)[-1]), 4)
    0.3
    """
    thrust, factor, found = AXES.index("thrust"), 1.0, craft
    if slope_known:
        return _hovering_with_slope(craft, throttle)
    for _ in range(_TURNS):
        hovers = float(found.autopilot.hover_commands(found.vehicle)[thrust])
        if abs(hovers / throttle - 1.0) < _CLOSE:
            break
        factor *= hovers / throttle
        found = changed(craft, {"thrust": factor})
    inertia = dict(zip(("I_xx", "I_yy", "I_zz"), craft.vehicle.inertia_kg_m2.diagonal().tolist(), strict=True))
    kept = {ANSWERS[axis][0]: factor * inertia[ANSWERS[axis][0]] for axis in answers}
    found = changed(found, kept)
    return replace(found, autopilot=_hovering(found.autopilot, found.vehicle, craft))


def _hovering_with_slope(craft: Aircraft, throttle: float) -> Aircraft:
    """A vehicle that hovers at a throttle with the slope of thrust that it has."""
    body, thrust = craft.vehicle, AXES.index("thrust")
    rotors, share, found = body.rotors, throttle, craft
    weight_n = body.mass_kg * STANDARD_GRAVITY_M_S2 / rotors.layout.rotors
    before = rotors.share_of(weight_n)
    slope_n = rotors.thrust[1] + 2.0 * before * rotors.thrust[2]
    for _ in range(_TURNS):
        other = replace(rotors, thrust=curve_through(weight_n, slope_n, share))
        found = replace(craft, vehicle=replace(body, rotors=other))
        hovers = float(found.autopilot.hover_commands(found.vehicle)[thrust])
        if abs(hovers / throttle - 1.0) < _CLOSE:
            break
        share *= throttle / hovers
    return replace(found, autopilot=_hovering(found.autopilot, found.vehicle, craft))


def _hovering(own: Autopilot, body: Multirotor, like: Aircraft) -> Autopilot:
    """Loops of height about the thrust at which this vehicle hovers."""
    thrust = AXES.index("thrust")
    hover, before = (
        float(autopilot.hover_commands(vehicle)[thrust])
        for autopilot, vehicle in ((own, body), (like.autopilot, like.vehicle))
    )
    guidance = own.guidance
    guidance = replace(guidance, climb_p=guidance.climb_p * hover / before, climb_i=guidance.climb_i * hover / before)
    name = named(own.kind).hover
    logged = {name: hover} if name in own.parameters else {}
    return replace(own, guidance=guidance, parameters={**own.parameters, **logged})
