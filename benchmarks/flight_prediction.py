"""What needs no model of flight: a differentiator of the log, on the flights on which models of force are compared.

Tables of learned models of quadrotors take past velocities and rates as inputs. How much that gives away, this shows:
specific force and moment of a moment as differences of the logged velocity and rates over the last 10 ms. It knows the
attitude, all past velocities and rates, and no motor; models of ours know motors, velocity and rates of that moment,
and nothing from before. Moments take the inertia that NeuroBEM's own columns imply. Errors are root mean squares of the
length of the vector, pooled over samples; force against the logged specific force, moment against the derivative of the
rates up to 25 Hz. Run ``python -m benchmarks.flight_prediction FOLDER`` with NeuroBEM's flights.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation

import rotorid
from rotorid.typing import FloatArray

MAPPING = Path(__file__).resolve().parents[1] / "docs" / "mappings" / "neurobem.toml"
MASS_KG, INERTIA_KG_M2 = 0.752, np.array([2.52e-3, 2.14e-3, 4.36e-3])
RATE_HZ, PAST = 400.0, 4
MOMENT_HZ = 25.0
GRAVITY = np.array([0.0, 0.0, 9.80665])


class Missed(NamedTuple):
    """Sums of squares of the errors of force (N²) and moment (N² m²) of a flight, and its samples."""

    force: float
    moment: float
    samples: int


def differentiated(path: Path) -> Missed:
    """The differentiator on one flight."""
    log = rotorid.read(path, mapping=MAPPING, sandbox=False)

    def rows(names: str) -> FloatArray:
        return np.stack([log[name].values for name in names.split()])

    turn = Rotation.from_euler("ZYX", rows("psi theta phi").T)
    over_earth = turn.apply(rows("u v w").T).T
    force = turn[PAST:].inv().apply(_past(over_earth).T - GRAVITY).T - rows("ax ay az")[:, PAST:]
    rates = rows("p q r")
    smooth = sosfiltfilt(butter(2, MOMENT_HZ, fs=RATE_HZ, output="sos"), np.gradient(rates, 1.0 / RATE_HZ, axis=1))
    moment = INERTIA_KG_M2[:, None] * (_past(rates) - smooth[:, PAST:])
    return Missed(float(MASS_KG**2 * (force**2).sum()), float((moment**2).sum()), force.shape[1])


def _past(values: FloatArray) -> FloatArray:
    """Slope over the last 10 ms of each sample that has them."""
    return np.asarray((values[:, PAST:] - values[:, :-PAST]) * (RATE_HZ / PAST))


def main(folder: Path) -> None:
    """Print the errors of each flight, and of all together."""
    found = {path.name: differentiated(path) for path in sorted(folder.glob("neurobem_*.mat*"))}
    for name, missed in found.items():
        print(f"{name:44} {_words(missed)}")
    if found:
        print(f"{'all':44} {_words(Missed(*(sum(parts) for parts in zip(*found.values(), strict=True))))}")


def _words(missed: Missed) -> str:
    force, moment = np.sqrt(missed.force / missed.samples), np.sqrt(missed.moment / missed.samples)
    return f"force {force:.3f} N, moment {1e3 * moment:.2f} mN m"


if __name__ == "__main__":
    main(Path(sys.argv[1]))
