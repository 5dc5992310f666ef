"""Findings on a fit of the physics of flight."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from rotorid.data.axes import AXIS_WORDS
from rotorid.data.display import listed
from rotorid.data.findings import Finding, remark, warn
from rotorid.fits.flight.fit import mean_force_findings
from rotorid.fits.flight.fitted import FittedFlight
from rotorid.fits.motors.remarks import scale_finding, unused_choices
from rotorid.models.flight import FLIGHT_PARAMETERS
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
        *_velocity(identified),
        *_missing(identified),
        *_torque(identified),
        *_yaw(identified),
        *unused_choices(choices.known, identified.parameters.names),
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
        f"The rotor diameter was assumed, {given.diameter_m:.2g} m by the distance of the rotors"
        if given.scaled
        else "Disc loading was assumed, as mass and rotor diameter are unknown"
    )
    yield remark(
        "assumed_disc",
        "rotor diameter",
        f"{what}. Inflow depends on it, and c_lambda takes up most of an error. Give --rotor-diameter METERS"
        f"{'' if given.scaled else ' and --fix m=KILOGRAMS'}.",
        diameter_m=given.diameter_m,
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


def _missing(identified: FittedFlight) -> Iterator[Finding]:
    """Terms that no flight shows, those of one reason together."""
    reasons: dict[str, list[str]] = {}
    for term, why in identified.fit.missing.items():
        reasons.setdefault(why, []).append(term)
    for why, terms in reasons.items():
        words = listed(
            [f"{term} ({FLIGHT_PARAMETERS[term].about})" if term in FLIGHT_PARAMETERS else term for term in terms]
        )
        yield remark("flight_terms_missing", ", ".join(terms), f"Not enough data for {words}: {why.rstrip('.')}.")


_INERTIA = {"p": "I_xx", "q": "I_yy", "r": "I_zz"}


def _torque(identified: FittedFlight) -> Iterator[Finding]:
    """Axes that the motors do not explain, and those that they explain in some octaves alone."""
    octaves = identified.fit.octaves
    for axis, name in _INERTIA.items():
        own = [octave for octave in octaves if octave.axis == axis]
        if not own:
            continue
        word, best = AXIS_WORDS[axis], max(own, key=lambda octave: octave.correlation)
        table = ", ".join(f"{octave.low_hz:g}–{octave.high_hz:g} Hz {octave.correlation:.2f}" for octave in own)
        fitted = [octave for octave in own if octave.kept]
        if not fitted:
            yield warn(
                "no_excitation",
                word,
                f"Not enough data for {name}: the motors explain {word} in no octave with a correlation of 0.8 "
                f"({table}). Elsewhere the motors show the controller, not the vehicle. Fly a sweep, doublets or "
                "sharp maneuvers.",
                correlation=best.correlation,
            )
        elif len(fitted) < len(own):
            low, high = min(octave.low_hz for octave in fitted), max(octave.high_hz for octave in fitted)
            yield remark(
                "torque_band",
                word,
                f"{name} is from {low:g} to {high:g} Hz, where the motors explain {word} ({table}). Below and above, "
                "the controller and the air would make the torque of the motors look smaller than it is.",
                low_hz=low,
                high_hz=high,
            )


def _yaw(identified: FittedFlight) -> Iterator[Finding]:
    names = set(identified.parameters.names)
    if {"kappa", "I_zz"} <= names or not {"I_xx", "I_yy"} & names:
        return
    yield remark(
        "not_identifiable",
        "kappa, I_zz",
        "Yaw determines only kappa over I_zz. Give --fix kappa=METERS from a bench, or --fix I_zz=VALUE.",
    )


def _physics(identified: FittedFlight) -> Iterator[Finding]:
    yield from mean_force_findings(identified)
    values = identified.parameters.values
    if set(_INERTIA.values()) <= set(values):
        yield from check_inertia(*(values[name] for name in _INERTIA.values()))


def _scatter(identified: FittedFlight) -> Iterator[Finding]:
    errors = identified.fit.errors
    if errors is not None and errors.how != "assumed":
        return
    shares = ", ".join(
        f"{name} {100.0 * parameter.scatter:.3g} %"
        for name, parameter in FLIGHT_PARAMETERS.items()
        if name in identified.bounds.names and parameter.scatter is not None and not parameter.absolute
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
