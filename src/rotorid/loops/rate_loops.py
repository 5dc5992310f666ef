r"""The loop around an axis as a flight shows it: the one answer of ``review``, ``response`` and ``tune``.

.. math:: L = \hat P C

is the *rate loop alone*, broken at the command: the plant as the flight shows it
(:mod:`rotorid.loops.plants`) times the controller of the log without its angle loop, as far as that
controller made the logged command. Its margins are read from many likely plants, which are the measurement inside the
band and a lag with a growing error beyond it, so each has its own interval wherever it lies; what lies beyond the band
is named as such. Only stable plants count, since the loop flew.

A test signal at the mixer shows the *whole loop* too, with the outer loops closed, whatever the gains are.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Literal

import numpy as np

from rotorid.autopilots.advice import logging_advice, loop_advice, move_stick
from rotorid.data.axes import ANGLE_OF, RATE_OF
from rotorid.data.base import Immutable
from rotorid.data.display import capital
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.quantities import QUANTITIES
from rotorid.data.quantity import Quantity, with_unit
from rotorid.data.record import LOWEST_RATE_HZ, FlightRecord, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.data.trust import RICH_KINDS
from rotorid.errors import InsufficientDataError
from rotorid.flights.command_relation import injection_delay_s
from rotorid.flights.controller_check import ControllerCheck, check_controller
from rotorid.flights.controllers import LoggedController, controller_as_logged, controllers_of
from rotorid.flights.flights import Flight
from rotorid.flights.measure import Measured
from rotorid.flights.segments import cut, histories, with_surroundings
from rotorid.flights.whole_flights import flown
from rotorid.loops.plants import (
    MeasuredPlant,
    PlantUnavailableError,
    WholeFlight,
    drawn_plant,
    enters_the_mixer,
    ordinary_plant,
    swept_plant,
    whole_flight,
)
from rotorid.loops.throttle import at_hover_throttle, plant_at_hover
from rotorid.models.autopilots.betaflight import TOP
from rotorid.models.autopilots.settings import AxisController
from rotorid.models.controller import RateController
from rotorid.settings.measuring import MeasureSettings
from rotorid.signal.excitations import find_excitations
from rotorid.spectral.derived import Estimated, with_model_error
from rotorid.spectral.estimate import frequency_response
from rotorid.spectral.loops import injected_loop, sensitivity, series
from rotorid.spectral.margins import (
    AttitudeBandwidth,
    Bound,
    DisturbanceRejection,
    GainCrossover,
    LoopMargins,
    PhaseCrossover,
    attitude_bandwidth,
    disturbance_rejection,
    loop_margins,
)
from rotorid.spectral.windows import band_of, grid_rad_s, margin_s, plan_of_records
from rotorid.tuning.judging import LoopVerdict, loop_verdict, situations_of
from rotorid.tuning.loops import LoopFigures, frequency_grid, loop_figures, quantities
from rotorid.tuning.plant import UncertainPlant
from rotorid.typing import Axis, ComplexArray, FloatArray

MODEL_ERROR = 0.007
"""Share of a measured loop that it errs by whatever the length of the flight, alike over an octave."""

NUMBERS = (
    "crossover_rad_s",
    "phase_margin_deg",
    "delay_margin_s",
    "gain_margin_db",
    "sensitivity_peak",
    "disturbance_rejection_rad_s",
)
"""Figures of a rate loop that a flight can show."""


RATE_LOOP = "measured vehicle times the gains in the log, rate loop alone"
"""Description of the loop for every verb."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RateLoop(Immutable):
    """The rate loop of an axis as it was flown, without its angle loop.

    Parameters
    ----------
    measured, plant
        The plant as the flight shows it, and draws of it.
    controller
        The rate controller by the gains and filters of the log; of one that moves in flight the end nearest to what
        flew.
    settings
        What the log says of the controller, by the firmware's own names.
    check
        Whether the gains made the command.
    loop
        Broken-loop response in the band.
    numbers
        By the names of :data:`NUMBERS`.
    by_model
        Names of those that lie beyond the band, where a lag goes on.
    missing
        Name of each number that the flight does not show, and why.
    places_rad_s
        Name of a number to the frequency at which it is read.
    ends
        Names of states between which the controller moves in flight, to the numbers there; empty for one that stays.
    verdict
        That on the flown gains, by rate loop and whole loop; ``None`` where the flight does not show their sensitivity.
    """

    measured: MeasuredPlant
    plant: UncertainPlant
    controller: RateController
    settings: AxisController
    check: ControllerCheck
    loop: FrequencyResponse
    numbers: Mapping[str, Quantity]
    by_model: tuple[str, ...]
    missing: Mapping[str, str]
    places_rad_s: Mapping[str, Quantity]
    ends: Mapping[str, Mapping[str, Quantity]] = field(default_factory=dict)
    verdict: LoopVerdict | None = None

    @property
    def crossover_measured(self) -> bool:
        """Whether the flight shows the crossover within its band."""
        return "crossover_rad_s" in self.numbers and "crossover_rad_s" not in self.by_model


def rate_loop(
    axis: Axis, records: FlightRecord | Sequence[FlightRecord], settings: MeasureSettings | None = None
) -> RateLoop:
    """The rate loop of an axis as one or several flights with the same gains show it.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    records
        Logs of one vehicle; several of them only with rich excitations.
    settings
        How rich excitations are measured.

    Raises
    ------
    PlantUnavailableError
        The log does not show plant or controller; it says why, and what would help.
    InsufficientDataError
        It is too short.
    """
    logs = [records] if isinstance(records, FlightRecord) else list(records)
    record = logs[0]
    for log in logs:
        _require_logged(log, axis)
    _require_same_gains(axis, logs)
    known, check = _settings(record, axis), check_controller(record, axis)
    controllers = _order_by_flown_derivative(known, check)
    try:
        measured = swept_plant(axis, logs, settings)
    except InsufficientDataError:
        # Excitations that show too little take nothing from the flight around them.
        if len(logs) > 1 or (settings is not None and settings.segments):
            raise
        measured = None
    if measured is not None:
        _require_made(check)
    elif len(logs) > 1:
        raise PlantUnavailableError(
            f"Only the stick excited {axis}, and several ordinary flights cannot be joined.",
            "give one log",
        )
    else:
        flight = flown(record)
        whole = whole_flight(flight, axis)
        _require_made(check, in_doubt=True)
        acting = [
            controller_as_logged(record, controller.rate_loop, source=whole.source)
            for controller in controllers.values()
        ]
        by_stick = None
        with contextlib.suppress(PlantUnavailableError):
            if (identified := _as_identified(whole, record)) is not None:
                by_stick = _read(record, identified, known, check, controllers)
        if by_stick is not None and by_stick.crossover_measured:
            return by_stick
        # What identify takes ends below the crossover: the whole flight, or the set-point of the rate, may show it.
        try:
            found = at_hover_throttle(ordinary_plant(flight, whole, acting), [record], flight=flight)
            over_all = _read(record, found, known, check, controllers)
        except PlantUnavailableError:
            if by_stick is None:
                raise
            return by_stick
        return by_stick if by_stick is not None and "crossover_rad_s" not in over_all.numbers else over_all
    return _read(record, measured, known, check, controllers)


def _as_identified(whole: WholeFlight, record: FlightRecord) -> MeasuredPlant | None:
    """The plant of an ordinary flight as ``identify`` measures it, at hover; ``None`` where it takes no part of it."""
    if whole.idle and not find_excitations(record, whole.axis):
        return None
    try:
        found = plant_at_hover(whole.axis, [record])
    except InsufficientDataError:
        return None
    if found is None:
        return None
    instrument = whole.instrument if found.channel == whole.channel else "stick"
    return replace(found, instrument=instrument, idle=whole.idle)


def _require_logged(record: FlightRecord, axis: Axis) -> None:
    """Refuse a log without command or rate of an axis, or with these too slow."""
    rate, command = RATE_OF[axis], f"{axis}_command"
    missing = [name for name in (command, rate) if name not in record.channel_names]
    if missing:
        raise PlantUnavailableError(
            f"The log contains no {' and no '.join(missing)}.", logging_advice(record, 0.0, tuple(missing))
        )
    slowest_hz = min(record.rate_hz(command), record.rate_hz(rate))
    if slowest_hz < LOWEST_RATE_HZ:
        raise PlantUnavailableError(
            f"Command and rate of {axis} are logged at {slowest_hz:.0f} Hz; at least {LOWEST_RATE_HZ:.0f} Hz is "
            "required.",
            logging_advice(record, slowest_hz),
        )


def _require_same_gains(axis: Axis, records: Sequence[FlightRecord]) -> None:
    changed = any(finding.kind == "parameters_changed" for record in records for finding in record.findings)
    first = controllers_of(records[0])
    # Rates of a loop as logs show them differ in their digits, and throttles from flight to flight: gains do not.
    each = [
        replace(controllers_of(record), loop_rate_hz=first.loop_rate_hz, throttle=first.throttle).axis(axis)
        for record in records
    ]
    if changed or any(_made_of(controller) != _made_of(each[0]) for controller in each):
        where = "in the log" if changed else "between the logs"
        raise PlantUnavailableError(
            f"The gains changed {where}, so the loop is ambiguous.", "give one log flown with a single set of gains"
        )


def _made_of(settings: AxisController | None) -> tuple[object, ...]:
    """Composition of a loop, independent of the name of the firmware."""
    return () if settings is None else (settings.controller, dict(settings.ends))


def _settings(record: FlightRecord, axis: Axis) -> AxisController:
    known = controllers_of(record)
    settings = known.axis(axis)
    if settings is None:
        why, remedy = known.unknown_gains(axis)
        raise PlantUnavailableError(f"{why}.", remedy)
    return settings


def _require_made(check: ControllerCheck, *, in_doubt: bool = False) -> None:
    """Refuse gains that did not fly; without a sweep also gains that could not be checked."""
    unseen = check.verdict == "not checked" and bool(check.setpoint) and check.unexplained is None
    if check.verdict == "not made" or (in_doubt and unseen):
        raise PlantUnavailableError(f"{check.why}.", check.remedy)


def _order_by_flown_derivative(settings: AxisController, check: ControllerCheck) -> dict[str, RateController]:
    """The controllers at the ends between which it moves, that nearest to what flew first."""
    if not settings.ends:
        return {"": settings.controller}
    ends = dict(settings.ends)
    own = check.terms.get("d")
    if own is None:
        return ends
    top = ends[TOP].derivative_s2
    order = sorted(ends, key=lambda name: abs(ends[name].derivative_s2 - own.slope * top))
    return {name: ends[name] for name in order}


def _integral_as_flown(controller: RateController, check: ControllerCheck) -> RateController | None:
    """The controller with the integral of the flight; ``None`` if the flight shows none."""
    if "i" not in check.terms or not controller.proportional_s:
        return None
    return replace(controller, integral=controller.integral * min(max(check.terms["i"].slope, 0.0), 1.0))


def _read(
    record: FlightRecord,
    measured: MeasuredPlant,
    known: AxisController,
    check: ControllerCheck,
    controllers: Mapping[str, RateController],
) -> RateLoop:
    plant = drawn_plant(measured)
    withheld = _NOT_BY_GUSTS if measured.gusts else _BY_STICK if measured.idle else ()
    acting = {
        name: controller_as_logged(record, controller.rate_loop, source=measured.source)
        for name, controller in controllers.items()
    }
    each = {
        name: read_margins(figures_of(plant, logged, gusts=measured.gusts), plant, withheld=withheld)
        for name, logged in acting.items()
    }
    main, *_ = each
    numbers, by_model, places = each[main]
    moved = _integral_as_flown(controllers[main], check)
    if moved is not None:
        other = controller_as_logged(record, moved.rate_loop, source=measured.source)
        numbers = _widened(
            numbers, read_margins(figures_of(plant, other, gusts=measured.gusts), plant, withheld=withheld)[0]
        )
    loop = series(measured.response, acting[main].response(measured.response.omega_rad_s))
    loop = with_model_error(loop, MODEL_ERROR)
    missing = _reasons(loop, numbers, plant, withheld)
    if not set(numbers) & set(NUMBERS):
        raise PlantUnavailableError(missing["crossover_rad_s"], _remedy(measured, record))
    return RateLoop(
        measured=measured,
        plant=plant,
        controller=controllers[main],
        settings=known,
        check=check,
        loop=loop,
        numbers=numbers,
        by_model=by_model,
        missing=missing,
        places_rad_s=places,
        ends={name: answers[0] for name, answers in each.items()} if len(each) > 1 else {},
        verdict=None if "sensitivity_peak" in withheld else _verdict(record, plant, measured.source, controllers),
    )


def _verdict(
    record: FlightRecord, plant: UncertainPlant, source: str, controllers: Mapping[str, RateController]
) -> LoopVerdict:
    """The verdict on the flown gains, by the rule for all gains."""
    omega = frequency_grid(next(iter(controllers.values())))

    def made(controller: RateController) -> ComplexArray:
        return controller_as_logged(record, controller, source=source).response(omega)

    loops = {name: (made(controller.rate_loop), made(controller)) for name, controller in controllers.items()}
    return loop_verdict(plant, situations_of(plant, omega, loops))


def figures_of(plant: UncertainPlant, controller: LoggedController, *, gusts: bool = False) -> LoopFigures:
    """Margins over the draws of a plant under a controller that flew; what gusts alone show ends with the band."""
    omega = frequency_grid(controller.controller)
    omega = omega[omega <= plant.band_rad_s[1]] if gusts else omega
    loops = plant.drawn(omega) * controller.response(omega)
    return loop_figures(omega, loops, from_rad_s=plant.known_from_rad_s)


_LEAST_SHARE = 0.9
"""Share of the draws that must have a number for it to be there."""

_PLACES = {
    "crossover_rad_s": "crossover_rad_s",
    "phase_margin_deg": "crossover_rad_s",
    "delay_margin_s": "crossover_rad_s",
    "gain_margin_db": "gain_margin_rad_s",
    "sensitivity_peak": "sensitivity_peak_rad_s",
    "disturbance_rejection_rad_s": "rejection_bandwidth_rad_s",
}
"""Numbers to the field of :class:`LoopFigures` with the frequency of each."""

_BY_STICK = ("gain_margin_db", "sensitivity_peak")
"""Numbers that a flight with an idle stick cannot show, even if short maneuvers moved the set-point."""

_NOT_BY_GUSTS = (*_BY_STICK, "disturbance_rejection_rad_s")
"""Numbers that gusts alone cannot show: below the crossover they show the controller, not the plant."""

_WIDEST_CROSSOVER = 3.0
"""Highest over lowest frequency of a crossover; where a gain lies along one for longer there is none to speak of."""


def read_margins(
    figures: LoopFigures, plant: UncertainPlant, *, withheld: Sequence[str] = ()
) -> tuple[dict[str, Quantity], tuple[str, ...], dict[str, Quantity]]:
    """Margins of a loop that flew: numbers, names of those beyond the band, and the frequencies of all.

    Parameters
    ----------
    figures
        Over the draws of the plant.
    plant
        Whose band counts as measured; beyond it a number is there only where a lag goes on.
    withheld
        Names of what such a flight does not show.
    """
    flew = figures.as_flown
    unstable = not figures.stable.any()
    margins = quantities(flew)
    margins["disturbance_rejection_rad_s"] = margins.pop("rejection_bandwidth_rad_s", None)  # type: ignore[arg-type]
    low, high = plant.band_rad_s
    numbers: dict[str, Quantity] = {}
    places: dict[str, Quantity] = {}
    by_model = []
    for name, where in _PLACES.items():
        at = getattr(flew, where)
        finite = at[np.isfinite(at)]
        quantity = margins.get(name)
        if quantity is None or finite.size < _LEAST_SHARE * at.size or name in withheld:
            continue
        # A loop that no draw makes stable is not the one that flew: its other numbers are no margins.
        if unstable and name != "crossover_rad_s":
            continue
        place = float(np.median(finite))
        beyond = place > high
        if not low <= place <= plant.reach_rad_s:
            continue
        at_place = _at(finite)
        if where == "crossover_rad_s" and at_place.upper > _WIDEST_CROSSOVER * at_place.lower:
            continue
        numbers[name] = quantity
        places[name] = at_place
        by_model += [name] if beyond else []
    return numbers, tuple(by_model), places


_AS_READ = {"rejection_bandwidth_rad_s": "disturbance_rejection_rad_s", "rejection_peak_db": "sensitivity_peak"}
"""Names of :func:`rotorid.tuning.loops.quantities` to those of the numbers on which they depend, where these differ."""


def shown_quantities(figures: LoopFigures, plant: UncertainPlant) -> dict[str, Quantity]:
    """Quantities of a loop that flew under the names of ``tune``, without those that its flight does not show.

    Parameters
    ----------
    figures, plant
        As for :func:`read_margins`.
    """
    shown, _, _ = read_margins(figures, plant)
    return {
        name: quantity for name, quantity in quantities(figures.as_flown).items() if _AS_READ.get(name, name) in shown
    }


def _at(omega_rad_s: FloatArray) -> Quantity:
    low, middle, high = np.quantile(omega_rad_s, (0.025, 0.5, 0.975))
    std = float(np.std(omega_rad_s))
    return Quantity(value=float(middle), std=std, lower=float(low), upper=float(high), unit="rad/s")


def _widened(numbers: Mapping[str, Quantity], other: Mapping[str, Quantity]) -> dict[str, Quantity]:
    r"""Numbers whose intervals reach to those of a controller that flew for a part of the time.

    What lies between both is as likely everywhere, :math:`\sigma^2 = \Delta^2 / 3`.
    """
    found = {}
    for name, quantity in numbers.items():
        found[name] = quantity
        if name in other and quantity.std > 0.0:
            moved = other[name].value - quantity.value
            more = math.hypot(1.0, moved / math.sqrt(3.0) / quantity.std)
            found[name] = replace(
                quantity,
                std=quantity.std * more,
                lower=quantity.value - more * (quantity.value - quantity.lower),
                upper=quantity.value + more * (quantity.upper - quantity.value),
            )
    return found


def _reasons(
    loop: FrequencyResponse, numbers: Mapping[str, Quantity], plant: UncertainPlant, withheld: Sequence[str]
) -> dict[str, str]:
    low, high = plant.band_rad_s
    sizes = np.abs(loop.values[0, 0])
    crossed = bool(sizes.max() > 1.0 > sizes.min())
    cannot = f"The loop was measured from {low:.3g} to {high:.3g} rad/s"
    crossing = "crosses 1 over a wide range" if crossed else "does not cross 1 there"
    reasons = dict.fromkeys(
        ("crossover_rad_s", "phase_margin_deg", "delay_margin_s"), f"{cannot}, and its gain {crossing}."
    )
    bound = loop_margins(loop).bounds.get("gain_margin_up")
    least = f"; it is at least {20.0 * math.log10(bound.value):.1f} dB" if bound is not None else ""
    refused = "" if plant.goes_on else " No model of the plant explains the flight well enough to extrapolate."
    reasons["gain_margin_db"] = f"{cannot}, and its phase does not pass −180° there{least}.{refused}"
    reasons["sensitivity_peak"] = f"{cannot}, and the sensitivity has no peak there.{refused}"
    reasons["disturbance_rejection_rad_s"] = f"{cannot}, and the sensitivity does not rise through −3 dB there."
    reasons |= dict.fromkeys(withheld, "The stick barely moved, and gusts alone do not show it.")
    return {name: why for name, why in reasons.items() if name not in numbers}


def remedy_of(loop: RateLoop, record: FlightRecord) -> str:
    """Remedy for the missing numbers of a loop that a log shows."""
    return _remedy(loop.measured, record)


def _remedy(measured: MeasuredPlant, record: FlightRecord) -> str:
    axis = measured.axis
    return move_stick(axis) if measured.idle else loop_advice(record, axis, measured.sample_rate_hz)


# The loops of ``response``: the same numbers under its names, with the whole loop and the attitude.


@dataclass(frozen=True, kw_only=True, eq=False)
class Beyond:
    """Extrapolation of the loop: a lag fitted to the measured vehicle times the logged controller.

    Parameters
    ----------
    method
        How it was found, in words.
    up_to_rad_s
        How far it goes.
    numbers
        Margins that the band does not show, by the names of :attr:`AxisLoop.numbers`.
    """

    method: str
    up_to_rad_s: float
    numbers: Mapping[str, Estimated] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisLoop:
    """The loop around one axis of a flight.

    Parameters
    ----------
    method
        How the broken loop was found, in words.
    loop
        The broken-loop response, or ``None``.
    margins, rejection
        What follows from it.
    attitude
        Bandwidth of the attitude's answer to its command.
    beyond
        What lies beyond the band by model and controller, where both are known.
    scope
        ``rate`` for the rate loop alone, ``whole`` for the loop with the outer loops closed around it.
    whole
        The whole loop, where a test signal at the mixer shows it beside the rate loop.
    """

    method: str
    loop: FrequencyResponse | None
    margins: LoopMargins | None
    rejection: DisturbanceRejection | None
    attitude: AttitudeBandwidth | None
    beyond: Beyond | None = None
    scope: Literal["rate", "whole"] = "rate"
    whole: AxisLoop | None = None

    @property
    def band_rad_s(self) -> tuple[float, float] | None:
        """Lowest and highest frequency of the broken loop; ``None`` if not measured."""
        return None if self.loop is None else (float(self.loop.omega_rad_s[0]), float(self.loop.omega_rad_s[-1]))

    @property
    def numbers(self) -> dict[str, Estimated]:
        """Measured numbers, by names with units: margins, rejection of disturbances, bandwidths."""
        found = {
            _public_name(part, item.name): value
            for part in self._parts
            for item in fields(part)
            if isinstance(value := getattr(part, item.name), Estimated)
        }
        if self.margins is not None and self.margins.gain_crossovers:
            found["crossover_rad_s"] = self.margins.gain_crossovers[-1].omega_rad_s
        return found

    @property
    def not_seen(self) -> dict[str, str]:
        """Names of missing numbers, to the reason."""
        return {_public_name(part, name): reason for part in self._parts for name, reason in part.not_seen.items()}

    @property
    def bounds(self) -> dict[str, Bound]:
        """Names of some missing numbers, to their bound at the end of the band."""
        parts = [part for part in (self.margins, self.rejection) if part is not None]
        return {_public_name(part, name): bound for part in parts for name, bound in part.bounds.items()}

    @property
    def _parts(self) -> tuple[LoopMargins | DisturbanceRejection | AttitudeBandwidth, ...]:
        return tuple(part for part in (self.margins, self.rejection, self.attitude) if part is not None)


def _public_name(part: LoopMargins | DisturbanceRejection | AttitudeBandwidth, name: str) -> str:
    """Names of different parts next to each other."""
    if isinstance(part, DisturbanceRejection):
        return f"disturbance_rejection_{name}"
    return f"attitude_{name}" if isinstance(part, AttitudeBandwidth) else name


def axis_loop(
    axis: Axis, measured: Measured, flights: Sequence[Flight], settings: MeasureSettings | None = None
) -> AxisLoop | None:
    """The loop around an axis, from whatever the flights offer; ``None`` where they offer nothing.

    The rate loop alone where the gains are known, and the whole loop where an injection at the mixer shows it. The
    attitude's answer is that to its instrument, the stick or the set-point.

    Parameters
    ----------
    measured
        Responses of a command of this axis, and the data behind them.
    flights
        Records and maneuvers behind them.
    settings
        Of the response; segments and shifts count.
    """
    records = list({id(flight.record): flight.record for flight in flights}.values())
    attitude = _attitude(axis, measured, histories(measured.segments))
    whole = _whole_loop(axis, records)
    # Band, windows and estimate are choices of the response that is shown: the loop is that of the other verbs.
    shown = settings or MeasureSettings()
    own = {name: shift for name, shift in shown.shifts.items() if name in (f"{axis}_command", RATE_OF.get(axis))}
    segments = tuple(maneuver for maneuver in shown.segments if maneuver.axis == axis)
    plain = MeasureSettings(segments=segments, shifts=own)
    try:
        found = _of_rate(rate_loop(axis, records, plain)) if axis in RATE_OF else None
        why = ""
    except InsufficientDataError as error:
        found, why = None, str(error.came or error)
    if found is not None:
        return replace(found, attitude=attitude, whole=whole)
    why = f"{why[:1].lower()}{why[1:].rstrip('.')}"
    if whole is not None:
        return replace(whole, attitude=attitude, method=f"{whole.method}; no rate loop: {why}" if why else whole.method)
    if attitude is None:
        return None
    return AxisLoop(
        method=f"no broken loop: {why}",
        loop=None,
        margins=None,
        rejection=None,
        attitude=attitude,
    )


def _whole_loop(axis: Axis, records: Sequence[FlightRecord]) -> AxisLoop | None:
    try:
        return loop_by_injection(axis, records)
    except InsufficientDataError:
        return None


def _of_rate(found: RateLoop) -> AxisLoop:
    """A rate loop under the names of ``response``."""
    named = _named(found)
    measured = {name: value for name, value in named.items() if _SOURCES[name] not in found.by_model}
    local = loop_margins(found.loop)
    rejection = disturbance_rejection(sensitivity(found.loop))
    omega, phase, delay = (measured.get(name) for name in ("crossover_rad_s", "phase_margin_rad", "delay_margin_s"))
    crossovers = (
        (GainCrossover(omega_rad_s=omega, phase_margin_rad=phase, delay_margin_s=delay),)
        if omega and phase and delay
        else ()
    )
    up = measured.get("gain_margin_up")
    turns = (
        (PhaseCrossover(omega_rad_s=_estimated(found.places_rad_s["gain_margin_db"]), gain_margin=up),) if up else ()
    )
    margins = {
        name: measured.get(name)
        for name in ("phase_margin_rad", "delay_margin_s", "gain_margin_up", "modulus_margin", "modulus_omega_rad_s")
    }
    margins["gain_margin_down"] = local.gain_margin_down
    rejected = {
        name: measured.get(f"disturbance_rejection_{name}") for name in ("bandwidth_rad_s", "peak", "peak_omega_rad_s")
    }
    reasons = {name: found.missing.get(source, _BEYOND_BAND) for name, source in _SOURCES.items()}
    return AxisLoop(
        method=RATE_LOOP,
        loop=found.loop,
        margins=LoopMargins(
            gain_crossovers=crossovers,
            phase_crossovers=turns,
            **margins,
            not_seen={
                name: reasons.get(name, local.not_seen.get(name, ""))
                for name, estimated in margins.items()
                if estimated is None
            },
            bounds={name: bound for name, bound in local.bounds.items() if margins[name] is None},
        ),
        rejection=DisturbanceRejection(
            **rejected,
            not_seen={
                name: reasons[f"disturbance_rejection_{name}"]
                for name, estimated in rejected.items()
                if estimated is None
            },
            bounds={name: bound for name, bound in rejection.bounds.items() if rejected[name] is None},
        ),
        attitude=None,
        beyond=Beyond(
            method="a lag plus delay fitted to the measured vehicle, times the logged controller",
            up_to_rad_s=found.plant.reach_rad_s,
            numbers={name: value for name, value in named.items() if name not in measured},
        )
        if found.by_model
        else None,
    )


_BEYOND_BAND = "it lies beyond the band"

_SOURCES = {
    "crossover_rad_s": "crossover_rad_s",
    "phase_margin_rad": "phase_margin_deg",
    "delay_margin_s": "delay_margin_s",
    "gain_margin_up": "gain_margin_db",
    "modulus_margin": "sensitivity_peak",
    "modulus_omega_rad_s": "sensitivity_peak",
    "disturbance_rejection_bandwidth_rad_s": "disturbance_rejection_rad_s",
    "disturbance_rejection_peak": "sensitivity_peak",
    "disturbance_rejection_peak_omega_rad_s": "sensitivity_peak",
}
"""Names of ``response`` to those of :data:`NUMBERS`."""


def _named(found: RateLoop) -> dict[str, Estimated]:
    """Numbers of a rate loop under the names and in the units of ``response``."""
    named: dict[str, Estimated] = {}
    for name, source in _SOURCES.items():
        if source not in found.numbers:
            continue
        quantity = found.numbers[source]
        if name.endswith("_omega_rad_s"):
            named[name] = _estimated(found.places_rad_s[source])
        elif name == "phase_margin_rad":
            named[name] = _estimated(quantity, math.pi / 180.0)
        elif name == "gain_margin_up":
            factor = 10.0 ** (quantity.value / 20.0)
            ends = 10.0 ** (quantity.lower / 20.0), 10.0 ** (quantity.upper / 20.0)
            named[name] = Estimated(value=factor, std=factor * quantity.std * math.log(10.0) / 20.0, ends=ends)
        elif name == "modulus_margin":
            ends = 1.0 / quantity.upper, 1.0 / quantity.lower
            named[name] = Estimated(value=1.0 / quantity.value, std=quantity.std / quantity.value**2, ends=ends)
        else:
            named[name] = _estimated(quantity)
    return named


def _estimated(quantity: Quantity, factor: float = 1.0) -> Estimated:
    return Estimated(
        value=factor * quantity.value,
        std=factor * quantity.std,
        ends=(factor * quantity.lower, factor * quantity.upper),
    )


INJECTED = "measured with {}, all loops closed"
"""The loop from a test signal at the mixer."""


def loop_by_injection(axis: Axis, records: Sequence[FlightRecord]) -> AxisLoop | None:
    """The whole loop around an axis by its injections at the mixer alone; ``None`` where a flight has none.

    It needs neither a model of the vehicle nor the gains of its controller, and no other instrument: what is wrong with
    an identified plant is not wrong here.

    Parameters
    ----------
    records
        Logs of one vehicle with one set of gains.

    Raises
    ------
    InsufficientDataError
        The injections are too short, or the command was not logged beside them.
    """
    command, excitation = f"{axis}_command", f"{axis}_excitation"
    flights = [
        Flight(record, maneuver)
        for record in records
        if enters_the_mixer(record, excitation)
        for maneuver in find_excitations(record, axis)
        if maneuver.signal == excitation and maneuver.kind in RICH_KINDS
    ]
    if not flights:
        return None
    wider = with_surroundings(flights, margin_s([flight.maneuver for flight in flights]), (command, excitation))
    segments, _ = cut(wider, channels=(command, excitation))
    cut_out = histories(segments)
    band = band_of([flight.maneuver for flight in flights], cut_out[0].sample_rate_hz)
    plan = plan_of_records([history.duration_s for history in cut_out], band)
    loop = injected_loop(
        cut_out,
        command=command,
        excitation=excitation,
        omega_rad_s=grid_rad_s(band, plan),
        windows_s=plan.lengths_s,
        injection_delay_s=_common_delay_s(records),
    )
    loop = with_model_error(loop, MODEL_ERROR)
    return AxisLoop(
        method=INJECTED.format(excitation),
        loop=loop,
        margins=loop_margins(loop),
        rejection=disturbance_rejection(sensitivity(loop)),
        attitude=None,
        scope="whole",
    )


def _common_delay_s(records: Sequence[FlightRecord]) -> float:
    delays_s = {injection_delay_s(record) for record in records}
    return delays_s.pop() if len(delays_s) == 1 else 0.0


def _attitude(axis: Axis, measured: Measured, records: Sequence[TimeHistory]) -> AttitudeBandwidth | None:
    response, angle = measured.response, ANGLE_OF.get(axis, "")
    commands = [name for name in response.instruments if name in (f"{axis}_stick", f"{angle}_setpoint")]
    # Records of one response may have different instruments.
    held = {name: [record for record in records if {name, angle} <= set(record.names)] for name in commands}
    command = max(held, key=lambda name: len(held[name]), default="")
    if not held.get(command):
        return None
    try:
        answer = frequency_response(
            held[command],
            inputs=[command],
            outputs=[angle],
            omega_rad_s=response.omega_rad_s,
            windows_s=response.windows_s,
        )
    except InsufficientDataError:
        # The command or the attitude does not move, so the flight shows no response.
        return None
    return attitude_bandwidth(with_model_error(answer, MODEL_ERROR))


_BOUNDED = ("disturbance_rejection_peak", "phase_margin_rad", "gain_margin_up")
"""Numbers bounded by the end of the band that a finding names."""

_BY_MODEL = "extrapolated with a vehicle model and the logged controller:"


def beyond_band(axis: Axis, loop: AxisLoop) -> tuple[Finding, ...]:
    """The remark that margins of an axis lie beyond the band, with what is known of them."""
    bounds = {name: bound for name, bound in loop.bounds.items() if name in _BOUNDED}
    if not bounds:
        return ()
    bound_sentences = [_bound_words(name, bound) for name, bound in bounds.items()]
    end = next(iter(bounds.values())).omega_rad_s
    known = loop.beyond.numbers if loop.beyond else {}
    further = [f"{QUANTITIES[name].words} {_shown(name, known[name])}" for name in bounds if name in known]
    go_on = f" {capital(_BY_MODEL)} {' and '.join(further)}; this was not measured." if further else ""
    make = remark if set(bounds) == {"gain_margin_up"} else warn
    numbers = {name: bound.value for name, bound in bounds.items()}
    numbers |= {f"{name}_by_model": known[name].value for name in bounds if name in known}
    return (
        make(
            "margin_beyond_band",
            axis,
            f"The {loop.scope} loop of {axis} was measured up to {end:.3g} rad/s, and "
            f"{', and '.join(bound_sentences)}.{go_on} Sweep to higher frequencies to measure it.",
            omega_rad_s=end,
            **numbers,
        ),
    )


def _bound_words(name: str, bound: Bound) -> str:
    sign, still = ("at least", "rising") if bound.at_least else ("at most", "falling")
    return f"its {QUANTITIES[name].words} is {sign} {_shown(name, bound)}, still {still} there"


def _shown(name: str, bound: Bound | Estimated) -> str:
    """A margin in the unit of paper, ± one standard deviation."""
    row = QUANTITIES[name]
    return with_unit(row.with_error(bound.value, bound.std), row.unit)
