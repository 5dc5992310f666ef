"""Whether measured responses can support a model at all: the refusals, each with its reason."""

from __future__ import annotations

import numpy as np

from rotorid.data.findings import Finding
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.models.parameter import ParameterSet
from rotorid.pipeline.measure import Measured
from rotorid.typing import BoolArray
from rotorid.uncertainty.bounds import Bounds

LOWEST_TOP_RAD_S = 8.0
"""A rate model is not identified from data that end below: there the speed modes of the airframe rule."""

_LEAST_WIDTH = 2.0
"""Highest over lowest fitted frequency: below an octave, gain, damping and delay cannot be told apart."""


def require_support(measured: Measured, used: BoolArray, *, least_coherence: float, rate_model: bool) -> None:
    """Refuse a fit where the data end below, or hold less than, what the model needs.

    Parameters
    ----------
    measured
        The responses.
    used
        Points that can be trusted, shape ``(y, u, f)``.
    least_coherence
        The limit by which they were chosen.
    rate_model
        Whether the model needs data above the speed modes.

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
    if high < needed:
        raise UsageError(
            f"the band {low:g}:{high:g} rad/s ends below the {needed:g} rad/s that a rate model needs",
            needed="a band above the speed modes of the airframe, such as 1:60",
            remedy="widen --band",
        )
    omega = measured.response.omega_rad_s[used.any(axis=(0, 1))]
    if omega.size == 0:
        raise _not_coherent(measured, least_coherence)
    if omega[-1] < needed or omega[-1] < _LEAST_WIDTH * omega[0]:
        raise _too_narrow(measured, float(omega[0]), float(omega[-1]), needed)


def _name(measured: Measured) -> str:
    return f"{measured.response.outputs[0]}/{measured.response.inputs[0]}"


def _not_excited(measured: Measured, needed: float) -> InsufficientDataError:
    name, top = _name(measured), measured.excited_to_rad_s
    rounded = f"{top:.0f}" if top >= 2.0 else f"{top:.2g}"
    return InsufficientDataError(
        f"no excitation above {rounded} rad/s came for {name}",
        needed=f"excitation that goes on to {needed:.3g} rad/s and more",
        remedy="fly a sweep that goes faster",
        findings=[
            Finding(
                kind="no_excitation",
                severity="error",
                where=name,
                message=(
                    f"There is no excitation above {rounded} rad/s in {name}; what is coherent above is feedback and "
                    "noise."
                ),
                numbers={"highest_rad_s": top, "needed_rad_s": needed},
            )
        ],
    )


def _not_coherent(measured: Measured, least_coherence: float) -> InsufficientDataError:
    data, name = measured.response, _name(measured)
    low, high = measured.trusted_rad_s
    inside = (data.omega_rad_s >= low) & (data.omega_rad_s <= high)
    best = float(data.coherence[:, :, inside].max(initial=0.0))
    error = float(data.random_error[:, :, inside].min(initial=np.inf))
    reason = f"reaches a coherence of {best:.3f} and an error of {100.0 * error:.0f} % at best"
    return InsufficientDataError(
        f"{name} {reason} inside {low:.3g} to {high:.3g} rad/s",
        needed=f"points with a coherence of {least_coherence:g} and an error below 30 %",
        remedy="excite the axis harder or longer, fly in calmer air, or lower --coherence",
        findings=[
            Finding(
                kind="low_coherence",
                severity="error",
                where=name,
                message=f"No point of {name} can be used: it {reason}.",
                numbers={"best_coherence": best, "limit": least_coherence, "least_error": min(error, 1e9)},
            )
        ],
    )


def _too_narrow(measured: Measured, low: float, high: float, needed: float) -> InsufficientDataError:
    name = _name(measured)
    return InsufficientDataError(
        f"{name} can be used from {low:.3g} to {high:.3g} rad/s only",
        needed=f"at least an octave, and data up to {needed:.3g} rad/s and more",
        remedy="excite a wider band, or widen --band",
        findings=[
            Finding(
                kind="low_coherence",
                severity="error",
                where=name,
                message=(
                    f"{name} is usable from {low:.3g} to {high:.3g} rad/s only; gain, damping and delay cannot be told "
                    "apart in that."
                ),
                numbers={"low_rad_s": low, "high_rad_s": high},
            )
        ],
    )


def require_known_gain(gain: str | None, parameters: ParameterSet, bounds: Bounds) -> None:
    """Refuse a model whose gain could as well have the other sign.

    Raises
    ------
    InsufficientDataError
        The gain lies within two standard deviations of zero.
    """
    if gain not in bounds.names:
        return
    value, std = parameters[gain].value, float(bounds.std[bounds.names.index(gain)])
    if abs(value) >= 2.0 * std:
        return
    found = f"{value:.2g} ± {std:.1g} {parameters[gain].unit}"
    raise InsufficientDataError(
        f"the data do not show {gain}: {found}",
        needed="a gain that differs from zero by two standard deviations",
        remedy="give longer segments or a wider band, or excite the axis harder",
        findings=[
            Finding(
                kind="not_identifiable",
                severity="error",
                where=gain,
                message=f"Not even the sign of {gain} is certain: the fit gives {found}.",
                numbers={"value": value, "std": std},
            )
        ],
    )
