"""Short flights of a small vehicle in moving air, as logs, and what is true of them."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
from tests.twins.flight_flights import Case, FlightTwin, Motors, twin

from rotorid.data.record import FlightRecord
from rotorid.io.tables.csv import write_csv
from rotorid.models.rotors import SPINS, RotorLayout

DIAMETER_M = 0.2032


@lru_cache
def flown(motors: Motors = "speeds", seed: int = 0, mission: str = "eights", duration_s: float = 20.0) -> FlightTwin:
    """A flight, of 20 s by default."""
    return twin(Case("hummingbird", mission, motors, seed=seed, duration_s=duration_s))


def without(record: FlightRecord, *names: str) -> FlightRecord:
    """A log that lacks some channels."""
    from dataclasses import replace

    topics = []
    for topic in record.topics:
        rows = [row for row, channel in enumerate(topic.channels) if channel.name not in names]
        channels = tuple(topic.channels[row] for row in rows)
        topics.append(replace(topic, channels=channels, values=topic.values[rows]))
    return replace(record, topics=tuple(topics))


def layout_file(folder: Path, layout: RotorLayout | None = None) -> Path:
    """Its rotors as a TOML file."""
    rotors = layout or flown().layout
    spins = {value: name for name, value in SPINS.items()}
    tables = (
        f'[[rotor]]\nposition_m = {place}\nspin = "{spins[spin]}"\n'
        for place, spin in zip(rotors.positions.tolist(), rotors.spins.tolist(), strict=True)
    )
    file = folder / "rotors.toml"
    file.write_text("".join(tables), encoding="utf-8")
    return file


def log_file(folder: Path, record: FlightRecord | None = None, name: str = "flight.csv") -> Path:
    """A flight as CSV."""
    record = record or flown().record
    (topic,) = record.topics
    file = folder / name
    columns = {channel.name: np.asarray(row) for channel, row in zip(topic.channels, topic.values, strict=True)}
    write_csv(file, topic.time_s, columns)
    return file
