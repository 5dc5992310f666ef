r"""Closed loops of an ordinary flight: the frequency response from set-point to answer, and the step response.

Where a loop's set-point contains feedback, the response is a joint estimate with the stick as instrument; where the
pilot sets it himself, it is a direct estimate. The step response is that of a Gaussian process
(`rotorid.spectral.impulse`). A number that a slow log, an idle stick or a nonlinear loop does not support is left out,
with the reason.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from rotorid.autopilots.advice import absence, logging_advice, move_stick
from rotorid.autopilots.registry import autopilot_of
from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.quantities import QUANTITIES, figures_of
from rotorid.data.quantity import TWO_SIDED_95, Quantity
from rotorid.data.record import FlightRecord, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError
from rotorid.flights.whole_flights import (
    LEAST_MOTION_S,
    SHARED_OVER,
    USABLE_ERROR,
    FlightData,
    Instrument,
    loop_response,
)
from rotorid.reviewing.missing import Unavailable, section
from rotorid.reviewing.values import LoopReview, StepCurve
from rotorid.signal.motors import motor_limits
from rotorid.spectral.impulse import (
    ImpulseResponse,
    bound_of_band,
    flat_near_3db,
    impulse_response,
    phase_crossing,
    step_numbers,
)
from rotorid.typing import Axis, BoolArray, ComplexArray, FloatArray

RATE_FOR_BANDWIDTH, RATE_FOR_STEP = 1.25, 2.5
"""Hz of the log for each rad/s of the −90° bandwidth that bandwidth and delay need, and that the step needs."""

_SLOW_LOG_HZ = 110.0
"""In a slower log, a set-point that is constant between its samples may have changed half a period earlier or later."""

_FAST_ENOUGH_HZ = 40.0
"""In a slower log, a loop whose phase stays above −90° in its band is left out: a faster log would show more of it."""

_LEAST_COHERENCE = 0.3
"""Least coherence of stick or set-point with the motion at half the bandwidth: below, gusts move the vehicle."""

_SURE_COHERENCE = 0.95
"""Coherence of a stick at the bandwidth below which errors are widened: in gusts they exceed what noise explains."""

_WEAK_STICK = 2.0
"""Factor of the errors of a response by such a stick."""

_MOST_MISFIT = 3.0
"""Mean square misfit of the best linear loop, in its errors, above which no linear loop explains the flight."""

_SATURATED_SHARE = 0.05
"""Share of the flight with motors at their limits from which a warning is given: yaw suffers first."""

_NEAR_PEAK = 0.6
"""Least coherence at the resonance for its height."""

_OUTERMOST_S = 12.0
"""How long the response of a velocity is followed."""

_OF_STICK_RATE = 0.6
"""Share of its Nyquist frequency up to which a stick shows the answer; above, the direct response may be taken."""

_AGREED_FROM, _AGREED = 0.35, 2.5
"""Share of that frequency from which on, and errors within which, a direct response must agree with the joint one."""

_SIZE_WINDOW_S = 2.0
"""Window over which the size of a set-point is taken."""

_LEAST_OF_SIZE_S = 30.0
"""Small and large set-points are compared where each lasted as long."""

_LEAST_SIZE_RATIO = 2.0
"""And where their sizes differ by more than this factor."""

_STRETCH_S = 6.0
"""Shorter stretches of one size are left out."""


@dataclass(frozen=True, kw_only=True)
class Loop(Immutable):
    """A loop that a log may contain.

    Parameters
    ----------
    name
        Its state.
    axis
        Whose stick drives it.
    words
        What people call it.
    horizon_s, within_s
        How long its impulse response lasts, and how much of its step response is used.
    of_rates
        Whether the state is a body rate; the others are slower.
    """

    name: str
    axis: Axis
    words: str
    horizon_s: float
    within_s: float
    of_rates: bool = False

    @property
    def reference(self) -> str:
        return f"{self.name}_setpoint"


LOOPS: tuple[Loop, ...] = (
    Loop(name="p", axis="roll", words="roll rate", horizon_s=10.0, within_s=1.0, of_rates=True),
    Loop(name="q", axis="pitch", words="pitch rate", horizon_s=10.0, within_s=1.0, of_rates=True),
    Loop(name="r", axis="yaw", words="yaw rate", horizon_s=10.0, within_s=3.0, of_rates=True),
    Loop(name="phi", axis="roll", words="roll angle", horizon_s=10.0, within_s=3.0),
    Loop(name="theta", axis="pitch", words="pitch angle", horizon_s=10.0, within_s=3.0),
    Loop(name="psi", axis="yaw", words="heading", horizon_s=10.0, within_s=3.0),
    Loop(name="u", axis="pitch", words="forward speed", horizon_s=_OUTERMOST_S, within_s=8.0),
    Loop(name="v", axis="roll", words="sideward speed", horizon_s=_OUTERMOST_S, within_s=8.0),
    Loop(name="w", axis="thrust", words="climb rate", horizon_s=_OUTERMOST_S, within_s=8.0),
)
"""Every loop that a review looks for."""

_EXPECTED = ("p", "q", "r", "phi", "theta")
"""Loops that every autopilot closes: a log without their set-points lacks something."""

_FEEDFORWARDS: Mapping[Axis, tuple[str, ...]] = MappingProxyType(
    {
        "roll": ("MC_ROLLRATE_FF", "ATC_RAT_RLL_FF", "ATC_RAT_RLL_D_FF", "ff_weight[0]", "feedforward_weight[0]"),
        "pitch": ("MC_PITCHRATE_FF", "ATC_RAT_PIT_FF", "ATC_RAT_PIT_D_FF", "ff_weight[1]", "feedforward_weight[1]"),
        "yaw": ("MC_YAWRATE_FF", "ATC_RAT_YAW_FF", "ATC_RAT_YAW_D_FF", "ff_weight[2]", "feedforward_weight[2]"),
    }
)

_LED = ("phi", "theta")
"""Angles whose set-points an outer loop of velocity makes, in modes in which the autopilot flies."""

_OUTER_GAINS = ("MPC_XY_VEL_P_ACC", "PSC_VELXY_P", "PSC_NE_VEL_P")
"""Velocity error to acceleration, 1/s: the crossover of the outer loop, since an angle makes an acceleration of g."""

_OUTER_RAD_S, _OUTER_FACTOR = 3.0, 1.5
"""Crossover of an outer loop whose gain is not logged, and what position, integral and derivative add to it."""

_LOW_OCTAVES, _AT_ONE = 2.0, 0.35
"""At the lowest frequencies an angle loop is one; a set-point that its own feedback makes shows something else."""


def loops(flight: FlightData) -> tuple[dict[str, LoopReview], tuple[Unavailable, ...]]:
    """Every loop that a flight shows, and what it does not show of them.

    Parameters
    ----------
    flight
        The flight, by :func:`rotorid.flights.whole_flights.flown`.

    Returns
    -------
    dict, tuple of Unavailable
        Loops by the names of their states. A loop of which only the response is known has no step; one of which
        nothing is known is absent. ``Unavailable.what`` is ``loops.NAME`` or ``loops.NAME.NUMBER``.
    """
    found: dict[str, LoopReview] = {}
    unavailable: list[Unavailable] = []
    none: tuple[Finding, ...] = ()
    saturated, missing = section("loops.saturation", lambda: (_saturation(flight.record), ()), none)
    unavailable += missing
    for loop in LOOPS:
        review, missing = section(f"loops.{loop.name}", partial(loop_of, flight, loop), None)
        unavailable += missing
        if review is not None:
            found[loop.name] = replace(review, findings=(*review.findings, *saturated)) if loop.of_rates else review
    return found, tuple(unavailable)


def loop_of(flight: FlightData, loop: Loop) -> tuple[LoopReview | None, tuple[Unavailable, ...]]:
    """One loop of a flight, and what the flight does not show of it."""
    instrument, channel = flight.instrument(loop.axis, of_rates=loop.of_rates)
    why = _missing(flight, loop, instrument, channel)
    if why is not None and why.why and _autopilot_leads(flight, loop):
        instrument, channel, why = "setpoint", loop.reference, None
    if why is not None:
        return None, (why,) if why.why else ()
    return _measure_loop(flight, loop, instrument, channel)


def _missing(flight: FlightData, loop: Loop, instrument: Instrument, channel: str) -> Unavailable | None:
    """What keeps a loop from being looked at; without a reason where such a loop was not flown."""
    names, what = flight.record.channel_names, f"loops.{loop.name}"
    # In acro no loop controls the attitude; and nobody misses a velocity that is not controlled.
    flown_directly = flight.instrument("roll")[0] == "direct"
    if loop.reference not in names or loop.name not in names:
        if loop.name not in _EXPECTED or (flown_directly and not loop.of_rates):
            return Unavailable(what=what, why="")
        lacking = tuple(name for name in (loop.reference, loop.name) if name not in names)
        remedy = logging_advice(flight.record, 0.0, lacking)
        how = absence(flight.record, *lacking)
        return Unavailable(what=what, why=f"The {_lacking_words(loop, lacking)} {how}.", remedy=remedy)
    if flown_directly and not loop.of_rates:
        return Unavailable(what=what, why="")
    if not channel:
        return Unavailable(
            what=what,
            why=f"The {loop.axis} stick is not logged. {loop.reference} contains feedback, so the loop cannot be "
            "separated from the controller.",
            remedy=f"log the sticks at 5 Hz or more ({loop.axis}_stick)",
        )
    moved_s = flight.moving_s(channel, flight.during(instrument))
    if moved_s < LEAST_MOTION_S:
        moved = f"moved for only {moved_s:.0f} s" if moved_s >= 0.5 else "did not move"
        return Unavailable(
            what=what,
            why=f"{_words(channel)} {moved}.",
            remedy=move_stick(loop.axis),
        )
    return None


def _autopilot_leads(flight: FlightData, loop: Loop) -> bool:
    """Whether an outer loop moved the set-point of an angle for long enough, while the stick was idle.

    A rate set-point follows from the angle itself, so that it shows the controller; an angle set-point comes from an
    outer loop that is several times slower, so that its feedback has a bound (:func:`_with_feedback`).
    """
    if loop.name not in _LED or not {loop.name, loop.reference} <= set(flight.record.channel_names):
        return False
    return flight.moving_s(loop.reference) >= LEAST_MOTION_S


def _lacking_words(loop: Loop, lacking: Sequence[str]) -> str:
    if len(lacking) > 1:
        return f"{loop.words} and its set-point are"
    return f"{loop.words} set-point is" if loop.reference in lacking else f"{loop.words} is"


def _measure_loop(
    flight: FlightData, loop: Loop, instrument: Instrument, channel: str
) -> tuple[LoopReview | None, tuple[Unavailable, ...]]:
    sampled = () if channel == loop.reference else (channel,)
    intervals = flight.during(instrument)
    histories = flight.histories((loop.reference, loop.name), sampled=sampled, intervals=intervals)
    response = _response(flight, loop, channel, histories)
    if instrument == "setpoint":
        response = _with_feedback(response, outer_loop_rad_s(flight.record))
        if not _begins_at_one(response):
            return None, (_led_astray(loop),)
    usable = usable_points(response)
    omega = response.omega_rad_s
    if np.count_nonzero(usable) < 8:
        return None, (_incoherent(loop, channel, 0.0),)
    if sampled and loop.of_rates:
        response = _beyond_the_stick(flight, loop, channel, histories, response)
        usable = usable_points(response)
    scale = phase_crossing(omega[usable], response.values[0, 0][usable])
    coherence = _coherence(response, 0.5 * min(scale, float(omega[usable][-1])))
    if coherence < _LEAST_COHERENCE:
        return None, (_incoherent(loop, channel, coherence),)
    if sampled and _coherence(response, min(scale, float(omega[usable][-1]))) < _SURE_COHERENCE:
        # A stick that gusts nearly drown errs by more than noise explains.
        response = _doubted(response)
        usable = usable_points(response)
    logged_hz = min(flight.rate_hz(loop.reference), flight.rate_hz(loop.name))
    review = LoopReview(
        name=loop.name,
        reference=loop.reference,
        answer=loop.name,
        instrument=instrument,
        response=response,
        step=None,
        numbers={},
        band_rad_s=(float(omega[usable][0]), float(omega[usable][-1])),
        by_size=_by_size(flight, loop, instrument, channel, histories) if loop.of_rates else {},
        findings=(*_of_estimate(response, instrument), *_led_remarks(loop, instrument)),
    )
    # Where the phase stays above −90°, half of the rate that the band comes from would show more.
    beyond = not math.isfinite(scale) and logged_hz < _FAST_ENOUGH_HZ
    if beyond or logged_hz < RATE_FOR_BANDWIDTH * min(scale, 2.0 * float(omega[usable][-1])):
        # Rates that were logged so slowly are folded over themselves: not even the response is one.
        return None if loop.of_rates else review, (_too_slow(flight.record, loop, "", logged_hz, scale),)
    impulse = _impulse(response, usable, loop)
    numbers, unavailable = _numbers(flight, loop, impulse, response, logged_hz)
    stepped = "rise_time_s" in numbers or "overshoot_percent" in numbers
    review = replace(
        review,
        step=_curve(impulse, loop) if stepped else None,
        numbers=numbers,
        findings=(*review.findings, *_remarks(flight, loop, impulse)),
    )
    return review, tuple(unavailable)


def _response(flight: FlightData, loop: Loop, channel: str, histories: Sequence[TimeHistory]) -> FrequencyResponse:
    return loop_response(
        flight,
        reference=loop.reference,
        answer=loop.name,
        instrument=channel,
        slow=not loop.of_rates or loop.axis == "yaw",
        histories=histories,
    )


def outer_loop_rad_s(record: FlightRecord) -> float:
    """Frequency up to which an outer loop may feed the angle back into its set-point."""
    gains = [record.parameters[name] for name in _OUTER_GAINS if record.parameters.get(name, 0.0) > 0.0]
    return _OUTER_FACTOR * max(gains, default=_OUTER_RAD_S)


def _with_feedback(response: FrequencyResponse, outer_rad_s: float) -> FrequencyResponse:
    r"""A direct response of an angle to its set-point, with the bias that an outer loop may give it in its errors.

    With the disturbance :math:`d` of the angle, :math:`y = T r + S d` and :math:`r = r_0 - L_o y`, so that the direct
    estimate is off by

    .. math:: |\Delta T| = |S| \, |L_o S| \, \frac{S_{dd}}{S_{rr}}
        \le |L_o| \, |T|^2 \, \frac{1 - \gamma^2}{\gamma^2}, \qquad |L_o| \approx \omega_o / \omega

    with what the set-point does not explain of the angle, :math:`|S|^2 S_{dd} = (1 - \gamma^2) S_{yy}`, and the
    crossover :math:`\omega_o` of the outer loop. The bound is shared by neighbors: it does not average out.
    """
    omega, values = response.omega_rad_s, np.nan_to_num(response.values[0, 0])
    coherence = np.clip(np.nan_to_num(response.coherence[0, 0], nan=1e-3), 1e-3, 1.0)
    bias = np.abs(values) * (outer_rad_s / omega) * (1.0 - coherence) / coherence
    shared = bias * values
    distance = np.abs(np.subtract.outer(np.log(omega), np.log(omega)))
    covariance = response.covariance.copy()
    covariance[0, 0] += np.outer(shared, shared.conj()) * np.exp(-distance / SHARED_OVER)
    return replace(
        response,
        covariance=covariance,
        # A variance of the complex response is twice that of its magnitude.
        random_error=np.sqrt(response.random_error**2 + 0.5 * bias**2),
        processing=(*response.processing, f"errors with the bias of an outer loop of up to {outer_rad_s:.2g} rad/s"),
    )


def _begins_at_one(response: FrequencyResponse) -> bool:
    """Whether the response at the lowest frequencies is that of a loop that follows, and not of feedback alone."""
    omega = response.omega_rad_s
    low = usable_points(response) & (omega <= omega[0] * 2.0**_LOW_OCTAVES)
    if np.count_nonzero(low) < 3:
        return False
    return abs(complex(np.mean(response.values[0, 0][low])) - 1.0) < _AT_ONE


def _led_astray(loop: Loop) -> Unavailable:
    return Unavailable(
        what=f"loops.{loop.name}",
        why=f"No {loop.axis} stick moved in the log, and the set-point of the {loop.words} answers gusts: it shows the "
        "outer loop, not this one.",
        remedy=move_stick(loop.axis),
    )


def _of_estimate(response: FrequencyResponse, instrument: Instrument) -> Iterator[Finding]:
    """Remarks on the estimate; what they say of feedback is in the errors where an outer loop leads."""
    for finding in response.findings:
        if not (instrument == "setpoint" and finding.kind == "closed_loop_bias"):
            yield finding


def _led_remarks(loop: Loop, instrument: Instrument) -> Iterator[Finding]:
    if instrument == "setpoint":
        yield remark(
            "closed_loop_bias",
            f"{loop.name}/{loop.reference}",
            f"No {loop.axis} stick moved in the log: the set-point itself is the instrument of the {loop.words}. "
            "The intervals contain the largest bias by its outer loop.",
        )


def _beyond_the_stick(
    flight: FlightData, loop: Loop, channel: str, histories: Sequence[TimeHistory], joint: FrequencyResponse
) -> FrequencyResponse:
    """The joint response, and above what a slowly logged stick shows the direct one, where that agreed with it below.

    What feedback does to a direct response falls with frequency: gusts are slow, and so are the outer loops that put
    them into the set-point. Where both agree in the octave and a half below the end of the stick, the direct one is
    valid beyond it.
    """
    end_rad_s = _OF_STICK_RATE * np.pi * flight.rate_hz(channel)
    omega = joint.omega_rad_s
    if end_rad_s >= omega[-1]:
        return joint
    direct = _response(flight, loop, loop.reference, histories)
    errors = [np.nan_to_num(response.random_error[0, 0], nan=np.inf) for response in (joint, direct)]
    shared = (omega > _AGREED_FROM * end_rad_s) & (omega <= end_rad_s) & (np.maximum(*errors) < USABLE_ERROR)
    if np.count_nonzero(shared) < 3:
        return joint
    deviation = np.abs(direct.values[0, 0] / joint.values[0, 0] - 1.0)[shared] / np.hypot(*errors)[shared]
    if float(np.sqrt(np.mean(deviation**2))) > _AGREED:
        return joint
    beyond = (omega > end_rad_s) & (errors[1] < errors[0])
    inside = ~beyond
    covariance = joint.covariance.copy()
    covariance[0, 0] = np.where(np.outer(inside, inside), joint.covariance[0, 0], 0.0)
    covariance[0, 0] += np.where(np.outer(beyond, beyond), direct.covariance[0, 0], 0.0)
    return replace(
        joint,
        values=np.where(beyond, direct.values, joint.values),
        coherence=np.where(beyond, direct.coherence, joint.coherence),
        random_error=np.where(beyond, direct.random_error, joint.random_error),
        covariance=covariance,
        disturbance=None,
        processing=(
            *joint.processing,
            f"above {end_rad_s:.3g} rad/s, where {channel} was not logged fast enough, the direct estimate",
        ),
    )


def usable_points(response: FrequencyResponse) -> BoolArray:
    """Points of a single response that are known better than to 0.3 of their size, shape ``(f,)``."""
    error = response.random_error[0, 0]
    return np.asarray(np.isfinite(response.values[0, 0]) & np.isfinite(error) & (error < USABLE_ERROR))


def _impulse(response: FrequencyResponse, usable: BoolArray, loop: Loop) -> ImpulseResponse:
    return impulse_response(
        response.omega_rad_s[usable],
        response.values[0, 0][usable],
        response.covariance[0, 0][np.ix_(usable, usable)],
        horizon_s=loop.horizon_s,
    )


def _coherence(response: FrequencyResponse, omega_rad_s: float) -> float:
    """Coherence at a frequency, the mean of a few points about it."""
    near = np.abs(np.log(response.omega_rad_s / omega_rad_s)) < 0.2
    values = response.coherence[0, 0][near & np.isfinite(response.coherence[0, 0])]
    return float(values.mean()) if values.size else 0.0


def _doubted(response: FrequencyResponse) -> FrequencyResponse:
    return replace(
        response,
        covariance=_WEAK_STICK**2 * response.covariance,
        random_error=_WEAK_STICK * response.random_error,
        processing=(*response.processing, "errors doubled: the stick inputs are weak against gusts"),
    )


def _numbers(
    flight: FlightData, loop: Loop, impulse: ImpulseResponse, response: FrequencyResponse, logged_hz: float
) -> tuple[dict[str, Quantity], list[Unavailable]]:
    """The numbers that the rate of the log and the coherence carry, and those that they do not."""
    numbers = step_numbers(impulse, within_s=loop.within_s)
    bandwidth = numbers.get("bandwidth_90deg_rad_s")
    scale = impulse.scale_rad_s if bandwidth is None else bandwidth.value
    slow = logged_hz < RATE_FOR_STEP * scale
    unavailable = [_too_slow(flight.record, loop, "step", logged_hz, scale)] if slow else []
    quantities: dict[str, Quantity] = {}
    for name in figures_of("loops"):
        if slow and name not in ("delay_s", "bandwidth_90deg_rad_s"):
            continue
        if name in numbers and (name != "peak_db" or _coherent_peak(impulse, response)):
            quantities[name] = numbers[name]
        elif name != "peak_db":
            what, why = f"loops.{loop.name}.{name}", _why_unavailable(name, loop, impulse)
            unavailable.append(Unavailable(what=what, why=why, remedy=QUANTITIES[name].remedy))
    if logged_hz < _SLOW_LOG_HZ:
        quantities = _with_half_sample(quantities, impulse, 0.5 / logged_hz)
    return quantities, unavailable


def _too_slow(record: FlightRecord, loop: Loop, part: str, logged_hz: float, scale_rad_s: float) -> Unavailable:
    """What a log at too low a rate does not show: everything, or all but the phase."""
    step_hz, phase_hz = RATE_FOR_STEP * scale_rad_s, RATE_FOR_BANDWIDTH * scale_rad_s
    if not math.isfinite(scale_rad_s):
        needs = "That is too slow for this loop."
    elif part:
        needs = f"Step, −3 dB bandwidth and resonance of this loop need {step_hz:.0f} Hz."
    else:
        needs = f"Bandwidth and delay of this loop need {phase_hz:.0f} Hz, and its step {step_hz:.0f} Hz."
    # What an autopilot logs by itself is set by its own names.
    own = logging_advice(record, logged_hz) if autopilot_of(record).log.own else ""
    faster = f" at {step_hz:.0f} Hz or more" if math.isfinite(scale_rad_s) else " faster"
    return Unavailable(
        what=f"loops.{loop.name}.{part}".rstrip("."),
        why=f"The {loop.words} or its set-point is logged at only {logged_hz:.0f} Hz. {needs}",
        remedy=own or f"log the {loop.words} and set-point{faster}",
    )


def _why_unavailable(name: str, loop: Loop, impulse: ImpulseResponse) -> str:
    bound, top = bound_of_band(name, impulse.band_rad_s), impulse.band_rad_s[1]
    if name.startswith("bandwidth"):
        return f"The bandwidth of the {loop.words} is above {bound:.3g} rad/s, the end of the data."
    if bound is not None and _rise_s(impulse) < bound:
        return f"The {loop.words} rises in less than {1e3 * bound:.2g} ms; the data end at {top:.3g} rad/s."
    end = float(impulse.step()[np.searchsorted(impulse.time_s, loop.within_s) - 1])
    if name == "settling_time_s":
        return f"The {loop.words} does not settle within 5 %: after {loop.within_s:g} s it is at {end:.2f}."
    return f"The {loop.words} may not reach 90 % of its set-point: after {loop.within_s:g} s it is at {end:.2f}."


def _rise_s(impulse: ImpulseResponse) -> float:
    """From 0.1 to 0.9 of the step, to a cell of the response; infinite where it does not rise so far."""
    step = impulse.step()
    if not step.max() >= 0.9:
        return math.inf
    return float(impulse.time_s[np.argmax(step >= 0.9)] - impulse.time_s[np.argmax(step >= 0.1)])


def _coherent_peak(impulse: ImpulseResponse, response: FrequencyResponse) -> bool:
    """Whether the coherence at the resonance is high enough."""
    omega = np.geomspace(0.2 * impulse.scale_rad_s, impulse.band_rad_s[1], 200)
    return _coherence(response, float(omega[np.abs(impulse.at(omega)).argmax()])) > _NEAR_PEAK


def _with_half_sample(
    quantities: Mapping[str, Quantity], impulse: ImpulseResponse, half_s: float
) -> dict[str, Quantity]:
    """Numbers of which half a sample of the log more or less is not known."""
    wider = dict(quantities)
    if "delay_s" in quantities:
        wider["delay_s"] = _moved(quantities["delay_s"], half_s, half_s)
    if "bandwidth_90deg_rad_s" in quantities:
        omega = np.geomspace(0.2 * impulse.scale_rad_s, 2.0 * impulse.band_rad_s[1], 400)
        values, middle = impulse.at(omega), quantities["bandwidth_90deg_rad_s"].value
        ends = [phase_crossing(omega, values * np.exp(1j * sign * omega * half_s)) for sign in (-1.0, 1.0)]
        below, above = (abs(end - middle) if math.isfinite(end) else middle for end in ends)
        wider["bandwidth_90deg_rad_s"] = _moved(quantities["bandwidth_90deg_rad_s"], below, above)
    return wider


def _moved(quantity: Quantity, below: float, above: float) -> Quantity:
    """A number with errors of up to ``below`` and ``above`` that are as likely anywhere in between."""
    return replace(
        quantity,
        std=math.hypot(quantity.std, (below + above) / math.sqrt(12.0)),
        lower=max(quantity.lower - below, 0.0),
        upper=quantity.upper + above,
    )


def _curve(impulse: ImpulseResponse, loop: Loop) -> StepCurve:
    inside = impulse.time_s <= loop.within_s
    value, std = impulse.step()[inside], impulse.step_std[inside]
    rows = (impulse.time_s[inside], value, value - TWO_SIDED_95 * std, value + TWO_SIDED_95 * std)
    time_s, middle, lower, upper = (np.concatenate([[0.0], row]) for row in rows)
    return StepCurve(time_s=time_s, value=middle, lower=lower, upper=upper)


def _remarks(flight: FlightData, loop: Loop, impulse: ImpulseResponse) -> Iterator[Finding]:
    where = f"{loop.name}/{loop.reference}"
    if impulse.misfit > _MOST_MISFIT:
        yield warn(
            "structure_error",
            where,
            f"The {loop.words} loop is not linear: the best linear response misses the measured one by "
            f"{math.sqrt(impulse.misfit):.1f} standard deviations. Its intervals were widened by that factor.",
            misfit=impulse.misfit,
        )
    if flat_near_3db(impulse):
        yield remark(
            "flat_bandwidth",
            where,
            f"The {loop.words} response is flat near −3 dB, so that bandwidth is vague. Use the one at −90°.",
        )
    forward = {name: flight.record.parameters.get(name, 0.0) for name in _FEEDFORWARDS.get(loop.axis, ())}
    if loop.of_rates and (used := [name for name, value in forward.items() if value]):
        yield remark(
            "feedforward",
            where,
            f"{used[0]} is {forward[used[0]]:g}, so response and step include feed-forward, not feedback alone.",
            value=forward[used[0]],
        )


def _saturation(record: FlightRecord) -> tuple[Finding, ...]:
    """A warning where motors were often at their limits."""
    limits = motor_limits(record)
    if not limits.share > _SATURATED_SHARE:
        return ()
    then = "This made the loops weaker than they are with unsaturated motors."
    return (limits.finding(warn, then=then),)


def _by_size(
    flight: FlightData, loop: Loop, instrument: Instrument, channel: str, histories: Sequence[TimeHistory]
) -> dict[str, LoopReview]:
    """The loop where its set-point moves little and much, where both were flown for long enough."""
    parts = _parts_by_size(loop, histories)
    if parts is None:
        return {}
    found = {}
    for name, chosen in parts.items():
        try:
            response = _response(flight, loop, channel, chosen)
        except InsufficientDataError:
            return {}
        usable = usable_points(response)
        if np.count_nonzero(usable) < 8:
            return {}
        omega = response.omega_rad_s[usable]
        crossing = _phase_bandwidth(omega, response.values[0, 0][usable], response.random_error[0, 0][usable])
        if crossing is None:
            return {}
        found[name] = LoopReview(
            name=loop.name,
            reference=loop.reference,
            answer=loop.name,
            instrument=instrument,
            response=response,
            step=None,
            numbers={"bandwidth_90deg_rad_s": crossing},
            band_rad_s=(float(omega[0]), float(omega[-1])),
        )
    return found


def _phase_bandwidth(omega: FloatArray, values: ComplexArray, error: FloatArray) -> Quantity | None:
    """Where the phase falls to −90°, with the error that the phase and its slope there give it."""
    crossing = phase_crossing(omega, values)
    if not math.isfinite(crossing):
        return None
    near = np.abs(np.log(omega / crossing)) < 0.4
    if np.count_nonzero(near) < 3:
        return None
    slope = float(np.polyfit(np.log(omega[near]), np.unwrap(np.angle(values))[near], 1)[0])
    if slope >= 0.0:
        return None
    std = crossing * float(np.median(error[near])) / -slope
    return Quantity.normal(crossing, std, "rad/s")


def _parts_by_size(loop: Loop, histories: Sequence[TimeHistory]) -> dict[str, list[TimeHistory]] | None:
    """Stretches of 6 s and more with small and with large set-points, each 30 s and more together."""
    rate_hz = histories[0].sample_rate_hz
    size = max(round(_SIZE_WINDOW_S * rate_hz), 1)
    levels = []
    for history in histories:
        motion = history[loop.reference] - history[loop.reference].mean()
        levels.append(np.sqrt(np.convolve(motion**2, np.full(size, 1.0 / size), mode="same")))
    middle = float(np.median(np.concatenate(levels)))
    sizes: dict[str, list[TimeHistory]] = {"small set-points": [], "large set-points": []}
    power = dict.fromkeys(sizes, 0.0)
    for history, level in zip(histories, levels, strict=True):
        large = level > middle
        edges = np.concatenate([[0], np.flatnonzero(np.diff(large)) + 1, [large.size]])
        for begin, end in pairwise(edges.tolist()):
            if end - begin < _STRETCH_S * rate_hz:
                continue
            name = "large set-points" if large[begin] else "small set-points"
            part = replace(
                history, values=history.values[:, begin:end], start_s=history.start_s + float(begin) / rate_hz
            )
            sizes[name].append(part)
            power[name] += float(np.sum(level[begin:end] ** 2))
    lengths = {name: sum(part.duration_s for part in parts) for name, parts in sizes.items()}
    if min(lengths.values()) < _LEAST_OF_SIZE_S:
        return None
    small, large_rms = (math.sqrt(power[name] / lengths[name]) for name in sizes)
    return sizes if large_rms > _LEAST_SIZE_RATIO * small else None


def _incoherent(loop: Loop, channel: str, coherence: float) -> Unavailable:
    return Unavailable(
        what=f"loops.{loop.name}",
        why=f"{_words(channel)} explains too little of the {loop.words} (coherence {coherence:.2f}, needs "
        f"{_LEAST_COHERENCE}).",
        remedy=move_stick(loop.axis),
    )


def _words(channel: str) -> str:
    axis, _, kind = channel.partition("_")
    return f"The {axis} stick" if kind == "stick" else channel
