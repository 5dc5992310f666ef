"""Whether measured responses can support a model at all: the refusals, each with its reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.findings import Finding, refusal
from rotorid.data.quantity import with_error
from rotorid.data.trust import CERTAIN_SIGN, LEAST_WIDTH, LOWEST_TOP_RAD_S, SMALL_ERROR
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.flights.measure import Measured
from rotorid.flights.supports import nothing_above
from rotorid.models.library import RATE_AXES
from rotorid.models.parameter import ParameterSet
from rotorid.typing import BoolArray
from rotorid.uncertainty.cramer_rao import (
    Bounds,
)


def require_support(
    measured: Measured, used: BoolArray, *, least_coherence: float, rate_model: bool, chosen: bool = True
) -> None:
    """Refuse a fit where the data end below, or hold less than, what the model needs.

    Parameters
    ----------
    used
        Points that can be trusted, shape ``(y, u, f)``.
    least_coherence
        The limit by which they were chosen.
    rate_model
        Whether the model needs data above the speed modes.
    chosen
        Whether the user gave the band; else it ends where the log does.

    Raises
    ------
    UsageError
        The band that the user gave cannot do.
    InsufficientDataError
        The excitation or the coherence ends too early, or what is left is too narrow.
    """
    low, high = measured.asked_rad_s
    needed = max(low, LOWEST_TOP_RAD_S) if rate_model else low
    if measured.excited_to_rad_s < needed:
        raise _not_excited(measured, needed)
    if high < needed and not chosen:
        raise _logged_too_slowly(measured, high, needed)
    if high < needed:
        raise UsageError(
            f"the band {low:g}:{high:g} rad/s ends below the {needed:g} rad/s that a rate model needs",
            needed="a band above the speed modes of the airframe, such as 1:60",
            remedy="widen --band",
        )
    omega = measured.response.omega_rad_s[used.any(axis=(0, 1))]
    if omega.size == 0:
        raise _not_coherent(measured, least_coherence)
    if omega[-1] < needed or omega[-1] < LEAST_WIDTH * omega[0]:
        raise _too_narrow(measured, float(omega[0]), float(omega[-1]), needed)


def _name(measured: Measured) -> str:
    return f"{measured.response.outputs[0]}/{measured.response.inputs[0]}"


def _logged_too_slowly(measured: Measured, high: float, needed: float) -> InsufficientDataError:
    message = f"At the logged rate {_name(measured)} can be measured only up to {high:.3g} rad/s."
    return InsufficientDataError(
        f"at the logged rate {_name(measured)} can be measured only up to {high:.3g} rad/s",
        needed=f"at least {needed:g} rad/s, above the speed modes of the airframe",
        remedy="log rates and commands faster",
        findings=[refusal("rate_too_low", _name(measured), message)],
    )


def _not_excited(measured: Measured, needed: float) -> InsufficientDataError:
    name, top = _name(measured), measured.excited_to_rad_s
    return InsufficientDataError(
        f"{nothing_above(top)} in {name}",
        needed=f"excitation up to {needed:.3g} rad/s and more",
        remedy="fly a faster sweep",
        findings=[
            refusal(
                "no_excitation",
                name,
                f"There is {nothing_above(top)} in {name}; anything coherent above is feedback and noise.",
                highest_rad_s=top,
                needed_rad_s=needed,
            )
        ],
    )


def _not_coherent(measured: Measured, least_coherence: float) -> InsufficientDataError:
    data, name = measured.response, _name(measured)
    low, high = measured.trusted_rad_s
    inside = (data.omega_rad_s >= low) & (data.omega_rad_s <= high)
    best = float(data.coherence[:, :, inside].max(initial=0.0))
    error = float(data.random_error[:, :, inside].min(initial=np.inf))
    reason = f"reaches at best a coherence of {best:.3f} and an error of {100.0 * error:.0f} %"
    return InsufficientDataError(
        f"{name} {reason} between {low:.3g} and {high:.3g} rad/s",
        needed=f"points with a coherence of {least_coherence:g} and {SMALL_ERROR}",
        remedy="excite the axis harder or longer, fly in calmer air, or lower --coherence",
        findings=[
            refusal(
                "low_coherence",
                name,
                f"No point of {name} is usable: it {reason}.",
                best_coherence=best,
                limit=least_coherence,
                least_error=min(error, 1e9),
            )
        ],
    )


def _too_narrow(measured: Measured, low: float, high: float, needed: float) -> InsufficientDataError:
    name = _name(measured)
    return InsufficientDataError(
        f"{name} is usable only from {low:.3g} to {high:.3g} rad/s",
        needed=f"at least an octave, up to {needed:.3g} rad/s or more",
        remedy="excite a wider band, or widen --band",
        findings=[
            refusal(
                "low_coherence",
                name,
                f"{name} is usable only from {low:.3g} to {high:.3g} rad/s, which is too narrow to separate "
                "gain, damping and delay.",
                low_rad_s=low,
                high_rad_s=high,
            )
        ],
    )


def require_known_gain(
    gain: str | None, parameters: ParameterSet, bounds: Bounds, findings: Sequence[Finding] = ()
) -> None:
    """Refuse a model whose gain could as well have the other sign.

    Parameters
    ----------
    gain
        Name of the parameter, ``None`` for a model without one.
    parameters, bounds
        What was fitted.
    findings
        Of the fit: where its logs or maneuvers disagree, that is the reason.

    Raises
    ------
    InsufficientDataError
        The gain lies within two standard deviations of zero.
    """
    if gain not in bounds.names:
        return
    value, std = parameters[gain].value, bounds.stds[gain]
    if abs(value) >= CERTAIN_SIGN * std:
        return
    found = f"{with_error(value, std)} {parameters[gain].unit}"
    disagreeing = [
        replace(finding, severity="error")
        for finding in findings
        if finding.kind == "logs_disagree" and finding.where == gain
    ]
    if disagreeing:
        raise InsufficientDataError(
            f"the logs or maneuvers disagree so much that even the sign of {gain} is uncertain: {found}",
            needed="logs and maneuvers of the same vehicle, flown alike",
            remedy="identify each log by itself",
            findings=disagreeing,
        )
    raise InsufficientDataError(
        f"the sign of {gain} is uncertain: {found}",
        needed="a gain at least two standard deviations from zero",
        remedy="use longer segments or a wider band, or excite the axis harder",
        findings=[
            refusal(
                "not_identifiable",
                gain,
                f"Even the sign of {gain} is uncertain: the fit gives {found}.",
                value=value,
                std=std,
            )
        ],
    )


def main_pairs(problem: FrequencyProblem) -> set[tuple[int, int]]:
    """The response to each input that it is there for: of a vehicle's axis its own rate, else what is known best.

    Known best is what has the most points over their squared errors. In wind that may be a coupling, such as the side
    force of a vehicle that yaws.
    """
    own = {axis.input: axis.output for axis in RATE_AXES.values()}
    data = problem.data
    error = np.where(problem.used, data.random_error, np.inf)
    weight = np.sum(1.0 / np.maximum(error, 1e-3) ** 2, axis=-1)
    for u, name in enumerate(data.inputs):
        if own.get(name) in data.outputs:
            row = data.outputs.index(own[name])
            weight[row, u] = np.inf if weight[row, u] > 0.0 else 0.0
    return {(int(np.argmax(weight[:, u])), u) for u in range(weight.shape[1]) if weight[:, u].any()}
