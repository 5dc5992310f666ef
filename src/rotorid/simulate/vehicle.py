"""What flies: a linear model of hover with the autopilot that holds it there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.channel import AXES
from rotorid.data.immutable import Immutable
from rotorid.errors import ModelError
from rotorid.models.state_space import StateSpace
from rotorid.simulate.controller import MEASURED, HoverController
from rotorid.typing import FloatArray

VELOCITIES = ("u", "v", "w")
ACCELERATIONS = ("ax", "ay", "az")
OUTPUTS = MEASURED + ACCELERATIONS


@dataclass(frozen=True, kw_only=True, eq=False)
class HoverVehicle(Immutable):
    r"""A vehicle around hover.

    Parameters
    ----------
    name
        What it is called.
    system
        Four inputs, the commands of roll, pitch, yaw and thrust as differences from hover; twelve outputs,
        ``p q r phi theta psi u v w ax ay az``, the last three as differences from hover too. No output is late.
    states
        Names of the states of ``system``; ``u``, ``v`` and ``w`` are among them. Their columns in F hold nothing but
        aerodynamics (true around hover, where no trim velocity turns), so that gusts enter with the opposite sign.
    hover_thrust
        Thrust command that carries the weight, 0 to 1.
    controller
        The autopilot.
    """

    name: str
    system: StateSpace
    states: tuple[str, ...]
    hover_thrust: float
    controller: HoverController

    def __post_init__(self) -> None:
        outputs, inputs = self.system.H0.shape[0], self.system.G.shape[1]
        if (outputs, inputs) != (len(OUTPUTS), len(AXES)) or len(self.states) != self.system.F.shape[0]:
            raise ModelError(
                f"{self.name} has {inputs} inputs, {outputs} outputs and {len(self.states)} names of states",
                needed=f"the inputs {', '.join(AXES)}, the outputs {' '.join(OUTPUTS)}, and a name for each state",
            )
        if missing := set(VELOCITIES) - set(self.states):
            raise ModelError(f"{self.name} lacks the states {', '.join(sorted(missing))}", needed="u, v and w")
        if np.any(self.system.output_delays_s):
            raise ModelError(f"{self.name} has late outputs", needed="sensors without delay; delay the inputs instead")
        self._set(states=tuple(self.states))

    @property
    def gust_input(self) -> FloatArray:
        """Columns of G for gusts along u, v and w, shape ``(x, 3)``: air that comes is speed that goes."""
        columns: FloatArray = -self.system.F[:, [self.states.index(name) for name in VELOCITIES]]
        return columns
