"""From wishes to a flight plan: shapes on axes one after the other, each as large as the limits allow."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from rotorid.data.channel import AXES
from rotorid.data.flight_plan import Entry, FlightPlan, PlannedInput, Shape
from rotorid.data.immutable import Immutable
from rotorid.design.amplitude import Amplitude, Limits, Reached, largest_amplitude, reached
from rotorid.errors import UsageError
from rotorid.excitation.planned import planned, sequence, together
from rotorid.simulate.multirotor_flight import Aircraft, fly_multirotor
from rotorid.simulate.wind import CALM, Wind
from rotorid.typing import Axis

STEPS: tuple[Shape, ...] = ("doublet", "two_one_one", "three_two_one_one")
"""Shapes whose duration is their band."""

_STEP_S = 0.3
_UNITS_OF_STEPS: Mapping[Shape, int] = MappingProxyType({"doublet": 2, "two_one_one": 4, "three_two_one_one": 7})
_SWEEP_UNITS = 200
"""Default lengths: one of a step, how many there are of it, and what does not step as if it had so many."""

DOUBLET_S = _UNITS_OF_STEPS["doublet"] * _STEP_S
_SAMPLE_RATE_HZ = 250.0
_LONGEST_LOOK_S = 400.0
_MARGIN = 0.9
_LARGEST: Mapping[Entry, float] = MappingProxyType(
    {"command": 1.0, "stick": 1.0, "attitude_setpoint": 1.2, "rate_setpoint": 20.0}
)
"""No test input is larger, in the unit of where it is added."""

_MOST_REPEATS = 20
_LONGEST_S = 1800.0
_REST_S = 4.0
"""Between inputs: as long as an identification wants to look before and after one."""


@dataclass(frozen=True, kw_only=True)
class PlanChoices(Immutable):
    """What is to be flown.

    Parameters
    ----------
    shape
        Form of the test input.
    axes
        Excited one after the other; a multisine excites them at the same time.
    band_rad_s
        Lowest and highest frequency, where the shape has a band.
    duration_s
        Of each test input, of a multisine with all its periods; by default 60 s, and of steps 0.3 s for each unit.
    repeats
        How often each is flown in a row, every time with other noise. Steps alternate in sign.
    entry
        Where they are added; by default see :func:`default_entry`.
    amplitudes
        By axis, for those that are not to be searched for.
    limits
        What the flight may reach.
    doublets
        Whether doublets that no model will be fitted to follow, to verify it.
    wind
        The wind that the amplitudes allow for.
    seed
        Of what is random in the inputs, and of wind and noise while amplitudes are searched for.
    """

    shape: Shape = "pilot_sweep"
    axes: tuple[Axis, ...] = AXES  # type: ignore[assignment]
    band_rad_s: tuple[float, float] = (0.6, 50.0)
    duration_s: float | None = None
    repeats: int = 1
    entry: Entry | None = None
    amplitudes: Mapping[str, float] = field(default_factory=dict)
    limits: Limits = field(default_factory=Limits)
    doublets: bool = False
    wind: Wind = CALM
    seed: int = 0

    def __post_init__(self) -> None:
        wrong = [axis for axis in self.axes if axis not in AXES] or len(set(self.axes)) < len(self.axes)
        if wrong or not self.axes or not 1 <= self.repeats <= _MOST_REPEATS:
            raise UsageError(
                f"the axes {', '.join(self.axes) or 'none'} with {self.repeats} repeats came",
                needed=f"some of {', '.join(AXES)}, each once, and 1 to {_MOST_REPEATS} repeats",
            )
        if not 0.0 < self.length_s <= _LONGEST_S:
            raise UsageError(f"a duration of {self.length_s:g} s came", needed=f"above 0 and up to {_LONGEST_S:g} s")
        for axis, size in self.amplitudes.items():
            if axis not in self.axes or not 0.0 < size < math.inf:
                raise UsageError(
                    f"the amplitude {axis}={size:g} came",
                    needed=f"a positive one for one of the axes that are flown: {', '.join(self.axes)}",
                )
        self._set(axes=tuple(self.axes), amplitudes=self.amplitudes)

    @property
    def length_s(self) -> float:
        """Duration of each test input."""
        if self.duration_s is not None:
            return self.duration_s
        return _UNITS_OF_STEPS.get(self.shape, _SWEEP_UNITS) * _STEP_S


@dataclass(frozen=True, kw_only=True, eq=False)
class Planned(Immutable):
    """A plan with how large its inputs are and why.

    Parameters
    ----------
    plan
        What to fly.
    amplitudes
        What was found for each shape and axis whose amplitude was searched for.
    reached
        What the whole plan reaches in the simulator.
    """

    plan: FlightPlan
    amplitudes: Mapping[str, Amplitude]
    reached: Reached

    def limited_by(self, part: PlannedInput) -> str:
        """The limit that a larger input would pass; empty where its amplitude was given."""
        found = self.amplitudes.get(f"{part.shape} of {part.axis}")
        return found.limited_by if found is not None else ""


def default_entry(aircraft: Aircraft, axis: Axis) -> Entry:
    """Where a user of this autopilot can add a test input without hands.

    ArduPilot adds chirps to what the mixer receives. PX4 takes attitudes and thrust from outside (Offboard), and no
    torques.
    """
    return "attitude_setpoint" if aircraft.autopilot.kind == "px4" and axis != "thrust" else "command"


def by_hand(aircraft: Aircraft, axis: Axis) -> Entry:
    """Where steps are added: ArduPilot flies them by no script, and a pilot by the stick."""
    return "stick" if aircraft.autopilot.kind == "ardupilot" else default_entry(aircraft, axis)


def sweep_of(aircraft: Aircraft) -> Shape:
    """The sweep that an autopilot can fly by itself: ArduPilot has its logarithmic chirp and no other."""
    return "logarithmic_sweep" if aircraft.autopilot.kind == "ardupilot" else "pilot_sweep"


def plan_for(
    aircraft: Aircraft, choices: PlanChoices, *, name: str = "", progress: Callable[[str], None] = lambda _: None
) -> Planned:
    """A plan whose inputs are as large as the limits allow, with a tenth to spare.

    Each axis is tried alone in the simulator; then the whole plan is flown, and where inputs at the same time pass a
    limit together, all are made smaller by the same factor.

    Parameters
    ----------
    aircraft
        What will fly.
    choices
        What is to be flown.
    name
        Of the plan.
    progress
        Is told what is being done.
    """
    if choices.shape == "multisine":
        _common_entry(aircraft, choices)
    found: dict[str, Amplitude] = {}
    sizes = dict(choices.amplitudes)
    for axis in choices.axes:
        if axis not in sizes:
            progress(f"looking for the largest {choices.shape.replace('_', ' ')} of {axis}")
            largest = _largest(aircraft, choices, axis, choices.shape, choices.length_s)
            found[f"{choices.shape} of {axis}"] = largest
            sizes[axis] = _rounded(_MARGIN * largest.value)
    doublets = dict(sizes)
    if choices.doublets and choices.shape not in STEPS:
        for axis in choices.axes:
            progress(f"looking for the largest doublet of {axis}")
            largest = _largest(aircraft, choices, axis, "doublet", DOUBLET_S)
            found[f"doublet of {axis}"] = largest
            doublets[axis] = _rounded(_MARGIN * largest.value)
    plan = plan_with(aircraft, choices, sizes, doublets=doublets, name=name)
    progress("flying the whole plan")
    factor, whole = _together(aircraft, plan, choices)
    if factor < 1.0:
        plan = replace(plan, inputs=tuple(_scaled(one, factor) for one in plan.inputs))
    return Planned(plan=plan, amplitudes=found, reached=whole)


def _together(aircraft: Aircraft, plan: FlightPlan, choices: PlanChoices) -> tuple[float, Reached]:
    """Factor that brings the whole plan back into the limits, one where it is there, and what it then reaches."""
    if choices.amplitudes.keys() >= set(choices.axes):
        return 1.0, reached(fly_multirotor(aircraft, plan, wind=choices.wind, seed=choices.seed))
    whole = largest_amplitude(
        aircraft,
        lambda factor: replace(plan, inputs=tuple(_scaled(one, factor) for one in plan.inputs)),
        choices.limits,
        start=1.0,
        wind=choices.wind,
        seed=choices.seed,
    )
    return whole.value, whole.reached


def _largest(aircraft: Aircraft, choices: PlanChoices, axis: Axis, shape: Shape, duration_s: float) -> Amplitude:
    """Largest amplitude of one axis on its own."""
    length_s = min(duration_s, _LONGEST_LOOK_S)

    # Made once: the phases of a multisine take longer to find than a flight.
    unit = _input(aircraft, choices, axis, shape, length_s, 1.0, repeat=0)

    def alone(amplitude: float) -> FlightPlan:
        return FlightPlan(name=f"{shape} of {axis}", inputs=(_scaled(unit, amplitude),), trim_s=2.0)

    return largest_amplitude(
        aircraft, alone, choices.limits, largest=_LARGEST[unit.entry], wind=choices.wind, seed=choices.seed
    )


def plan_with(
    aircraft: Aircraft,
    choices: PlanChoices,
    sizes: Mapping[str, float],
    *,
    doublets: Mapping[str, float] | None = None,
    name: str = "",
) -> FlightPlan:
    """A plan with given amplitudes by axis, those of its doublets apart."""
    parts: list[PlannedInput | Sequence[PlannedInput]] = []
    if choices.shape == "multisine":
        # Periods in a row are one input: their joints are smooth, and only the first holds a transient.
        parts.append(
            together(
                {axis: sizes[axis] for axis in choices.axes},
                start_s=0.0,
                band_rad_s=choices.band_rad_s,
                period_s=choices.length_s / (choices.repeats + 1),
                periods=choices.repeats + 1,
                sample_rate_hz=_SAMPLE_RATE_HZ,
                entry=_common_entry(aircraft, choices),
                seed=choices.seed,
            )
        )
    else:
        parts += [
            _input(aircraft, choices, axis, choices.shape, choices.length_s, sizes[axis], repeat=repeat)
            for axis in choices.axes
            for repeat in range(choices.repeats)
        ]
    if choices.doublets:
        parts += [
            _input(aircraft, choices, axis, "doublet", DOUBLET_S, (doublets or sizes)[axis], repeat=repeat)
            for axis in choices.axes
            for repeat in range(2)
        ]
    title = name or f"{choices.shape.replace('_', ' ')} on {', '.join(choices.axes)}"
    return sequence(title, parts, trim_s=_REST_S)


def _common_entry(aircraft: Aircraft, choices: PlanChoices) -> Entry:
    """Where inputs of several axes at the same time are added."""
    if choices.entry is not None:
        return choices.entry
    entries = {default_entry(aircraft, axis) for axis in choices.axes}
    if len(entries) > 1:
        raise UsageError(
            f"a {choices.shape} of {', '.join(choices.axes)} came, and {aircraft.name} takes {' and '.join(entries)}",
            needed="axes with one entry",
            remedy="leave out thrust, or name an --entry for all",
        )
    return entries.pop()


def _input(
    aircraft: Aircraft,
    choices: PlanChoices,
    axis: Axis,
    shape: Shape,
    duration_s: float,
    amplitude: float,
    *,
    repeat: int,
) -> PlannedInput:
    settings = {"noise_fraction": 0.1} if shape == "pilot_sweep" else {}
    if shape == "logarithmic_sweep":
        # As ArduPilot flies it: two cycles of the lowest frequency, and a slow fade.
        constant_s = 4.0 * math.pi / choices.band_rad_s[0]
        settings = {
            "constant_s": constant_s,
            "fade_in_s": min(5.0, 0.1 * duration_s),
            "fade_out_s": min(2.0, 0.05 * duration_s),
        }
        duration_s += constant_s
    one = planned(
        axis,
        shape,
        start_s=0.0,
        amplitude=-amplitude if shape in STEPS and repeat % 2 else amplitude,
        duration_s=duration_s,
        sample_rate_hz=_SAMPLE_RATE_HZ,
        band_rad_s=None if shape in STEPS else choices.band_rad_s,
        entry=choices.entry or (by_hand(aircraft, axis) if shape in STEPS else default_entry(aircraft, axis)),
        seed=choices.seed + AXES.index(axis) + len(AXES) * repeat,
        **settings,
    )
    if shape == "pilot_sweep":
        # The noise on top of the sine counts, for limits are kept by what is flown.
        one = replace(one, values=one.values * (abs(amplitude) / np.abs(one.values).max()))
    return one


def _scaled(one: PlannedInput, factor: float) -> PlannedInput:
    return replace(one, values=factor * one.values, amplitude=factor * one.amplitude)


def _rounded(amplitude: float) -> float:
    """Two digits, downward: what a person would set."""
    place = 10.0 ** (math.floor(math.log10(amplitude)) - 1)
    return round(math.floor(amplitude / place + 1e-9) * place, 9)
