"""Findings on a fit of the physics of flight."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from rotorid.data.axes import AXIS_WORDS
from rotorid.data.display import listed
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.quantity import with_error
from rotorid.fits.flight.fit import mean_force_findings
from rotorid.fits.flight.fitted import FittedFlight
from rotorid.fits.motors.remarks import scale_finding, unused_choices
from rotorid.fitting.motors.excitation import LEAST_CORRELATION
from rotorid.flights.flight_faults import wind_or_bias
from rotorid.models.flight import FLIGHT_PARAMETERS, INERTIA
from rotorid.models.physical import check_inertia
from rotorid.settings.motors import MotorSettings

_GOOD_PERCENT = 50.0
"""Of the motion of an axis: where the model explains less, that is remarked on."""

_FAST_M_S = 3.0
"""Airspeed along the discs from which a velocity that was integrated from attitude counts as a guess."""


def judge_flight(
    identified: FittedFlight, choices: MotorSettings, fit_percent: Mapping[str, float]
) -> tuple[Finding, ...]:
    """Remarks on what was assumed, what stays undetermined, and what physics does not allow."""
    return (
        *_scale(identified),
        *_disc(identified),
        *_curve(identified),
        *_velocity(identified),
        *_wind(identified),
        *_by_tilt(identified),
        *_missing(identified),
        *_torque(identified),
        *_yaw(identified, choices.known),
        *_unused(identified, choices.known),
        *_physics(identified),
        *_scatter(identified),
        *_poor(fit_percent),
    )


def _scale(identified: FittedFlight) -> Iterator[Finding]:
    if not identified.data.given.scaled:
        yield scale_finding("thrust, drag and inertia")


def _disc(identified: FittedFlight) -> Iterator[Finding]:
    given = identified.data.given
    if not given.disc_assumed:
        return
    what = (
        f"The rotor diameter was assumed: {given.diameter_m:.2g} m, from the distance between the rotors"
        if given.scaled
        else "Disc loading was assumed, as mass and rotor diameter are unknown"
    )
    yield remark(
        "assumed_disc",
        "rotor diameter",
        f"{what}. Inflow depends on it, and an error mostly changes c_lambda. Give --rotor-diameter METERS"
        f"{'' if given.scaled else ' and --fix m=KILOGRAMS'}.",
        diameter_m=given.diameter_m,
    )


def _curve(identified: FittedFlight) -> Iterator[Finding]:
    """That demands of thrust were taken as shares of the speed, where the flight shows no curve."""
    if identified.data.motors.straightened and "c_1" not in identified.fit.values:
        yield warn(
            "assumed_curve",
            "thrust",
            "The log has thrust demands, which thrust follows in a line. It varied too little to show that, so it was "
            "fitted with their square: its slope in hover and the inertia may be up to twice the true ones. Fly "
            "climbs, log motor speeds, or use physical.motors for thrust and inertia.",
        )


def _velocity(identified: FittedFlight) -> Iterator[Finding]:
    fit, where = identified.fit, ", ".join(dict.fromkeys(identified.fit.records))
    if fit.velocity == "attitude":
        yield remark(
            "velocity_from_attitude",
            where,
            "No velocity is logged: it was integrated from attitude and accelerometer, which forget a steady speed "
            "within seconds. Wind cannot be found. Log the velocity of GPS, EKF or motion capture.",
            fastest_m_s=fit.tested.edge[1],
        )
    if fit.velocity == "none":
        yield warn(
            "velocity_from_attitude",
            where,
            "Neither velocity nor attitude is logged, so drag and inflow are missing: the numbers hold about hover "
            "only. Log the attitude.",
        )


def _wind(identified: FittedFlight) -> Iterator[Finding]:
    """That wind and a bias of the accelerometer look alike, of logs of which a stretch hardly turned."""
    fit = identified.fit
    turned: dict[str, float] = {}
    for flight, wind in zip(identified.data.motors.stretches, fit.winds, strict=True):
        if fit.velocity == "measured" and np.isfinite(wind).all() and np.any(wind):
            name, own = flight.record.name, float(np.ptp(np.unwrap(flight.record.attitude[2])))
            turned[name] = min(own, turned.get(name, own))
    for name, least in turned.items():
        yield from wind_or_bias(least, name)


def _by_tilt(identified: FittedFlight) -> Iterator[Finding]:
    if (drag := identified.by_tilt) is not None:
        yield remark(
            "drag_by_tilt",
            "k_d",
            f"The flights are too slow to fit k_d by least squares, so it was estimated with the tilt as instrument: "
            f"drag {with_error(drag.value, drag.std)} 1/s.",
            drag_1_s=drag.value,
            std_1_s=drag.std,
        )


_NEEDED = {"p": ("I_xx",), "q": ("I_yy",), "r": ("I_zz", "kappa", "J_r")}
"""Rate to the numbers that its torque gives."""


def _missing(identified: FittedFlight) -> Iterator[Finding]:
    """Terms that no flight shows, those of one reason together; those of a torque are said with its axis."""
    # What was assumed of yaw is said with it.
    silent = {name for axis in _silent(identified) for name in _NEEDED[axis]} | {"I_zz"}
    reasons: dict[str, list[str]] = {}
    for term, why in identified.fit.missing.items():
        if term not in silent:
            reasons.setdefault(why, []).append(term)
    for why, terms in reasons.items():
        words = listed([f"{term} ({FLIGHT_PARAMETERS[term].about})" for term in terms])
        yield remark("flight_terms_missing", ", ".join(terms), f"Not enough data for {words}: {why.rstrip('.')}.")


def _silent(identified: FittedFlight) -> tuple[str, ...]:
    """Rates that the motors were compared with, and do not explain in any octave."""
    octaves = identified.fit.octaves
    return tuple(
        axis
        for axis in _NEEDED
        if any(octave.axis == axis for octave in octaves)
        and not any(octave.axis == axis and octave.kept for octave in octaves)
    )


def _torque(identified: FittedFlight) -> Iterator[Finding]:
    """Axes that the motors do not explain, and those that they explain in some octaves alone."""
    silent = _silent(identified)
    for axis, names in _NEEDED.items():
        own = [octave for octave in identified.fit.octaves if octave.axis == axis]
        word = AXIS_WORDS[axis]
        table = ", ".join(f"{octave.low_hz:g}–{octave.high_hz:g} Hz {octave.correlation:.2f}" for octave in own)
        if axis in silent:
            best = max(own, key=lambda octave: octave.correlation)
            single = best.correlation >= LEAST_CORRELATION
            why = (
                f"single octaves reach {LEAST_CORRELATION:g}, but no two neighbors with the same delay"
                if single
                else f"no octave reaches {LEAST_CORRELATION:g}"
            )
            yield warn(
                "no_excitation",
                word,
                f"Not enough data for {listed(names[:2])}: {word} was not excited enough. In the correlation of motors "
                f"and motion, {why} ({table}). Without excitation, the motors show the controller, not the vehicle. "
                "Fly a sweep, doublets or sharp maneuvers.",
                correlation=best.correlation,
            )
        elif any(not octave.kept for octave in own):
            fitted = [octave for octave in own if octave.kept]
            named = next((name for name in names if name in identified.fit.free), names[0])
            low, high = min(octave.low_hz for octave in fitted), max(octave.high_hz for octave in fitted)
            yield remark(
                "torque_band",
                word,
                f"{named} was fitted from {low:g} to {high:g} Hz, where the motors explain {word} (correlation: "
                f"{table}). Below and above, the controller and the air make motor torque look too small.",
                low_hz=low,
                high_hz=high,
            )


def _yaw(identified: FittedFlight, known: Mapping[str, float]) -> Iterator[Finding]:
    if "I_zz" in identified.assumed and "kappa" in identified.parameters.names:
        yield remark(
            "not_identifiable",
            "kappa, I_zz",
            "Yaw determines only kappa over I_zz. I_zz was assumed to be I_xx + I_yy, as for a flat vehicle; kappa and "
            "J_r scale with it. Give --fix kappa=METERS from a bench, or --fix I_zz=VALUE.",
        )
        return
    if "r" in _silent(identified) or {"kappa", "I_zz"} & {*known, *identified.parameters.names}:
        return
    if not any(octave.axis == "r" for octave in identified.fit.octaves):
        return
    yield remark(
        "not_identifiable",
        "kappa, I_zz",
        "Yaw determines only kappa over I_zz. Give --fix kappa=METERS from a bench, or --fix I_zz=VALUE.",
    )


def _unused(identified: FittedFlight, known: Mapping[str, float]) -> Iterator[Finding]:
    """Values that no equation took, but those of an axis that is known not to be explained."""
    silent = {name for axis in _silent(identified) for name in _NEEDED[axis]}
    rest = {name: value for name, value in known.items() if name not in silent}
    yield from unused_choices(rest, identified.parameters.names)


def _physics(identified: FittedFlight) -> Iterator[Finding]:
    yield from mean_force_findings(identified)
    values = identified.parameters.values
    if set(INERTIA.values()) <= set(values):
        yield from check_inertia(*(values[name] for name in INERTIA.values()))


def _scatter(identified: FittedFlight) -> Iterator[Finding]:
    errors = identified.fit.errors
    if errors is not None and errors.how != "assumed":
        return
    shares = ", ".join(
        f"{name} {100.0 * parameter.scatter:.3g} %"
        for name, parameter in FLIGHT_PARAMETERS.items()
        if name in identified.bounds.names
        and name not in identified.assumed
        and parameter.scatter is not None
        and not parameter.absolute
    )
    yield remark(
        "assumed_scatter",
        "errors",
        f"One flight does not show how the numbers scatter between flights; the usual scatter was assumed ({shares}). "
        "Fly again at another speed and identify both flights together.",
    )


def _poor(fit_percent: Mapping[str, float]) -> Iterator[Finding]:
    for name, percent in fit_percent.items():
        if percent < _GOOD_PERCENT:
            message = f"The model explains only {percent:.0f} % of {name} up to 5 Hz."
            yield warn("poor_fit", name, message, fit_percent=percent)
