"""Models that do not hold: what a structure cannot follow is left out, and what is wrong all the same is refused.

A fit ends with numbers whatever the data are. No number leaves where it came to no rest, where the main response to an
input is not described, where a pole lies beyond the sample rate, or where a value is none that a vehicle can have.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.display import listed
from rotorid.data.findings import Finding, refusal, warn
from rotorid.data.quantity import with_error
from rotorid.data.trust import ACCEPTABLE_COST, CERTAIN_SIGN
from rotorid.errors import InsufficientDataError
from rotorid.fits.data_requirements import main_pairs
from rotorid.fits.frequency.fit import FrequencyFit, fit_with_bounds
from rotorid.fitting.frequency.problem import DB_PER_NEPER, DEG_PER_RAD, FrequencyProblem, log_error, pair_names
from rotorid.fitting.frequency.screening import (
    above_speed_modes,
)
from rotorid.flights.measure import Measured
from rotorid.models.families import family_of, lacks_speed_modes
from rotorid.models.state_space import StateSpace
from rotorid.settings.identifying import FIRST_RESPONSES, IdentifySettings
from rotorid.uncertainty.model_error import LARGEST_MODEL_ERROR

WORST_PAIR_COST = 150.0
"""Cost above which a response may be left out, if it is also off by one of the deviations below."""

LONGEST_SPIN_UP_S = 1.0
"""Angular momentum of a rotor over twice its torque is 0.05 to 0.3 s; a second is none."""

LARGEST_DEVIATION_DB, LARGEST_DEVIATION_DEG = 2.0, 15.0
"""Root mean squares of a model over a response, in magnitude and phase, that still count as described."""

_LEFT_OUT_SHARE = 1.0 / 3.0
"""Of the responses at most: where more are not described, the structure does not hold at all."""


def fit_or_refuse(problem: FrequencyProblem, measured: Measured, settings: IdentifySettings) -> FrequencyFit:
    """Fit as :func:`fit_with_bounds` does, leave out what the structure cannot follow, and refuse what does not hold.

    A response that costs more than 150 and is off by more than 2 dB or 15°, as root mean squares, is left out with a
    finding, unless it is the main response to its input or they are more than a third, of several inputs. What is left
    must have converged, with an average cost of at most 100 and no pole that a sample could not show. A rate model that
    does not hold in a band that nobody chose is fitted above the speed modes of the airframe, which it has no place
    for, if it holds there.

    Raises
    ------
    InsufficientDataError
        The model does not describe what it was fitted to; its findings say why.
    """
    fitted, reasons = _with_reasons(problem, measured, settings)
    if not reasons:
        return fitted
    if lacks_speed_modes(problem.structure) and settings.band_rad_s is None:

        def tried(part: FrequencyProblem) -> tuple[FrequencyFit, float]:
            found, against = _with_reasons(part, measured, settings)
            return found, math.inf if against else found.average_cost

        above = above_speed_modes(problem, tried)
        if above is not None:
            return _without_speed_modes(above, fitted)
    name = problem.structure.name
    raise InsufficientDataError(
        f"{name} does not describe these flights: " + " ".join(reason.message for reason in reasons),
        remedy="use a model with the missing dynamics, narrow --band, or choose responses with --pair",
        findings=reasons,
    )


def _with_reasons(
    problem: FrequencyProblem, measured: Measured, settings: IdentifySettings
) -> tuple[FrequencyFit, list[Finding]]:
    """The fit without responses that the structure cannot follow, and what speaks against it all the same.

    What is left out is decided with all parameters: a model that was reduced to follow such a response follows none.
    """
    whole = replace(settings, reduce=False)
    fitted = everything = fit_with_bounds(problem, measured, whole)
    main, left_out = main_pairs(problem), dict[tuple[int, int], Finding]()
    may_go = int(np.count_nonzero(problem.used.any(axis=-1)) * _LEFT_OUT_SHARE)
    while poor_pairs := {place: finding for place, finding in _poor_pairs(fitted).items() if place not in main}:
        gone = left_out | poor_pairs
        # What one input does beside its own axis may go whole: in wind a vehicle that yaws is pushed in ways that no
        # model of hover has.
        if len(gone) > may_go and len({u for _, u in gone}) > 1:
            break
        used = np.array(problem.used)
        for place in poor_pairs:
            used[place] = False
        smaller = replace(problem, used=used)
        try:
            fitted = fit_with_bounds(smaller, measured, whole)
        except InsufficientDataError:
            # Without them nothing shows some parameters: what is not described is what they were needed for.
            break
        problem, left_out = smaller, gone
    if settings.reduce:
        fitted = fit_with_bounds(problem, measured, settings)
    findings = (replace(finding, message=f"{finding.message} It was left out.") for finding in left_out.values())
    fitted = replace(fitted, findings=(*findings, *fitted.findings))
    if left_out:
        fitted = _with_ties_of(everything, fitted)
    poor = _poor_pairs(fitted)
    return fitted, [replace(finding, severity="error") for finding in poor.values()] + _reasons_to_refuse(fitted)


def _with_ties_of(everything: FrequencyFit, fitted: FrequencyFit) -> FrequencyFit:
    """The fit with what contradicted its ties before those responses went that showed it."""
    against = [test for test in everything.ties if test.contradicted]
    known = {finding.where for finding in fitted.findings if finding.kind == "tie_contradicted"}
    more = [f for f in everything.findings if f.kind == "tie_contradicted" and f.where not in known]
    covariance = fitted.bounds.covariance.copy()
    values = fitted.parameters.values
    for test in against:
        if test.name in known:
            continue
        there = everything.final.theta + test.released
        free = dict(zip(everything.bounds.names, there.tolist(), strict=True))
        moved = np.array([free.get(name, values[name]) - values[name] for name in fitted.bounds.names])
        covariance += np.outer(moved, moved)
    bounds = replace(fitted.bounds, covariance=covariance)
    return replace(fitted, bounds=bounds, findings=(*fitted.findings, *more))


def _without_speed_modes(above: FrequencyFit, whole: FrequencyFit) -> FrequencyFit:
    name = above.problem.structure.name
    cost, before, low = above.average_cost, whole.average_cost, above.band_rad_s[0]
    finding = warn(
        "speed_modes_left_out",
        name,
        f"Below {low:.2g} rad/s the vehicle's speed affects rotation, which {name} does not model: fitted to "
        f"everything the cost is {before:.0f}, above that frequency {cost:.0f} ({ACCEPTABLE_COST:g} is "
        "acceptable). Only that part was fitted. An axis or hover model describes both.",
        low_rad_s=low,
        average_cost=cost,
        whole_cost=before,
    )
    return replace(above, findings=(finding, *above.findings))


def _poor_pairs(fitted: FrequencyFit) -> dict[tuple[int, int], Finding]:
    """Responses that the model does not describe, with a warning each."""
    problem, costs = fitted.problem, fitted.costs
    values = problem.parameters.unpack(fitted.final.theta).values
    model = problem.structure.response(values, problem.data.omega_rad_s)
    names = np.array(pair_names(problem.data)).reshape(costs.shape)
    poor = {}
    for y, u in np.argwhere((costs > WORST_PAIR_COST) & problem.used.any(axis=-1)).tolist():
        used = problem.used[y, u]
        error = log_error(model[y, u, used], problem.data.values[y, u, used])
        off_db = DB_PER_NEPER * float(np.sqrt(np.mean(error.real**2)))
        off_deg = DEG_PER_RAD * float(np.sqrt(np.mean(error.imag**2)))
        if off_db > LARGEST_DEVIATION_DB or off_deg > LARGEST_DEVIATION_DEG:
            poor[y, u] = warn(
                "structure_error",
                str(names[y, u]),
                f"The model misses {names[y, u]} by {off_db:.1f} dB and {off_deg:.0f}° (cost {costs[y, u]:.0f}).",
                cost=float(costs[y, u]),
                off_db=off_db,
                off_deg=off_deg,
            )
    return poor


def _reasons_to_refuse(fitted: FrequencyFit) -> list[Finding]:
    problem, name = fitted.problem, fitted.problem.structure.name
    # With errors that go together the values are those of a second fit.
    reasons = [
        refusal("not_converged", name, f"The fit did not converge: {ended.value}")
        for ended in dict.fromkeys(one.outcome for one in (fitted.solution, fitted.final) if not one.settled)
    ]
    reasons += faster_than_sampled(name, fitted.system, problem.data.sample_rate_hz)
    reasons += _led_by_feedback(fitted)
    reasons += _endless_spin_up(fitted)
    reasons += _pushed_on_by_speed(fitted)
    if fitted.average_cost > ACCEPTABLE_COST:
        message = f"The average cost is {fitted.average_cost:.0f}, above the acceptable {ACCEPTABLE_COST:g}."
        reasons.append(refusal("poor_fit", name, message, average_cost=fitted.average_cost))
    return reasons


def faster_than_sampled(
    name: str, system: StateSpace, sample_rate_hz: float | None, outputs: Sequence[str] = ()
) -> Iterator[Finding]:
    """A pole that no sample shows: a lag that is not there, such as the second one of what is of first order.

    With the names of the outputs, the finding is on those that the pole moves, if others are free of it.
    """
    A, _, C, _ = system.proper()
    poles, modes = np.linalg.eig(A)
    fastest = float(np.abs(poles).max(initial=0.0))
    if sample_rate_hz is not None and fastest > 2.0 * np.pi * sample_rate_hz:
        moved = np.abs(C @ modes[:, np.argmax(np.abs(poles))])
        own = [one for one, size in zip(outputs, moved, strict=False) if size > _TRACE * moved.max()]
        part = listed(own) if own and len(own) < len(outputs) else ""
        message = (
            f"The model {f'of {part} ' if part else ''}has a pole at {fastest:.3g} rad/s "
            f"({fastest / (2.0 * np.pi):.3g} Hz), above the sample rate of {sample_rate_hz:.3g} Hz, so the data "
            "cannot show it."
        )
        where = f"{name}: {part}" if part else name
        yield refusal("impossible_physics", where, message, pole_rad_s=fastest, sample_rate_hz=sample_rate_hz)


_TRACE = 1e-3
"""Of the largest output of a mode: outputs with less are free of it."""

_NO_MODEL = 0.99
"""Of the largest model error, where the search for it ended at its limit."""


def _led_by_feedback(fitted: FrequencyFit) -> Iterator[Finding]:
    """The finding on a direct estimate with the largest model error: part of it is the controller, not the vehicle."""
    problem, found = fitted.problem, fitted.bounds.model_error
    if problem.data.estimate != "direct" or found is None:
        return
    names = np.array(pair_names(problem.data)).reshape(problem.used.shape[:2])
    for name in (str(names[place]) for place in main_pairs(problem)):
        share = found.sizes.get(name, 0.0)
        if share >= _NO_MODEL * LARGEST_MODEL_ERROR:
            message = (
                f"The model misses {name} by {100.0 * share:.0f} % or more. It was estimated without an "
                "instrument, so feedback biases it toward the inverse of the controller."
            )
            yield refusal("structure_error", name, message, model_error_percent=100.0 * share)


def _endless_spin_up(fitted: FrequencyFit) -> Iterator[Finding]:
    """A reaction to the spin-up of rotors that lasts longer than any rotor turns against its drag."""
    values = fitted.parameters.values
    if not values.get("N_spin") or not values.get("N_yaw"):
        return
    lead_s = values["N_spin"] / values["N_yaw"]
    if lead_s > LONGEST_SPIN_UP_S:
        yield refusal(
            "impossible_physics",
            "N_spin",
            f"N_spin is {lead_s:.2g} s of N_yaw, longer than any rotor reacts ({LONGEST_SPIN_UP_S:g} s). Damping "
            "plus motor lag explain this response equally well: leave it out with --fix N_spin=0.",
            lead_s=lead_s,
        )


def _pushed_on_by_speed(fitted: FrequencyFit) -> Iterator[Finding]:
    """Air slows a hovering vehicle: a force along its speed is what another axis did to this one."""
    if not family_of(fitted.problem.structure).slowed_by_air:
        return
    deviations = dict(zip(fitted.bounds.names, fitted.bounds.std.tolist(), strict=True))
    for name in FIRST_RESPONSES:
        value, std = fitted.parameters.values.get(name, 0.0), deviations.get(name, math.inf)
        if value > CERTAIN_SIGN * std:
            yield refusal(
                "impossible_physics",
                name,
                f"{name} is {with_error(value, std)} 1/s, but air cannot push a hovering vehicle along its own "
                "speed. The model misses a rotation or a speed that was not measured: use a hover model, or set "
                "the value with --fix.",
                value=value,
                std=std,
            )
