"""The same open-loop doublet by rotorid's own equations and by another simulator."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np

from rotorid.exports import Exported
from rotorid.simulation.multirotor import STATES, Multirotor
from rotorid.typing import FloatArray
from rotorid.verification.scores import theil_inequality

STEP_S, STEPS = 0.001, 600


def doublet(body: Multirotor, axis: int, *, size: float = 0.02) -> FloatArray:
    """Outputs about hover, shape ``(steps, rotors)``: each rotor as far as it moves the axis (0 roll to 2 yaw)."""
    weights = body.wrench[3 + axis]
    k = np.arange(STEPS)
    shape = np.where((k >= 50) & (k < 150), 1.0, np.where((k >= 150) & (k < 250), -1.0, 0.0))
    return np.asarray(body.hover_shares + size * shape[:, None] * weights / np.abs(weights).max())


def late(outputs: FloatArray, steps: int) -> FloatArray:
    """The same, so many steps later."""
    return np.concatenate([np.repeat(outputs[:1], steps, axis=0), outputs[: len(outputs) - steps]])


def own(body: Multirotor, outputs: FloatArray) -> dict[str, FloatArray]:
    """Rates, velocity over ground and height after each step, by rotorid."""
    from rotorid.simulation.flight_kernels import glide

    states = glide(body.hovering(), outputs, np.zeros_like(outputs[:, :3]), 1.0, body.body(), STEP_S)[1:]
    assert states.shape[1] == STATES + body.rotors.layout.rotors
    return named(states[:, 10:13], states[:, 3:6])


def named(rates: FloatArray, velocity: FloatArray) -> dict[str, FloatArray]:
    """Columns of rates and of velocity over ground, north, east, down."""
    columns = np.concatenate([rates, velocity], axis=1).T
    return dict(zip(("p", "q", "r", "north", "east", "down"), columns, strict=True))


def inequality(
    mine: dict[str, FloatArray], theirs: dict[str, FloatArray], *, share: float = 0.02, curved: bool = False
) -> dict[str, float]:
    """Theil's coefficient of every rate and speed that moves by a share of the largest, in rad/s and m/s.

    Where the other has the tangent of a curve, climb is left out: doublets on other axes move it by the curve alone.
    """
    groups = (("p", "q", "r"), ("north", "east") if curved else ("north", "east", "down"))
    most = {name: max(np.abs(mine[one]).max() for one in group) for group in groups for name in group}
    counted = [name for name in most if np.abs(mine[name]).max() > max(share * most[name], 1e-3)]
    return {name: theil_inequality(mine[name], theirs[name]) for name in counted}


def imported(exported: Exported, folder: Path, name: str) -> ModuleType:
    """A module of the files of an export, which are written first."""
    exported.write(folder)
    spec = importlib.util.spec_from_file_location(Path(name).stem, folder / name)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules.pop(Path(name).stem, None)
    spec.loader.exec_module(module)
    return module
