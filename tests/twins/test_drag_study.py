"""How often the intervals of drag and wind of ordinary flights contain the truth, and how often there is none."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.twins.flight_flights import AIR, Case, twin
from tests.twins.tilt_flights import tilt_flights

from rotorid.data.flight_plan import SimulatedFlight
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.errors import InsufficientDataError
from rotorid.flights.tilt_drag import TiltDrag, tilt_drag
from rotorid.flying.simulation import everyday_plan
from rotorid.simulation.multirotor_flight import fly_multirotor, piloted
from rotorid.simulation.wind import Wind
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.vehicles.catalog import aircraft

MADE: Mapping[str, dict[str, Any]] = {
    "calm": {},
    "gusts, turning": {"wind_m_s": (3.0, -2.0), "gust_m_s": 0.6, "turning_rad_s": 0.06},
    "gusts, loop on the speed": {"wind_m_s": (3.0, -2.0), "gust_m_s": 0.6, "turning_rad_s": 0.06, "hold_1_s": 1.0},
    "small tilts in gusts": {"wind_m_s": (3.0, 0.0), "gust_m_s": 0.8, "tilt_rad": 0.04},
    "velocity wrong by 0.5 m/s": {"velocity_error_m_s": 0.5, "tilt_rad": 0.06, "turning_rad_s": 0.06},
    "accelerometer 5 cm high": {"height_m": -0.05, "tilt_rad": 0.06, "stick_s": 1.0},
    "turns at speed": {"tilt_rad": 0.25, "stick_s": 5.0, "turning_rad_s": 0.4},
}
COUNT, SEEDS = 40, 3


class Judged(NamedTuple):
    """A flight and what is true of it."""

    group: str
    record: FlightRecord
    drag_1_s: float
    wind: tuple[float, float]


def made() -> Iterator[Judged]:
    for place, (name, settings) in enumerate(MADE.items()):
        wind = settings.get("wind_m_s", (0.0, 0.0))
        for record in tilt_flights(COUNT, seed=900 + place, **settings):
            yield Judged(name, record, 0.3, wind)


def simulated() -> Iterator[Judged]:
    """Fast flights of four vehicles, and sticks of two of the library, with the drag of the rotors at one g."""
    for vehicle in AIR:
        for mission in ("steps", "eights", "climbs", "slow"):
            for wind in ((0.0, 0.0, 0.1), (2.0, -1.0, 0.3)):
                for seed in range(SEEDS):
                    flown_twin = twin(Case(vehicle, mission, "speeds", wind, "basic", 40 + seed))
                    record = flown_twin.record
                    faster = float(np.mean(np.sqrt(np.maximum(-record["az"].values, 0.0) / STANDARD_GRAVITY_M_S2)))
                    speeds = (
                        sum(float(np.mean(record[f"motor_speed_{rotor}"].values)) for rotor in range(1, 5)) / faster
                    )
                    drag = flown_twin.truth["k_d"] * speeds / flown_twin.truth["m"]
                    yield Judged(f"{mission}, {'calm' if wind[0] == 0.0 else 'wind'}", record, drag, flown_twin.wind)
    for vehicle, drag in (("px4_quad", 1.0), ("iris", 0.37)):
        craft = piloted(aircraft(vehicle))
        for blows in (0.0, 2.0, 4.0):
            for seed in range(SEEDS):
                plan = everyday_plan(craft, duration_s=90.0, level=0.5, seed=seed)
                air = Wind(north_m_s=blows, turbulence_m_s=0.2 * blows)
                flight = fly_multirotor(craft, plan, wind=air, seed=seed)
                blew = [float(flight.truth[name].mean()) for name in ("wind_north", "wind_east")]
                yield Judged(f"sticks, {blows:g} m/s", logged(flight), drag, (blew[0], blew[1]))


LOGGED = ("ax", "ay", "az", "phi", "theta", "psi", "velocity_north", "velocity_east", "velocity_down")


def logged(flight: SimulatedFlight) -> FlightRecord:
    values = np.stack([flight.columns[name] for name in LOGGED])
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in LOGGED)
    time_s = np.arange(flight.samples) / flight.sample_rate_hz
    topic = Topic(name="flight", time_s=time_s, channels=channels, values=values)
    return FlightRecord(source=Source(name="sticks", format="twin", sha256=""), topics=(topic,))


def judged(one: Judged) -> TiltDrag | None:
    try:
        return tilt_drag(one.record, ((one.record.start_s, one.record.stop_s),))
    except InsufficientDataError:
        return None


def table(flights: Callable[[], Iterator[Judged]]) -> dict[str, list[tuple[Judged, TiltDrag | None]]]:
    groups: dict[str, list[tuple[Judged, TiltDrag | None]]] = {}
    for one in flights():
        groups.setdefault(one.group, []).append((one, judged(one)))
    return groups


@pytest.mark.slow
@pytest.mark.parametrize("flights", [made, simulated])
def test_intervals_of_drag_and_wind_contain_the_truth(flights: Callable[[], Iterator[Judged]]) -> None:
    drags: list[float] = []
    winds: list[float] = []
    for group, rows in table(flights).items():
        found = [(one, drag) for one, drag in rows if drag is not None]
        each = [(drag.drag.value - one.drag_1_s) / drag.drag.std for one, drag in found]
        blown = [
            (quantity.value - truth) / quantity.std
            for one, drag in found
            for quantity, truth in zip((drag.wind_north, drag.wind_east), one.wind, strict=True)
            if quantity is not None
        ]
        print(f"| {group} | {len(found)} of {len(rows)} | {row(found, each, blown)} |")
        drags += each
        winds += blown
    print(f"drag {within(drags):.3f} of {len(drags)}, wind {within(winds):.3f} of {len(winds)}")
    assert within(drags) >= 0.90
    assert within(winds) >= 0.90


def row(found: list[tuple[Judged, TiltDrag]], each: list[float], blown: list[float]) -> str:
    """Share of intervals, rms of error over stated, median error, stated and error of plain regression, and winds."""
    if not found:
        return "–"
    off, plain = (
        np.median([abs(getattr(drag, name).value / one.drag_1_s - 1.0) for one, drag in found])
        for name in ("drag", "plain")
    )
    stated = np.median([drag.drag.std / one.drag_1_s for one, drag in found])
    rms = math.sqrt(float(np.mean(np.square(each))))
    shares = " | ".join(f"{100.0 * share:.1f} %" for share in (off, stated, plain))
    return f"{100.0 * within(each):.0f} % | {rms:.2f} | {shares} | {100.0 * within(blown):.0f} %"


def within(deviations: list[float]) -> float:
    return float(np.mean(np.abs(deviations) < 1.96))
