"""The rig on its pivot in simulation: two of its motors swept at once, one upward in frequency and one downward."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rotorid import __version__
from rotorid.data.record import FlightRecord
from rotorid.io.store import sha256_of
from rotorid.io.tabular import write_csv
from rotorid.models.catalog import library_model
from rotorid.pipeline.document import ManeuverDocument, ProvenanceDocument
from rotorid.pipeline.settings import require_seed
from rotorid.pipeline.simulation_document import (
    SimulatedLogDocument,
    SimulationDocument,
    TruthDocument,
    VehicleDocument,
)
from rotorid.vehicles import rig
from rotorid.vehicles.catalog import VEHICLES

RIG = "rig"
SWEPT = ("motor_3", "motor_4")
LOG_NAME = "flight.csv"


def move_rig(seed: int) -> FlightRecord:
    """A record of 120 s in which the motors of roll are swept."""
    require_seed(seed)
    return rig.fly(SWEPT, np.random.default_rng(seed))


def write_rig(path: Path, record: FlightRecord) -> None:
    """Write the record as CSV: motors and what was added to them, angles and rates."""
    topic = record.topics[0]
    write_csv(path, topic.time_s, {channel.name: topic.values[row] for row, channel in enumerate(topic.channels)})


def rig_document(record: FlightRecord, path: Path, *, seed: int, command: Sequence[str]) -> SimulationDocument:
    """What moved, what was true, and where the log is."""
    topic, known = record.topics[0], VEHICLES[RIG]
    model = library_model("rig.roll")
    return SimulationDocument(
        vehicle=VehicleDocument(name=RIG, description=known.summary, source=known.source, autopilot="simple"),
        logs=[
            SimulatedLogDocument(
                file=path.name,
                format="csv",
                sha256=sha256_of(path),
                seed=seed,
                duration_s=float(topic.time_s[-1] - topic.time_s[0]),
            )
        ],
        maneuvers=[
            ManeuverDocument(
                record=path.name,
                axis=one.axis,
                kind=one.kind,
                start_s=one.start_s,
                stop_s=one.stop_s,
                band_rad_s=one.band_rad_s,
                origin=one.origin,
                signal=one.signal,
            )
            for one in record.declared
        ],
        truth={
            parameter.name: TruthDocument(value=rig.TRUTH[parameter.name], unit=parameter.unit)
            for parameter in model.parameters
            if parameter.name in rig.TRUTH
        },
        provenance=ProvenanceDocument(
            version=__version__, command=list(command), inputs={}, settings={"swept": list(SWEPT)}, seed=seed
        ),
    )
