"""How often responses are measured: what was measured once is not measured again."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace

import numpy as np

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Maneuver, Source, Topic
from rotorid.flights.flights import Flight
from rotorid.flights.measure import Measured, measure
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.measuring import MeasureSettings


def swept_log() -> FlightRecord:
    """Noise in, and a rate with a lag of two samples out."""
    time_s = np.arange(0.0, 40.0, 0.02)
    command = np.random.default_rng(1).standard_normal(time_s.size)
    values = np.stack([command, np.convolve(command, [0.2, 0.5, 0.3])[: time_s.size]])
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in ("roll_command", "p"))
    topic = Topic(name="all", time_s=time_s, channels=channels, values=values)
    return FlightRecord(source=Source(name="flight.csv", format="CSV", sha256="0"), topics=(topic,))


SWEEP = Maneuver(axis="roll", kind="sweep", start_s=2.0, stop_s=38.0, band_rad_s=(2.0, 60.0))


def response_of(flight: Flight, settings: MeasureSettings) -> Measured:
    return measure([flight], inputs=("roll_command",), outputs=("p",), settings=settings)


def test_the_same_maneuvers_of_a_log_are_measured_once() -> None:
    flight = Flight(swept_log(), SWEEP)
    first = response_of(flight, MeasureSettings())
    assert response_of(Flight(flight.record, SWEEP), IdentifySettings(fix={"L_p": -1.0})) is first
    for other in (
        response_of(replace(flight, maneuver=replace(SWEEP, stop_s=30.0)), MeasureSettings()),
        response_of(flight, MeasureSettings(overlap=0.5)),
        response_of(flight, MeasureSettings(shifts={"p": 0.01})),
        response_of(Flight(swept_log(), SWEEP), MeasureSettings()),
    ):
        assert other is not first


def test_a_measurement_does_not_keep_its_log() -> None:
    flight = Flight(swept_log(), SWEEP)
    kept = response_of(flight, MeasureSettings())
    log = weakref.ref(flight.record)
    del flight
    gc.collect()
    assert log() is None
    assert kept.response.values.size
