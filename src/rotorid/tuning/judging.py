r"""Is a set of gains safe? One rule for every set, whoever proposes it: flown, foreign, or of another autotune.

Both loops, the rate loop alone and the whole one, are closed around every likely plant. :math:`M` of a draw is the
larger sensitivity peak of both, infinite where one is unstable, and the largest over all situations in which the gains
have to hold: the ends of the throttle, and those of a D that changes in flight.

- **do not fly**: the 90 % quantile of :math:`M` exceeds 2.4
- **fly**: the 95 % quantile is at most 2.0
- **fly gently**: anything between, or a command that is noisier than it should be
- **not enough data** in place of "do not fly", where the plant decides it and was not measured there: the median of
  :math:`M` is below 2.4, and its peak lies beyond the band or where the plant is uncertain by more than 10 %. Gains
  whose crossover lies beyond what is known of the plant are never called safe.

The thresholds were chosen on 5 184 sets of gains of 108 axes, and hold on vehicles that were not among them
(``docs/tuning-study.md``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.trust import COMMAND_NOISE, REFUSED_PEAK, REFUSED_QUANTILE, SAFE_PEAK
from rotorid.tuning.loops import HIGHEST_RAD_S, LoopFigures, loop_figures
from rotorid.tuning.plant import UncertainPlant
from rotorid.typing import ComplexArray, FloatArray

Verdict: TypeAlias = Literal["fly", "gently", "do_not_fly", "not_enough_data"]

WORST_FIRST: tuple[Verdict, ...] = ("do_not_fly", "not_enough_data", "gently", "fly")

VERDICT_NAMES: Mapping[Verdict, str] = MappingProxyType(
    {"fly": "fly", "gently": "fly gently", "do_not_fly": "do not fly", "not_enough_data": "not enough data"}
)
"""What each verdict is called in tables."""

SAFE_QUANTILE = 0.95
"""Quantile of the likely plants that counts for gains to fly without reserve."""

UNCERTAIN = 0.1
"""Relative error of the plant, in gain or in rad, above which a peak there was not measured."""

QUIET, NOISIEST = 0.01, 0.1
"""Root mean square of the noise in the command, over its range: what does not matter, and as much as a limit cycle."""

_SAME_GAIN = 1e-3


class Figures(NamedTuple):
    """Figures of both loops over the draws, in one situation."""

    rate: LoopFigures
    whole: LoopFigures


@dataclass(frozen=True, kw_only=True)
class CommandNoise(Immutable):
    """Noise of the command.

    Parameters
    ----------
    rms
        Over the range of the command, where the log shows it; ``None`` where it does not.
    ratio
        Over that of the flown gains.
    """

    rms: float | None = None
    ratio: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Breaking(Immutable):
    """The likely plant that decides a verdict.

    Parameters
    ----------
    draw
        Which one.
    situation
        Name of the situation; empty for that of the hover.
    loop
        ``rate`` or ``whole``.
    omega_rad_s
        Where its sensitivity peaks.
    sensitivity_peak
        Its M_s; infinite where the loop is unstable.
    gain, phase_deg
        Its response there, over that of the most likely plant.
    """

    draw: int
    situation: str
    loop: Literal["rate", "whole"]
    omega_rad_s: float
    sensitivity_peak: float
    gain: float
    phase_deg: float


@dataclass(frozen=True, kw_only=True)
class LoopVerdict(Immutable):
    """The verdict on the gains of an axis.

    Parameters
    ----------
    verdict
        ``fly``, ``gently``, ``do_not_fly`` or ``not_enough_data``.
    usual_peak, refused_peak, safe_peak
        Median of M over the draws, and its quantiles of 90 and 95 %; infinite where a loop is unstable.
    unstable
        Share of the draws on which a loop is unstable.
    breaking
        The plant at the quantile that decides.
    known_to_rad_s
        Upper end of what would have to be measured; zero where the data suffice.
    noisy
        Whether the noise of the command alone keeps the gains from a better verdict.
    """

    verdict: Verdict
    usual_peak: float
    refused_peak: float
    safe_peak: float
    unstable: float
    breaking: Breaking
    known_to_rad_s: float = 0.0
    noisy: bool = False

    @property
    def flies(self) -> bool:
        """Whether the gains may fly, gently or not."""
        return self.verdict in ("fly", "gently")


def worst(verdicts: Mapping[str, Verdict] | None) -> Verdict:
    """The verdict of all axes together: the worst; not enough data where there is no axis.

    Examples
    --------
    >>> worst({"roll": "fly", "yaw": "gently"}), worst({})
    ('gently', 'not_enough_data')
    """
    found = set((verdicts or {}).values())
    return next((verdict for verdict in WORST_FIRST if verdict in found), "not_enough_data")


def loop_verdict(
    plant: UncertainPlant, situations: Mapping[str, Figures], *, noise: CommandNoise | None = None
) -> LoopVerdict:
    """The verdict on gains by their loops around all likely plants.

    Parameters
    ----------
    plant
        Whose draws the figures are of.
    situations
        Figures by the name of the situation; that of the hover has an empty name.
    noise
        Of the command.

    Examples
    --------
    >>> from rotorid.models.controller import RateController
    >>> from rotorid.tuning.loops import Gains, frequency_grid, loop_figures
    >>> from rotorid.tuning.plant import uncertain_plant
    >>> plant = uncertain_plant(lambda w: 100.0 / (1j * w) * np.exp(-0.01j * w), None, band_rad_s=(1.0, 100.0))
    >>> w = frequency_grid(RateController(proportional_s=0.1, step_s=1.0 / 400.0))
    >>> for P in (0.2, 1.0, 2.0):
    ...     figures = loop_figures(w, P * plant.drawn(w), from_rad_s=plant.known_from_rad_s)
    ...     found = loop_verdict(plant, {"": Figures(figures, figures)})
    ...     print(found.verdict, round(found.usual_peak, 1), found.unstable)
    fly 1.2 0.0
    do_not_fly 3.1 0.0
    do_not_fly inf 0.99
    """
    names, peaks, places = _peaks(situations)
    # Situations and loops that are worst for each draw.
    row = np.argmax(peaks, axis=0)
    draws = np.arange(peaks.shape[1])
    worst_peaks, worst_places = peaks[row, draws], places[row, draws]
    usual, refused, safe = (_quantile(worst_peaks, share) for share in (0.5, REFUSED_QUANTILE, SAFE_QUANTILE))
    place = float(np.median(worst_places))
    noisiest = noise is not None and noise.rms is not None and noise.rms > NOISIEST
    loud = noise is not None and noise.ratio > COMMAND_NOISE and (noise.rms is None or noise.rms > QUIET)
    by_loops: Verdict = "do_not_fly" if refused > REFUSED_PEAK else "fly" if safe <= SAFE_PEAK else "gently"
    verdict, needed = by_loops, 0.0
    crossover = max(max(one.rate.usual_crossover_rad_s, one.whole.usual_crossover_rad_s) for one in situations.values())
    if verdict == "do_not_fly":
        if usual <= REFUSED_PEAK and not _is_known(plant, place):
            verdict, needed = "not_enough_data", max(place, plant.band_rad_s[1])
    elif crossover > plant.reach_rad_s:
        verdict, needed = "not_enough_data", crossover
    if noisiest and verdict != "not_enough_data":
        verdict = "do_not_fly"
    elif loud and verdict == "fly":
        verdict = "gently"
    share = SAFE_QUANTILE if verdict in ("fly", "gently") else REFUSED_QUANTILE
    draw = int(np.argsort(worst_peaks, kind="stable")[_rank(worst_peaks.size, share)])
    situation, loop = names[row[draw]]
    at = np.array([worst_places[draw]])
    ratio = complex(plant.drawn(at)[draw, 0] / plant.response(at)[0])
    return LoopVerdict(
        verdict=verdict,
        usual_peak=usual,
        refused_peak=refused,
        safe_peak=safe,
        unstable=float(np.mean(~np.isfinite(worst_peaks))),
        breaking=Breaking(
            draw=draw,
            situation=situation,
            loop=loop,
            omega_rad_s=float(at[0]),
            sensitivity_peak=float(worst_peaks[draw]),
            gain=abs(ratio),
            phase_deg=float(np.degrees(np.angle(ratio))),
        ),
        known_to_rad_s=needed,
        noisy=verdict != by_loops and verdict != "not_enough_data",
    )


def _peaks(
    situations: Mapping[str, Figures],
) -> tuple[list[tuple[str, Literal["rate", "whole"]]], FloatArray, FloatArray]:
    """Situation and loop of each row, and M of every draw with its frequency, shapes ``(rows, draws)``."""
    names: list[tuple[str, Literal["rate", "whole"]]] = []
    peaks, places = [], []
    for name, figures in situations.items():
        for loop, found in (("rate", figures.rate), ("whole", figures.whole)):
            names.append((name, loop))  # type: ignore[arg-type]
            peaks.append(np.where(found.stable > 0.0, found.sensitivity_peak, np.inf))
            # A peak at the end of the grid lies somewhere beyond.
            at = found.sensitivity_peak_rad_s
            places.append(np.where(np.isfinite(at), at, HIGHEST_RAD_S))
    return names, np.array(peaks), np.array(places)


def _rank(count: int, share: float) -> int:
    return min(max(int(np.ceil(share * count)) - 1, 0), count - 1)


def _quantile(values: FloatArray, share: float) -> float:
    """A value that was drawn, since some are infinite."""
    return float(np.sort(values)[_rank(values.size, share)])


def _is_known(plant: UncertainPlant, omega_rad_s: float) -> bool:
    """Whether a plant was measured at a frequency, to 10 % and better."""
    if omega_rad_s > plant.band_rad_s[1]:
        return False
    at = np.array([omega_rad_s])
    ratios = plant.drawn(at)[:, 0] / plant.response(at)[0]
    return bool(np.std(np.log(np.abs(ratios))) <= UNCERTAIN and np.std(np.angle(ratios)) <= UNCERTAIN)


def situations_of(
    plant: UncertainPlant,
    omega_rad_s: FloatArray,
    controllers: Mapping[str, tuple[ComplexArray, ComplexArray]],
    *,
    gain_range: tuple[float, float] = (1.0, 1.0),
) -> dict[str, Figures]:
    """Figures of both loops over the draws, for each end of a controller that moves and of the flown throttle.

    Parameters
    ----------
    plant
        With its draws.
    omega_rad_s
        Shape ``(f,)``.
    controllers
        Name of each end to the command by the logged rate, without and with the angle loop, shapes ``(f,)``.
    gain_range
        Least and largest gain of the loops over the flown throttle, relative to hover.
    """
    drawn, start = plant.drawn(omega_rad_s), plant.known_from_rad_s
    low, high = gain_range
    factors = {"": 1.0}
    if high - low > _SAME_GAIN:
        factors = {f"at {factor:.2f} times the gain in hover": factor for factor in (low, high)}
    return {
        " ".join(filter(None, (end, throttle))): Figures(
            *(loop_figures(omega_rad_s, factor * drawn * made, from_rad_s=start) for made in both)
        )
        for end, both in controllers.items()
        for throttle, factor in factors.items()
    }
