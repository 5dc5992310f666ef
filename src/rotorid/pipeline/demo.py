"""The demonstration: fly the built-in vehicle, and identify it from its log like any other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rotorid.data.record import FlightRecord
from rotorid.pipeline.identification import Identification
from rotorid.pipeline.identify import identify
from rotorid.pipeline.settings import IdentifySettings, require_seed

LOG_NAME = "flight.csv"

BANDS_RAD_S = {
    "rate.roll": (12.0, 50.0),
    "rate.pitch": (12.0, 50.0),
    "rate.yaw": (1.0, 50.0),
    "rate.vertical": (15.0, 50.0),
}
"""Where a rate model describes the S500: above its speed modes, and for heave above the pitching that heave causes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Demonstration:
    """What the demonstration made.

    Parameters
    ----------
    identifications
        One for each axis.
    truth
        The parameters of the vehicle that flew, as far as a rate model has them.
    """

    identifications: tuple[Identification, ...]
    truth: dict[str, float]


def fly_demo(path: Path, *, seed: int) -> None:
    """Fly sweeps and doublets with the S500 of the literature in gusts, and write the log as CSV.

    Parameters
    ----------
    path
        Log to write.
    seed
        Seed of gusts, sensor noise and test inputs.
    """
    import numpy as np

    from rotorid.io.tabular import write_csv
    from rotorid.simulate.flight import fly
    from rotorid.vehicles import s500
    from rotorid.vehicles.demo import demo_plan

    require_seed(seed)
    rng = np.random.default_rng(seed)
    flight = fly(s500.vehicle(), demo_plan(rng=rng), rng=rng)
    write_csv(path, flight.time_s, flight.columns)


def identify_demo(
    record: FlightRecord, *, seed: int, command: tuple[str, ...], progress: Callable[[str], None]
) -> Demonstration:
    """Identify a rate model of each axis from the log of the demonstration."""
    from rotorid.vehicles import s500

    results = []
    for model, band in BANDS_RAD_S.items():
        settings = IdentifySettings(band_rad_s=band, seed=seed)
        results.append(identify([record], model, settings=settings, command=command, progress=progress))
    names = {name for result in results for name in result.document.parameters}
    return Demonstration(
        identifications=tuple(results), truth={name: value for name, value in s500.TRUTH.items() if name in names}
    )
