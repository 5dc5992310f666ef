"""Flight plans of test inputs: by the name of their shape, several axes at once or one after the other."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.flight_plan import Entry, FlightPlan, PlannedInput, Shape
from rotorid.errors import UsageError, nearest_name
from rotorid.excitation.multisines import halved, harmonics_in, interleaved, multisine, power_law
from rotorid.excitation.sweep import logarithmic_sweep, pilot_sweep
from rotorid.excitation.switching import (
    balanced_three_two_one_one,
    doublet,
    random_binary,
    three_two_one_one,
    two_one_one,
)
from rotorid.typing import Axis, FloatArray

Layout: TypeAlias = Literal["halved", "interleaved"]
"""Ways in which axes share the harmonics of a period."""

_WHOLE = 1e-9
_DRAWS = 32
_SEED_STRIDE = 1009
"""Draws of one axis are so far apart, and those of another begin beside them."""

_LAYOUTS = MappingProxyType({"halved": halved, "interleaved": interleaved})


@dataclass(frozen=True, kw_only=True, eq=False)
class _Request:
    """What was asked for, complete."""

    amplitude: float
    band_rad_s: tuple[float, float]
    duration_s: float
    sample_rate_hz: float
    settings: Mapping[str, float]


def planned(
    axis: Axis,
    shape: Shape,
    *,
    start_s: float,
    amplitude: float,
    duration_s: float,
    sample_rate_hz: float,
    band_rad_s: tuple[float, float] | None = None,
    entry: Entry = "command",
    seed: int = 0,
    **settings: float,
) -> PlannedInput:
    """A test input of a named shape on one axis.

    Parameters
    ----------
    axis
        Where it acts.
    shape
        Its form; see the settings.
    start_s
        When its first sample is flown, on the clock of the plan.
    amplitude
        Largest value, in the unit of what it is added to.
    duration_s
        From the first to the last motion. That of steps is shared out to them: a quarter of it is the unit of a 2-1-1.
    sample_rate_hz
        Rate of the samples.
    band_rad_s
        Lowest and highest frequency; what is no step needs one.
    entry
        Where it is added.
    seed
        Of what is random: the signal of ``random_binary``, the noise of ``pilot_sweep``, the search for the phases of
        ``multisine``.
    **settings
        All shapes: ``trim_s`` (0), zeros before and after, which are part of the input. The others by shape, with
        their defaults:

        ``pilot_sweep``: ``slow_cycles`` (0), ``fade_s`` (1), ``noise_fraction`` (0).
        ``logarithmic_sweep``: ``constant_s`` (0), ``fade_in_s`` (1), ``fade_out_s`` (1).
        ``multisine``: ``periods`` (1), ``first_harmonic`` (2), ``harmonic_step`` (1), ``power_exponent`` (0).
        ``random_binary``: ``passes`` (10), ``clock_hz`` (0: the sample rate), the rate of the turns at which it may
        switch. ``three_two_one_one``: ``balanced`` (0 or 1).

    Raises
    ------
    UsageError
        There is no such shape or setting, a band lacks or is too much, or the shape refuses what was asked.

    Examples
    --------
    >>> sweep = planned("roll", "logarithmic_sweep", start_s=5.0, amplitude=0.1, band_rad_s=(0.6, 60.0),
    ...                 duration_s=60.0, sample_rate_hz=100.0, fade_in_s=5.0)
    >>> sweep.stop_s, dict(sweep.settings)
    (65.0, {'trim_s': 0.0, 'constant_s': 0.0, 'fade_in_s': 5.0, 'fade_out_s': 1.0})
    """
    form = _form(shape)
    if (band_rad_s is not None) != form.banded:
        raise UsageError(
            f"a {shape} {'needs a' if form.banded else 'takes no'} band",
            needed="a lowest and a highest frequency" if form.banded else "a duration, which sets its band",
        )
    wish = _Request(
        amplitude=amplitude,
        band_rad_s=band_rad_s or (0.0, 0.0),
        duration_s=duration_s,
        sample_rate_hz=sample_rate_hz,
        settings=_completed(shape, {"trim_s": 0.0, **form.defaults}, settings)
        | ({"seed": seed} if form.random else {}),
    )
    return PlannedInput(
        axis=axis,
        shape=shape,
        start_s=start_s,
        values=np.pad(form.make(wish), round(wish.settings["trim_s"] * sample_rate_hz)),
        sample_rate_hz=sample_rate_hz,
        amplitude=amplitude,
        band_rad_s=band_rad_s,
        entry=entry,
        settings=wish.settings,
    )


def together(
    amplitudes: Mapping[Axis, float],
    *,
    start_s: float,
    band_rad_s: tuple[float, float],
    period_s: float,
    sample_rate_hz: float,
    periods: int = 2,
    layout: Layout = "halved",
    entry: Entry = "command",
    power_exponent: float = 0.0,
    seed: int = 0,
) -> tuple[PlannedInput, ...]:
    """Multisines on several axes at the same time, orthogonal over every period.

    Parameters
    ----------
    amplitudes
        Axes, the most important first, and the largest value of each.
    start_s
        When they begin.
    band_rad_s
        Lowest and highest frequency of all together; the lowest is at least two cycles per period.
    period_s
        Length of a period; a whole number of samples for exact orthogonality.
    sample_rate_hz
        Rate of the samples.
    periods
        How many. The first holds the transient.
    layout
        How axes share the harmonics: :func:`rotorid.excitation.halved` or :func:`rotorid.excitation.interleaved`.
    entry
        Where they are added.
    power_exponent
        Power of a harmonic by its frequency, see :func:`rotorid.excitation.power_law`.
    seed
        Of the search for low peaks.

    Returns
    -------
    tuple
        One input per axis, in their order.

    Raises
    ------
    UsageError
        There is no such layout, an axis would have no harmonic, or the rate is too low.

    Examples
    --------
    >>> roll, pitch = together({"roll": 0.1, "pitch": 0.05}, start_s=3.0, band_rad_s=(0.6, 12.6), period_s=20.0,
    ...                        sample_rate_hz=50.0)
    >>> bool(abs(roll.values @ pitch.values) < 1e-12 * (roll.values @ roll.values)), roll.stop_s - roll.start_s
    (True, 40.02)
    """
    if layout not in _LAYOUTS:
        raise _unknown("layout of harmonics", layout, list(_LAYOUTS))
    combs = _LAYOUTS[layout](len(amplitudes), band_rad_s=band_rad_s, period_s=period_s)
    # A comb of one tooth: the next one would be beyond the band.
    beyond = int(max(comb[-1] for comb in combs))
    return tuple(
        planned(
            axis,
            "multisine",
            start_s=start_s,
            amplitude=amplitude,
            duration_s=periods * period_s,
            sample_rate_hz=sample_rate_hz,
            band_rad_s=band_rad_s,
            entry=entry,
            seed=seed,
            periods=periods,
            first_harmonic=int(comb[0]),
            harmonic_step=int(comb[1] - comb[0]) if comb.size > 1 else beyond,
            power_exponent=power_exponent,
        )
        for (axis, amplitude), comb in zip(amplitudes.items(), combs, strict=True)
    )


def uncorrelated_binaries(
    amplitudes: Mapping[Axis, float],
    *,
    start_s: float,
    band_rad_s: tuple[float, float],
    duration_s: float,
    sample_rate_hz: float,
    clock_hz: float = 0.0,
    entries: Mapping[Axis, Entry] | None = None,
    reach_s: float = 2.0,
    seed: int = 0,
) -> tuple[PlannedInput, ...]:
    r"""Random binary signals on several axes at the same time that have hardly anything to do with each other.

    Independent signals are uncorrelated on average, and one pair of them by about one over the root of the number of
    its switches. Of the signals after the first, that one of 32 draws is flown whose largest correlation

    .. math:: \rho_{ab}(k) = \frac{1}{N A_a A_b} \sum_n a_n b_{n+k}, \qquad |k| \le \text{reach}

    with those before it is the least, over all delays within which the vehicle answers. It stands in the settings of
    the input as ``correlation``. What remains of it is shared by the estimates of both axes, for responses side by side
    are fitted together.

    Parameters
    ----------
    amplitudes
        Axes and the height of both levels of each.
    start_s
        When they begin.
    band_rad_s
        Lowest and highest frequency of all.
    duration_s
        Of all.
    sample_rate_hz
        Rate of the samples.
    clock_hz
        Rate of the turns at which they may switch; zero for the sample rate.
    entries
        Where each is added; ``command`` by default.
    reach_s
        Longest delay at which a correlation counts.
    seed
        Of the draws.

    Returns
    -------
    tuple
        One input per axis, in their order.

    Raises
    ------
    UsageError
        The band does not go with the duration or the rate.

    References
    ----------
    Ljung, *System Identification: Theory for the User*, 2nd edition, section 13.3, on binary inputs and on inputs of
    several channels.

    Examples
    --------
    >>> roll, pitch = uncorrelated_binaries({"roll": 0.1, "pitch": 0.1}, start_s=3.0, band_rad_s=(1.5, 8.5),
    ...                                     duration_s=60.0, sample_rate_hz=100.0, clock_hz=20.0)
    >>> pitch.settings["correlation"] < 0.1, roll.values.size
    (True, 6000)
    """
    chosen: list[PlannedInput] = []
    for place, (axis, amplitude) in enumerate(amplitudes.items()):
        draws = [
            planned(
                axis,
                "random_binary",
                start_s=start_s,
                amplitude=amplitude,
                duration_s=duration_s,
                sample_rate_hz=sample_rate_hz,
                band_rad_s=band_rad_s,
                entry=(entries or {}).get(axis, "command"),
                seed=seed + place + _SEED_STRIDE * number,
                clock_hz=clock_hz,
            )
            for number in range(_DRAWS if chosen else 1)
        ]
        reach = round(reach_s * sample_rate_hz)
        shared = [max((_correlation(planned, other, reach) for other in chosen), default=0.0) for planned in draws]
        best = int(np.argmin(shared))
        settings = {**draws[best].settings, "correlation": round(shared[best], 6)}
        chosen.append(replace(draws[best], settings=settings if place else draws[best].settings))
    return tuple(chosen)


def _correlation(planned: PlannedInput, other: PlannedInput, reach: int) -> float:
    """Largest correlation of two inputs of one length at delays up to ``reach`` samples either way."""
    from scipy.fft import irfft, next_fast_len, rfft

    count = planned.values.size
    length = int(next_fast_len(2 * count, real=True))
    products = irfft(rfft(planned.values, length) * rfft(other.values, length).conj(), length)
    near = np.concatenate([products[: reach + 1], products[length - reach :]])
    return float(np.abs(near).max() / (count * abs(planned.amplitude * other.amplitude)))


def sequence(name: str, parts: Sequence[PlannedInput | Sequence[PlannedInput]], *, trim_s: float = 3.0) -> FlightPlan:
    """A plan that flies one part after the other, with rests before, between and after them.

    Parameters
    ----------
    name
        Of the plan.
    parts
        Inputs, or groups of inputs that keep their times among themselves; their own starts do not matter otherwise.
        The same part may come several times.
    trim_s
        Length of a rest: for the vehicle to settle, and for the pilot to bring it back.

    Examples
    --------
    >>> step = planned("roll", "doublet", start_s=0.0, amplitude=0.1, duration_s=1.0, sample_rate_hz=50.0)
    >>> plan = sequence("two doublets", [step, replace(step, axis="pitch")], trim_s=4.0)
    >>> [(part.axis, part.start_s) for part in plan.inputs], plan.duration_s
    ([('roll', 4.0), ('pitch', 9.0)], 14.0)
    """
    placed: list[PlannedInput] = []
    free_s = trim_s
    for part in parts:
        group = (part,) if isinstance(part, PlannedInput) else tuple(part)
        if not group:
            raise UsageError(f"the plan {name} has an empty part", needed="at least one test input")
        later_s = free_s - min(test_input.start_s for test_input in group)
        group = tuple(replace(test_input, start_s=test_input.start_s + later_s) for test_input in group)
        placed += group
        free_s = max(test_input.stop_s for test_input in group) + trim_s
    return FlightPlan(name=name, inputs=tuple(placed), trim_s=trim_s)


def _pilot_sweep(wish: _Request) -> FloatArray:
    settings = wish.settings
    return pilot_sweep(
        amplitude=wish.amplitude,
        band_rad_s=wish.band_rad_s,
        duration_s=wish.duration_s,
        sample_rate_hz=wish.sample_rate_hz,
        slow_cycles=settings["slow_cycles"],
        fade_s=settings["fade_s"],
        noise_fraction=settings["noise_fraction"],
        rng=_generator(wish),
        trim_s=0.0,
    )


def _logarithmic_sweep(wish: _Request) -> FloatArray:
    return logarithmic_sweep(
        amplitude=wish.amplitude,
        band_rad_s=wish.band_rad_s,
        duration_s=wish.duration_s,
        sample_rate_hz=wish.sample_rate_hz,
        constant_s=wish.settings["constant_s"],
        fade_in_s=wish.settings["fade_in_s"],
        fade_out_s=wish.settings["fade_out_s"],
        trim_s=0.0,
    )


def _multisine(wish: _Request) -> FloatArray:
    periods, first, step = (_whole(wish, name) for name in ("periods", "first_harmonic", "harmonic_step"))
    period_s = wish.duration_s / periods
    every = harmonics_in(wish.band_rad_s, period_s=period_s)
    harmonics = every[(every >= first) & ((every - first) % step == 0)]
    powers = power_law(harmonics, wish.settings["power_exponent"]) if harmonics.size else None
    signal = multisine(
        harmonics, amplitude=wish.amplitude, period_s=period_s, powers=powers, seed=_whole(wish, "seed", least=0)
    )
    return signal.sampled(wish.sample_rate_hz, periods=periods)


def _random_binary(wish: _Request) -> FloatArray:
    clock_hz = wish.settings["clock_hz"] or wish.sample_rate_hz
    turn = wish.sample_rate_hz / clock_hz
    if not (turn >= 1.0 and abs(turn - round(turn)) < _WHOLE):
        raise UsageError(
            f"clock_hz={clock_hz:g} does not fit samples at {wish.sample_rate_hz:g} Hz",
            needed="a whole number of samples per clock period",
        )
    values = random_binary(
        amplitude=wish.amplitude,
        band_rad_s=wish.band_rad_s,
        duration_s=wish.duration_s,
        sample_rate_hz=clock_hz,
        passes=_whole(wish, "passes", least=0),
        rng=_generator(wish),
        trim_s=0.0,
    )
    return np.repeat(values, round(turn))


def _doublet(wish: _Request) -> FloatArray:
    return doublet(
        amplitude=wish.amplitude, pulse_s=wish.duration_s / 2.0, sample_rate_hz=wish.sample_rate_hz, trim_s=0.0
    )


def _two_one_one(wish: _Request) -> FloatArray:
    return two_one_one(
        amplitude=wish.amplitude, unit_s=wish.duration_s / 4.0, sample_rate_hz=wish.sample_rate_hz, trim_s=0.0
    )


def _three_two_one_one(wish: _Request) -> FloatArray:
    steps = balanced_three_two_one_one if wish.settings["balanced"] else three_two_one_one
    return steps(amplitude=wish.amplitude, unit_s=wish.duration_s / 7.0, sample_rate_hz=wish.sample_rate_hz, trim_s=0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Form:
    """How a shape is made, and what it takes."""

    make: Callable[[_Request], FloatArray]
    defaults: Mapping[str, float] = field(default_factory=dict)
    banded: bool = True
    random: bool = False


_FORMS: Mapping[Shape, _Form] = MappingProxyType(
    {
        "pilot_sweep": _Form(
            make=_pilot_sweep, defaults={"slow_cycles": 0.0, "fade_s": 1.0, "noise_fraction": 0.0}, random=True
        ),
        "logarithmic_sweep": _Form(
            make=_logarithmic_sweep, defaults={"constant_s": 0.0, "fade_in_s": 1.0, "fade_out_s": 1.0}
        ),
        "multisine": _Form(
            make=_multisine,
            defaults={"periods": 1.0, "first_harmonic": 2.0, "harmonic_step": 1.0, "power_exponent": 0.0},
            random=True,
        ),
        "random_binary": _Form(make=_random_binary, defaults={"passes": 10.0, "clock_hz": 0.0}, random=True),
        "doublet": _Form(make=_doublet, banded=False),
        "two_one_one": _Form(make=_two_one_one, banded=False),
        "three_two_one_one": _Form(make=_three_two_one_one, defaults={"balanced": 0.0}, banded=False),
    }
)


def _form(shape: str) -> _Form:
    if shape not in _FORMS:
        raise _unknown("shape of a test input", shape, list(_FORMS))
    return _FORMS[shape]  # type: ignore[index]


def _completed(shape: Shape, defaults: Mapping[str, float], settings: Mapping[str, float]) -> dict[str, float]:
    for name in settings:
        if name not in defaults:
            raise _unknown(f"setting of a {shape}", name, list(defaults))
    return {**defaults, **settings}


def _unknown(what: str, name: str, known: Sequence[str]) -> UsageError:
    near = nearest_name(name, known)
    return UsageError(
        f"there is no {what} {name!r}",
        needed=f"one of {', '.join(known)}",
        remedy=f"did you mean {near}?" if near else "",
    )


def _whole(wish: _Request, name: str, *, least: int = 1) -> int:
    value = wish.settings[name]
    if value != int(value) or value < least:
        raise UsageError(f"{name}={value:g} is out of range", needed=f"a whole number from {least} up")
    return int(value)


def _generator(wish: _Request) -> np.random.Generator:
    return np.random.default_rng(_whole(wish, "seed", least=0))
