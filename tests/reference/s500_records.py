"""The simulated S500 in closed loop, as records of a fit in time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

import rotorid
from rotorid.fitting.time.output_error import TimeData
from rotorid.units import STANDARD_GRAVITY_M_S2

RATE_HZ = 200.0


def record_of(path: Path, inputs: Sequence[str], outputs: Sequence[str]) -> TimeData:
    """Channels of one file; the vertical specific force as a difference from hover."""
    (topic,) = rotorid.read(path).topics
    rows = {name: topic.values[topic.row(name)] for name in (*inputs, *outputs)}
    if "az" in rows:
        rows["az"] = rows["az"] + STANDARD_GRAVITY_M_S2
    return TimeData(
        name=path.stem,
        inputs=np.stack([rows[name] for name in inputs]),
        outputs=np.stack([rows[name] for name in outputs]),
        sample_rate_hz=RATE_HZ,
    )
