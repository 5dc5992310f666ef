r"""A loop as frequency responses: what a flight is expected to look like, before anyone has flown it.

.. math:: u = K y + E r, \qquad y = G u + v

with commands u, outputs y, test inputs r, the plant G, the feedback K (its sign included) and disturbances and noises
v as they stand at the outputs with the loop open. Solved for what is logged,

.. math:: u = T E r + B v, \quad y = G T E r + (1 + G B) v, \qquad T = (1 - K G)^{-1}, \quad B = T K
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from rotorid.data.flight_plan import Entry
from rotorid.data.immutable import Immutable, read_only
from rotorid.errors import UsageError
from rotorid.typing import ComplexArray, FloatArray


class Responds(Protocol):
    """What has a frequency response: a state space, a controller."""

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        """Response at frequencies above zero, shape ``(outputs, inputs, f)``."""
        ...


class Density(Protocol):
    """What has a spectrum."""

    def density(self, omega_rad_s: FloatArray) -> ComplexArray:
        r"""One-sided densities :math:`E[a b^*]` in unit²/Hz, shape ``(n, n, f)``."""
        ...


@dataclass(frozen=True, kw_only=True)
class Noise:
    """A source of disturbance or noise.

    Parameters
    ----------
    source
        Its spectrum.
    path
        From the source to the outputs; a source that stands at the outputs has none.
    logged_only
        Whether it enters the log but not the controller, sample by sample of the log.
    """

    source: Density
    path: Responds | None = None
    logged_only: bool = False

    def at(self, omega_rad_s: FloatArray) -> ComplexArray:
        """What it is at the outputs with the loop open, shape ``(y, y, f)``."""
        density = self.source.density(omega_rad_s)
        if self.path is None:
            return density
        path = self.path.response(omega_rad_s)
        return np.asarray(np.einsum("amf,mnf,bnf->abf", path, density, path.conj(), optimize=True))


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopResponses(Immutable):
    r"""A closed loop on one frequency grid.

    Parameters
    ----------
    omega_rad_s
        Shape ``(f,)``.
    plant
        Outputs by commands, the loop open, shape ``(y, u, f)``.
    excited
        :math:`T`, commands by test inputs added to them, shape ``(u, u, f)``.
    disturbed
        :math:`B`, commands by disturbances at the outputs, shape ``(u, y, f)``.
    density
        One-sided :math:`E[v v^*]` of these disturbances, shape ``(y, y, f)``.
    """

    omega_rad_s: FloatArray
    plant: ComplexArray
    excited: ComplexArray
    disturbed: ComplexArray
    density: ComplexArray

    def __post_init__(self) -> None:
        self._set(
            omega_rad_s=read_only(self.omega_rad_s, np.float64, ndim=1),
            **{
                name: read_only(getattr(self, name), np.complex128, ndim=3)
                for name in ("plant", "excited", "disturbed", "density")
            },
        )

    @property
    def logged_noise(self) -> ComplexArray:
        """One-sided densities of what commands and outputs do without test inputs, shape ``(u + y, u + y, f)``."""
        outputs = np.eye(len(self.plant))[:, :, None] + np.einsum("auf,ubf->abf", self.plant, self.disturbed)
        both = np.concatenate([self.disturbed, outputs])
        return np.asarray(np.einsum("amf,mnf,bnf->abf", both, self.density, both.conj(), optimize=True))


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopModel(Immutable):
    """A vehicle under feedback, and how it is logged.

    Linear and stable: that the loop is stable is not checked, and the answers of one that is not mean nothing.

    Parameters
    ----------
    name
        What messages call it.
    inputs, outputs
        Channel names of commands and outputs.
    plant
        Outputs by commands.
    feedback
        Commands by outputs, with its sign; ``None`` in open loop.
    noises
        Disturbances and sensor noises.
    entries
        Commands by test inputs that enter elsewhere, one column for each command; ``command`` needs none.
    log_rate_hz
        Rate of the log.
    loop_rate_hz
        Rate of the controller, of which the log picks samples: what the loop does above half of the rate of the log
        shows below it. ``None`` takes the noises as the log shows them.
    declared
        Where test inputs enter that the log declares with their band, as ArduPilot's does with its own sweeps. Of all
        others an identification finds the band in the signals.
    alone
        Whether the log holds these, and what answers them, only while they are flown, as ArduPilot's fast samples are.
    """

    name: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    plant: Responds
    feedback: Responds | None
    noises: tuple[Noise, ...]
    entries: Mapping[Entry, Responds] = field(default_factory=dict)
    log_rate_hz: float = 200.0
    loop_rate_hz: float | None = None
    declared: tuple[Entry, ...] = ("command",)
    alone: bool = False

    def __post_init__(self) -> None:
        self._set(inputs=tuple(self.inputs), outputs=tuple(self.outputs), noises=tuple(self.noises))
        self._set(entries=self.entries, declared=tuple(self.declared))
        if not self.log_rate_hz > 0.0 or (self.loop_rate_hz is not None and self.loop_rate_hz < self.log_rate_hz):
            raise UsageError(
                f"a log at {self.log_rate_hz:g} Hz of a loop at {self.loop_rate_hz} Hz came",
                needed="a positive rate of the log, at most that of the loop",
            )

    def at(self, omega_rad_s: FloatArray) -> LoopResponses:
        """The loop at some frequencies above zero, shape ``(f,)``; noises that only the log sees are left out."""
        plant = self.plant.response(omega_rad_s)
        outputs, inputs, points = plant.shape
        feedback = np.zeros((inputs, outputs, points), dtype=np.complex128)
        if self.feedback is not None:
            feedback = self.feedback.response(omega_rad_s)
        around = np.eye(inputs) - np.einsum("iyf,yjf->fij", feedback, plant)
        excited = np.moveaxis(np.linalg.inv(around), 0, -1)
        return LoopResponses(
            omega_rad_s=omega_rad_s,
            plant=plant,
            excited=excited,
            disturbed=np.einsum("ijf,jyf->iyf", excited, feedback),
            density=_summed([one for one in self.noises if not one.logged_only], omega_rad_s, outputs),
        )

    def excitation(self, omega_rad_s: FloatArray, entry: Entry) -> ComplexArray:
        """Commands by test inputs with the loop open, :math:`E`, shape ``(u, u, f)``.

        Raises
        ------
        UsageError
            The loop does not say how a test input gets from there to the commands.
        """
        if entry == "command":
            return np.repeat(np.eye(len(self.inputs), dtype=np.complex128)[:, :, None], omega_rad_s.size, axis=2)
        if entry not in self.entries:
            raise UsageError(
                f"a plan with test inputs at the {entry} came",
                needed=f"test inputs at {' or '.join(['command', *self.entries])} for the loop {self.name}",
            )
        return self.entries[entry].response(omega_rad_s)

    def logged_noise(self, omega_rad_s: FloatArray) -> ComplexArray:
        r"""One-sided densities of commands and outputs in the log without test inputs, shape ``(u + y, u + y, f)``.

        Samples that are picked and not averaged fold the spectrum of the loop,
        :math:`S(\omega) = \sum_m S_{loop}(\omega + m \omega_{log})`.
        """
        total = np.zeros((*[len(self.inputs) + len(self.outputs)] * 2, omega_rad_s.size), dtype=np.complex128)
        for shift in self._images:
            moved = omega_rad_s + shift
            inside = np.abs(moved) <= np.pi * (self.loop_rate_hz or np.inf)
            density = self.at(np.abs(moved[inside])).logged_noise
            # Of a real signal the spectrum at a negative frequency is the conjugate one.
            total[..., inside] += np.where(moved[inside] < 0.0, density.conj(), density)
        outputs = slice(len(self.inputs), None)
        apart = [one for one in self.noises if one.logged_only]
        total[outputs, outputs] += _summed(apart, omega_rad_s, len(self.outputs))
        return total

    @property
    def _images(self) -> list[float]:
        if self.loop_rate_hz is None:
            return [0.0]
        count = int(np.ceil(self.loop_rate_hz / self.log_rate_hz))
        return [2.0 * np.pi * self.log_rate_hz * number for number in range(-count, count + 1)]


def loop_model(
    plant: Responds,
    feedback: Responds | None,
    noises: Sequence[Noise],
    *,
    name: str,
    inputs: Sequence[str],
    outputs: Sequence[str],
    entries: Mapping[Entry, Responds] | None = None,
    log_rate_hz: float = 200.0,
    loop_rate_hz: float | None = None,
    declared: Sequence[Entry] = ("command",),
    alone: bool = False,
) -> LoopModel:
    """A loop of a plant and its controller, checked for shapes.

    Parameters
    ----------
    plant
        State space from commands to outputs, or anything else with such a response.
    feedback
        From outputs to commands, its sign included; ``None`` in open loop.
    noises
        Sources of disturbance and noise, each with its path to the outputs.
    name, inputs, outputs, entries, log_rate_hz, loop_rate_hz, declared, alone
        As in :class:`LoopModel`.

    Raises
    ------
    UsageError
        The shapes of plant, feedback, entries and noises do not fit the names.

    Examples
    --------
    A rate that is the integral of ten times the command, held by a gain of 0.5, noisy as a gyro is:

    >>> from rotorid.design.spectrum import White
    >>> from rotorid.models.state_space import StateSpace
    >>> one, none = np.eye(1), np.zeros((1, 1))
    >>> rate = StateSpace(M=one, F=none, G=10.0 * one, H0=one, H1=none, input_delays_s=[0.0], output_delays_s=[0.0])
    >>> gain = StateSpace(M=one, F=-1e6 * one, G=-0.5e6 * one, H0=one, H1=none,
    ...                   input_delays_s=[0.0], output_delays_s=[0.0])
    >>> loop = loop_model(rate, gain, [Noise(source=White(std=(0.01,), sample_rate_hz=200.0))],
    ...                   name="rate loop", inputs=["roll_command"], outputs=["p"])
    >>> abs(loop.at(np.array([5.0])).excited[0, 0]).round(3)
    array([0.707])
    """
    loop = LoopModel(
        name=name,
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        plant=plant,
        feedback=feedback,
        noises=tuple(noises),
        entries=entries or {},
        log_rate_hz=log_rate_hz,
        loop_rate_hz=loop_rate_hz,
        declared=tuple(declared),
        alone=alone,
    )
    u, y, one = len(loop.inputs), len(loop.outputs), np.ones(1)
    shapes = [("the plant", plant.response(one).shape, (y, u, 1))]
    if feedback is not None:
        shapes.append(("the feedback", feedback.response(one).shape, (u, y, 1)))
    shapes += [(f"the entry {entry}", path.response(one).shape, (u, u, 1)) for entry, path in loop.entries.items()]
    shapes += [(f"noise {number}", noise.at(one).shape, (y, y, 1)) for number, noise in enumerate(noises)]
    for what, came, needed in shapes:
        if came != needed:
            raise UsageError(f"{what} of {name} has a response of shape {came}", needed=f"shape {needed}")
    return loop


def _summed(noises: Sequence[Noise], omega_rad_s: FloatArray, outputs: int) -> ComplexArray:
    total = np.zeros((outputs, outputs, omega_rad_s.size), dtype=np.complex128)
    for noise in noises:
        total += noise.at(omega_rad_s)
    return total
