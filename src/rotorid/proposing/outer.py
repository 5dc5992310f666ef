r"""Outer loops around the loops that are tuned: their controllers by the log, and their plants.

The horizontal velocity answers the acceleration that its controller asks for through the attitude loop, which is closed
with the gains that will fly:

.. math:: P_v(j\omega) = \frac{T(j\omega)}{j\omega - Y_v}, \qquad T = \frac{\hat P C_r A / s}{1 + L_{whole}}

with the drag :math:`-Y_v` over mass. So new gains of roll and pitch are judged in the velocity loop too. Every draw of
the attitude loop is one of the velocity loop. Roll and pitch fly the same velocity gains, so the draws of both count.

Each outer loop is registered in :data:`PLANTS`, by what gives its plant; its names are in
:mod:`rotorid.models.autopilots.outer`, the shapes of its gains in :mod:`rotorid.tuning.kinds`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from rotorid.autopilots.filters import KnownFilter
from rotorid.data.base import Immutable
from rotorid.data.display import listed
from rotorid.data.findings import Finding, refusal, remark
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.tilt_drag import TiltDrag, tilt_drag_of
from rotorid.models.autopilots.climb import acceleration_gains
from rotorid.models.autopilots.outer import outer_controller, outer_names, outer_settings, velocity_filters
from rotorid.models.autopilots.settings import AxisController, loop_settings
from rotorid.proposing.axis import KnownAxis
from rotorid.proposing.climb import climb_plant, velocity_by_throttle
from rotorid.results.model import IdentifiedModel
from rotorid.signal.airborne import airborne
from rotorid.tuning.kinds import KINDS
from rotorid.tuning.loops import ControllerParts, Gains, frequency_grid, loop_figures
from rotorid.tuning.plant import FLOOR, UncertainPlant, uncertain_plant
from rotorid.typing import Axis, ComplexArray, FloatArray, LoopName

_KNOTS = np.linspace(np.log(0.02), np.log(200.0), 61)
_LOWEST_RAD_S = 0.03
"""Velocity plants have no slower mode than their drag, so loops count from here on."""

_DRAGS = ("Y_v", "X_u")

_MOSTLY = 0.5
"""Share of the likely attitude loops that have to be stable."""


@dataclass(frozen=True, kw_only=True)
class LoggedOuter(Immutable):
    """The controller of an outer loop, as :class:`rotorid.proposing.flown_gains.LoggedLoop` has that of an axis.

    Parameters
    ----------
    axis
        ``velocity`` or ``climb``.
    controller
        As flown.
    record
        Its log.
    loop_rate_hz
        Steps of the controller per second, where the log shows them.
    """

    axis: LoopName
    controller: AxisController
    record: FlightRecord
    loop_rate_hz: float | None = None

    @property
    def source(self) -> str:
        """Its velocity is the estimate, which passes no filter that is known."""
        return ""

    @property
    def passed(self) -> tuple[KnownFilter, ...]:
        """None, see ``source``."""
        return ()

    def parts(
        self, omega_rad_s: FloatArray, *, then: FlightRecord | None = None, noise: FloatArray | None = None
    ) -> ControllerParts:
        """Transfer functions of the gains, with the flown filters or those of another record's parameters."""
        own = self.controller if then is None else self.with_parameters(then)
        filters = np.ones(omega_rad_s.size, dtype=np.complex128)
        for known in velocity_filters(own):
            filters = filters * known.response(np.asarray(1j * omega_rad_s), own.controller.step_s)
        return ControllerParts(
            controller=own.controller,
            omega_rad_s=omega_rad_s,
            filters=filters,
            logged=np.ones_like(filters),
            rate_noise=noise,
            disturbance_rad_s=KINDS[self.axis].disturbance_rad_s,
        )

    def with_parameters(self, record: FlightRecord) -> AxisController:
        """The controller by the parameters of another record."""
        found = outer_controller(
            record.parameters, self.axis, firmware=record.source.firmware, loop_rate_hz=self.loop_rate_hz
        )
        if found is None:
            raise UsageError(
                f"the parameters give no {self.axis} controller", needed="gains that the autopilot can fly"
            )
        return found

    def rate_noise(self, _omega_rad_s: FloatArray, _band_rad_s: tuple[float, float]) -> FloatArray | None:
        """None: noise of an acceleration set-point is not measured, and gains are compared by white noise."""
        return None


class InnerLoop(NamedTuple):
    """An axis with the gains and filters that close its attitude loop.

    Parameters
    ----------
    known
        The axis.
    gains
        Of its loops.
    then
        The log with other filters among its parameters; ``None`` for those that flew.
    """

    known: KnownAxis
    gains: Gains
    then: FlightRecord | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class OuterMaterial(Immutable):
    """Everything of which plants of outer loops are made.

    Parameters
    ----------
    given, logs
        As for :func:`rotorid.proposing.proposal.tune`.
    inner
        The loops inside, by axis.
    draws, seed
        Of the plant.
    values
        Parameters of a file that will fly in place of those of the log.
    lacking
        Why an inner loop is not known; empty where all are.
    """

    given: tuple[IdentifiedModel, ...]
    logs: tuple[FlightRecord, ...]
    inner: Mapping[Axis, InnerLoop]
    draws: int
    seed: int
    values: Mapping[str, float] = field(default_factory=dict)
    lacking: str = ""

    def __post_init__(self) -> None:
        self._set(given=tuple(self.given), logs=tuple(self.logs), inner=self.inner, values=self.values)


class Drag(NamedTuple):
    """Drag over mass, 1/s: what was measured, with its standard deviation, and what it may be in calm air.

    Drag of the body grows with the airspeed. A loop has to hold in calm air, where drag helps least, and in the wind in
    which it was measured.
    """

    value: float
    std: float
    calm: float
    source: str

    def drawn(self, rng: np.random.Generator, draws: int) -> FloatArray:
        """Likely drags, from calm air to the wind that was flown, shape ``(draws,)``."""
        own = self.calm + (self.value - self.calm) * rng.random(draws)
        return np.asarray(np.maximum(own + self.std * rng.standard_normal(draws), 0.0))

    @property
    def usual(self) -> float:
        """Between calm air and the wind that was flown."""
        return 0.5 * (self.calm + self.value)


_BODY_DRAG_1_M, _LEAST_LEFT = 0.03, 0.3
"""Drag over mass that grows with the square, as of the library's bodies, where a flight does not show it; and the least
share of the measured drag that is left in calm air."""


def drag_of(given: Sequence[IdentifiedModel], logs: Sequence[FlightRecord]) -> Drag:
    """Drag over mass: of a given hover model, or of all flights.

    Raises
    ------
    InsufficientDataError
        Neither shows it.
    """
    for model in given:
        for name in _DRAGS:
            if name in model.parameters and (std := model[name].std) is not None:
                value = max(-model[name].value, 0.0)
                return Drag(value, std, value, f"{name} of {model.name}")
    why = ""
    # All flights together show it best; one without its channels takes no other's away.
    alone = [(record,) for record in logs]
    for some in (tuple(logs), *alone) if len(logs) > 1 else alone:
        try:
            found = tilt_drag_of([(record, airborne(record).intervals) for record in some])
        except InsufficientDataError as error:
            why = why or error.came
        else:
            return _flown_drag(found, ", ".join(record.source.name for record in some))
    raise InsufficientDataError(
        f"the drag is not known{f' ({why})' if why else ''}, and the velocity loop depends on it",
        needed="a flight that shows it, or a result of hover.lateral",
        remedy="log accelerometer and velocity, fly 60 s back and forth at 2 to 5 m/s in calm air, give that log too",
    )


def _flown_drag(found: TiltDrag, source: str) -> Drag:
    value = found.drag.value
    if found.at_rest is not None:
        own = found.at_rest
        calm = min(max(own.value - (own.std or 0.0), _LEAST_LEFT * value), value)
    else:
        calm = max(value - _BODY_DRAG_1_M * found.airspeed_m_s[1], _LEAST_LEFT * value)
    return Drag(value, found.drag.std or 0.0, calm, source)


def attitude_response(inner: InnerLoop, omega_rad_s: FloatArray, *, drawn: bool) -> ComplexArray:
    """The attitude over its set-point, of the most likely plant, shape ``(1, f)``, or of all draws, ``(draws, f)``.

    ArduPilot moves a target towards the set-point and feeds its rate forward; of PX4 the set-point flies as it is.
    """
    known, gains = inner.known, inner.gains
    parts, record = known.flown.parts(omega_rad_s, then=inner.then), known.flown.record
    plants = known.plant.drawn(omega_rad_s) if drawn else known.plant.response(omega_rad_s)[None]
    by_setpoint, s = parts.angle(gains), 1j * omega_rad_s
    lag_s = record.parameters.get("ATC_INPUT_TC", 0.0)
    if lag_s > 0.0 and gains.A > 0.0 and record.parameters.get("ATC_RATE_FF_ENAB", 1.0):
        by_setpoint = by_setpoint * (1.0 + s / gains.A) / (1.0 + lag_s * s)
    return np.asarray(plants * by_setpoint / (1.0 + plants * parts.whole(gains)))


def velocity_plants(material: OuterMaterial) -> dict[str, UncertainPlant]:
    """Velocity by the acceleration asked for, through each attitude loop that is known.

    Raises
    ------
    InsufficientDataError
        Neither attitude loop is known, or the drag is not.
    """
    inner = {axis: one for axis, one in material.inner.items() if axis in ("roll", "pitch") and one.gains.A > 0.0}
    if not inner:
        raise InsufficientDataError(
            f"no attitude loop of roll or pitch is known{f' ({material.lacking})' if material.lacking else ''}",
            needed="a flight that shows one",
            remedy="fly the sweep that roll needs first",
        )
    drag = drag_of(material.given, material.logs)
    return {axis: velocity_plant(one, drag, seed=material.seed) for axis, one in inner.items()}


def velocity_plant(inner: InnerLoop, drag: Drag, *, seed: int) -> UncertainPlant:
    """Velocity by the acceleration asked for, through one attitude loop."""

    def response(omega_rad_s: FloatArray) -> ComplexArray:
        omega = np.atleast_1d(omega_rad_s)
        return np.asarray(attitude_response(inner, omega, drawn=False)[0] / (1j * omega + drag.usual))

    knots = np.asarray(np.exp(_KNOTS))
    known = inner.known
    attitudes = attitude_response(inner, knots, drawn=True) / attitude_response(inner, knots, drawn=False)
    whole = known.drawn() * known.flown.parts(known.omega_rad_s, then=inner.then).whole(inner.gains)
    stable = loop_figures(known.omega_rad_s, whole, from_rad_s=known.plant.known_from_rad_s).stable > 0.0
    if np.mean(stable) < _MOSTLY:
        raise InsufficientDataError(
            f"the attitude loop of {known.flown.axis} may be unstable, and the velocity loop is around it",
            remedy=f"lower the gains of {known.flown.axis} first",
        )
    # What flew was stable: of a draw that is not, there is no attitude to speak of.
    attitudes[~stable] = 1.0
    rng = np.random.default_rng(seed)
    drags = drag.drawn(rng, len(attitudes))
    s = 1j * knots
    spread = np.log(attitudes) + np.log((s + drag.usual) / (s + drags[:, None]))
    band = (_LOWEST_RAD_S, known.plant.band_rad_s[1])
    rest = uncertain_plant(response, None, band_rad_s=band, draws=len(attitudes), seed=seed + 1, floor=FLOOR)
    places = np.log(knots)
    floor = np.array(
        [np.interp(places, rest.knots, row.real) + 1j * np.interp(places, rest.knots, row.imag) for row in rest.misfits]
    )
    return UncertainPlant(
        model=response, band_rad_s=band, knots=places, mean=np.zeros(places.size), misfits=spread + floor
    )


def climb_plants(material: OuterMaterial) -> dict[str, UncertainPlant]:
    """Vertical velocity by the acceleration asked for, see :mod:`rotorid.proposing.climb`."""
    record = flown_outer("climb", material.logs).record
    velocity = velocity_by_throttle(material.given, material.logs, draws=material.draws, seed=material.seed)
    parameters = {**record.parameters, **material.values}
    plant = climb_plant(velocity, record, parameters, seed=material.seed, judged=bool(material.values))
    return {"": plant}


PLANTS: dict[LoopName, Callable[[OuterMaterial], dict[str, UncertainPlant]]] = {
    "velocity": velocity_plants,
    "climb": climb_plants,
}
"""What gives the plants of an outer loop, by the axis through which each acts; an empty name where there is none."""


def flown_outer(loop: LoopName, logs: Sequence[FlightRecord]) -> LoggedOuter:
    """The flown controller of an outer loop, by the parameters of the first log that has its gains.

    Raises
    ------
    InsufficientDataError
        No log has them.
    """
    for record in logs:
        rate_hz = _step_hz(record)
        found = outer_controller(record.parameters, loop, firmware=record.source.firmware, loop_rate_hz=rate_hz)
        if found is not None:
            return LoggedOuter(axis=loop, controller=found, record=record, loop_rate_hz=rate_hz)
    name = logs[0].source.name if logs else "the result"
    first = outer_names(loop)[0]
    why = f"{name} contains no gains of {loop}"
    raise InsufficientDataError(
        why,
        needed=f"PX4 or ArduPilot parameters such as {first}" if logs else "the log with the result",
        findings=[refusal("no_controller", loop, f"{why}.")],
    )


_EVERY_ESTIMATE_HZ = 40.0


def _step_hz(record: FlightRecord) -> float | None:
    """Steps of PX4's position controller, which follow the position estimate, where each of them is logged."""
    if "EKF2_PREDICT_US" in record.parameters:
        return None
    for topic in record.topics:
        if topic.name == "vehicle_local_position" and topic.time_s.size > 2:
            rate_hz = float(1.0 / np.median(np.diff(topic.time_s)))
            return rate_hz if rate_hz > _EVERY_ESTIMATE_HZ else None
    return None


def known_outer(loop: LoopName, flown: OuterMaterial, new: OuterMaterial) -> tuple[KnownAxis, list[Finding]]:
    """An outer loop with its plant, with the inner loops as flown and as they will fly.

    Parameters
    ----------
    loop
        ``velocity`` or ``climb``.
    flown, new
        Its material, with the inner loops as flown, and with their new gains.

    Raises
    ------
    InsufficientDataError
        Its gains, or its plant, are not known.
    """
    own = flown_outer(loop, flown.logs)
    omega = frequency_grid(own.controller.controller, loop)
    parts = own.parts(omega)
    plants, before = PLANTS[loop](new), PLANTS[loop](flown)
    axis = max(plants, key=lambda name: _peak(plants[name], parts, own))
    findings = [_unchecked(own), *_kept_inside(own)]
    if axis and len(plants) == 1:
        findings.append(_other_axis(loop, axis))
    known = KnownAxis(
        flown=own,
        plant=_of_all(plants, axis),
        omega_rad_s=omega,
        flown_parts=parts,
        then=None,
        controller=own.controller,
        parts=parts,
        flown_plant=_of_all(before, axis),
    )
    return known, findings


def _of_all(plants: Mapping[str, UncertainPlant], first: str) -> UncertainPlant:
    """One plant with the draws of all axes in turn, since gains that these share have to hold on each of them."""
    own = plants[first]
    omega = np.exp(own.knots)
    misfits = np.array(own.misfits)
    others = [plant for name, plant in plants.items() if name != first]
    for number, plant in enumerate(others, 1):
        ratio = plant.response(omega) / own.response(omega)
        apart = np.log(np.abs(ratio)) + 1j * np.unwrap(np.angle(ratio))
        rows = slice(number, None, len(plants))
        misfits[rows] = plant.misfits[rows] + apart
    return replace(own, misfits=misfits)


def _peak(plant: UncertainPlant, parts: ControllerParts, own: LoggedOuter) -> float:
    whole = plant.response(parts.omega_rad_s) * parts.whole(Gains.of(own.controller.controller))
    return float(np.max(1.0 / np.abs(1.0 + whole)))


def _other_axis(loop: LoopName, axis: str) -> Finding:
    return remark(
        "plant_of_choice",
        loop,
        f"Only {axis} was measured, so {loop} is judged through {axis} alone; the other axis flies the same gains.",
    )


def _unchecked(own: LoggedOuter) -> Finding:
    message = (
        f"The gains of {own.axis} are those of the parameters of {own.record.source.name}; whether they made its "
        "set-points was not checked."
    )
    return remark("controller_unchecked", own.axis, message)


def _kept_inside(own: LoggedOuter) -> Iterator[Finding]:
    """That the loop around the acceleration keeps its gains: the climb loop is proposed around it as it flew."""
    if names := acceleration_gains(own.controller.gains):
        message = (
            f"{listed(names)} stay as flown: rotorid judges the loop around the acceleration (--judge FILE), but "
            "proposes no gains for it."
        )
        yield remark("tuning_bound", own.axis, message)


def with_values(record: FlightRecord, values: Mapping[str, float]) -> FlightRecord:
    """The log with other parameters of its loops, inner and outer."""
    return replace(record, parameters={**record.parameters, **loop_settings(values), **outer_settings(values)})
