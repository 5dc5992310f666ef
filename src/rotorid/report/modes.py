"""What the poles say: how the vehicle moves by itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from rotorid.pipeline.document import PoleDocument, ResultDocument
from rotorid.plot.poles import s_plane
from rotorid.report.numbers import significant, with_error
from rotorid.report.picture import Picture

_STILL_RAD_S = 1e-9
"""A pole this near to the origin is an integrator but for rounding."""
_SURE_SIGMAS = 2.0

_RATES = {"roll": ("p", "phi"), "pitch": ("q", "theta"), "yaw": ("r", "psi")}
_HOVERING = {"roll": ("v", "phi"), "pitch": ("u", "theta")}
"""States of the unstable oscillation of every hovering rotorcraft: it tilts, drifts, and is turned back too far."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PoleRow:
    """A mode of the model; a conjugate pair is one."""

    real: str
    imag: str
    frequency: str
    damping: str
    words: str
    unstable: bool


def pole_rows(poles: Sequence[PoleDocument]) -> tuple[PoleRow, ...]:
    """One row for each mode, slow ones first; the lower pole of a conjugate pair is left out."""
    return tuple(
        PoleRow(
            real=with_error(pole.real, pole.real_std) if pole.real_std else significant(pole.real),
            imag=(with_error(pole.imag, pole.imag_std) if pole.imag_std else significant(pole.imag))
            if pole.imag
            else "0",
            frequency=with_error(pole.frequency_rad_s, pole.frequency_std_rad_s)
            if pole.frequency_std_rad_s
            else significant(pole.frequency_rad_s),
            damping=with_error(pole.damping, pole.damping_std)
            if pole.damping_std
            else significant(pole.damping, digits=2),
            words=pole_words(pole),
            unstable=grows(pole),
        )
        for pole in _modes(poles)
    )


def pole_words(pole: PoleDocument) -> str:
    """How a mode moves: its time constant, or how fast it grows, and its oscillation.

    Examples
    --------
    >>> pole_words(PoleDocument(real=-4.0, imag=0.0, damping=1.0, frequency_rad_s=4.0))
    'stable, time constant 0.25 s'
    """
    swing = f", oscillates at {significant(pole.frequency_rad_s)} rad/s" if pole.imag else ""
    if abs(pole.real) <= _STILL_RAD_S:
        return f"neither decays nor grows{swing}"
    if not _sure(pole):
        return f"{'decays' if pole.real < 0.0 else 'grows'} slowly or not at all: within 2 σ of neither{swing}"
    if pole.real < 0.0:
        return f"stable, time constant {significant(-1.0 / pole.real)} s{swing}"
    return f"grows, doubling in {_doubling(pole)} s{swing}"


def grows(pole: PoleDocument) -> bool:
    """Whether a mode grows for sure: by more than two standard deviations where one is known."""
    return pole.real > _STILL_RAD_S and _sure(pole)


def mode_sentences(document: ResultDocument) -> tuple[str, ...]:
    """What a pilot without an autopilot would meet; nothing where no mode grows for sure."""
    growing = [pole for pole in _modes(document.poles) if grows(pole)]
    swinging = [pole for pole in growing if pole.imag]
    hovering = [axis for axis, states in _HOVERING.items() if set(states) <= set(document.states)]
    axes = hovering or [axis for axis, states in _RATES.items() if set(states) & set(document.states)]
    of = axes[0].capitalize() if len(axes) == 1 else "The vehicle"
    known = ", as multirotors do without an autopilot" if hovering else ""
    sentences = []
    if len(swinging) == 1:
        (pole,) = swinging
        speed = significant(pole.frequency_rad_s)
        sentences.append(f"{of} oscillates at {speed} rad/s and grows, doubling in {_doubling(pole)} s{known}.")
    elif swinging:
        fastest = max(swinging, key=lambda pole: pole.real)
        sentences.append(
            f"{len(swinging)} modes oscillate and grow, the fastest doubling in {_doubling(fastest)} s{known}."
        )
    sentences += [
        f"One mode grows without oscillating, doubling in {_doubling(pole)} s." for pole in growing if not pole.imag
    ]
    return tuple(sentences)


def poles_sentence(poles: Sequence[PoleDocument]) -> str:
    """How many poles there are and how many of them grow."""
    growing = sum(grows(pole) for pole in poles)
    total = "1 pole" if len(poles) == 1 else f"{len(poles)} poles"
    return f"{total}, {growing or 'none'} of them unstable."


def poles_picture(poles: Sequence[PoleDocument], *, key: str) -> Picture | None:
    """The poles in the plane of s; none where there are no finite poles."""
    finite = [pole for pole in poles if math.isfinite(pole.real) and math.isfinite(pole.imag)]
    if not finite:
        return None
    draw = partial(
        s_plane,
        np.array([complex(pole.real, pole.imag) for pole in finite]),
        std=np.array([_spread(pole) for pole in finite]),
        words=[f"{_value(pole)}<br>{pole_words(pole)}".replace("<br>", ": ") for pole in finite],
    )
    return Picture(
        key=key, description="Poles of the model in the complex plane, with their uncertainty", figure=draw()
    )


def _modes(poles: Sequence[PoleDocument]) -> list[PoleDocument]:
    return sorted((pole for pole in poles if pole.imag >= 0.0), key=lambda pole: pole.frequency_rad_s)


def _sure(pole: PoleDocument) -> bool:
    return pole.real_std is None or abs(pole.real) > _SURE_SIGMAS * pole.real_std


def _doubling(pole: PoleDocument) -> str:
    """Time in which the amplitude doubles: ln 2 over the real part."""
    return significant(math.log(2.0) / pole.real, digits=2)


def _spread(pole: PoleDocument) -> complex:
    if pole.real_std is None or pole.imag_std is None:
        return complex(math.nan, math.nan)
    return complex(pole.real_std, pole.imag_std)


def _value(pole: PoleDocument) -> str:
    sign = "−" if pole.imag < 0.0 else "+"
    return significant(pole.real) + (f" {sign} {significant(abs(pole.imag))} j" if pole.imag else "")
