"""The order and directions of motors from flights whose rotors are known, with every order claimed.

Logs in which the motors are logged at 40 Hz and more; of ArduPilot the motors follow from faster commands.
``idsia_multisine_20251017_run4`` has motors that are out of step with its gyro, and is counted all the same.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from tests.reference.motor_flights import iris_record

import rotorid
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.flights.rotor_order import RotorOrder, rotor_order, window_orders
from rotorid.models.autopilots.layouts import layout_of
from rotorid.models.rotors import SPINS, RotorLayout, library_layout

Unpacked = Callable[[str], Path]

AUTOPILOT_LOGS = (
    *(f"px4_sitl/{name}" for name in ("roll.ulg", "pitch.ulg.xz", "thrust.ulg.xz", "verify.ulg.xz", "yaw.ulg.xz")),
    *(f"ardupilot_sitl/x_{name}" for name in ("calm_roll.BIN", "calm_thrust.BIN.xz", "calm_verify.BIN.xz")),
    *(f"ardupilot_sitl/x_wind_{name}.BIN.xz" for name in ("rollpitch", "yawthrust")),
    *("betaflight/smooth_tune.BBL", "crazyflie/log10", "everyday/betaflight_431_freestyle.bbl.xz"),
    *("everyday/betaflight_damaged_test_log.BFL.xz", "everyday/px4_115_s500.ulg.xz"),
    *(f"real_stacks/ap_x_{name}.BIN.xz" for name in ("guided_multisine", "wind_limit_cycle", "wind_soft_card_flight")),
    *(f"real_stacks/ap_x_wind_soft_{name}.BIN.xz" for name in ("tuned_card_flight", "wide")),
)
CRAZYFLIES = (
    *(f"flight/nanobench_{name}.csv.xz" for name in ("B2_circle_fast_rep2", "B3_figure8_fast_rep2")),
    *(f"flight/nanobench_{name}.csv.xz" for name in ("B6_linear_ramp_rep1", "B8_star_fast_rep1")),
    *(f"flight/idsia_multisine_20251017_run{run}.parquet.xz" for run in (3, 4)),
    *(f"flight/idsia_{name}.parquet.xz" for name in ("random1_20251017_run4", "random2_20251017_run2")),
    *(f"flight/idsia_square_20251017_run{run}.parquet.xz" for run in (1, 3)),
)
NEUROBEM = ("20210218171908seg2", "20210223104803seg2", "20210223114138seg3")
BEM_LAYOUT = RotorLayout(
    name="neurobem",
    positions=np.array([[-0.075, 0.1, 0.0], [0.075, 0.1, 0.0], [-0.075, -0.1, 0.0], [0.075, -0.1, 0.0]]),
    spins=np.array([SPINS[spin] for spin in ("cw", "ccw", "ccw", "cw")]),
    arm_known=True,
)
TURNED = {"everyday/betaflight_431_freestyle.bbl.xz": "quad.x.betaflight.reversed"}
"""Rotors that turn the other way than their autopilot's default, by the mixer in the log."""

DECIDED = 0.6
"""Least share of the windows in which motors explain roll and pitch that has to be decided."""

MAPPINGS = Path(__file__).resolve().parents[2] / "docs" / "mappings"


def flights(unpacked: Unpacked) -> Iterator[tuple[FlightRecord, RotorLayout]]:
    for name in AUTOPILOT_LOGS:
        record = rotorid.read(unpacked(name))
        yield record, library_layout(TURNED[name]) if name in TURNED else layout_of(record)
    for name in CRAZYFLIES:
        mapping = MAPPINGS / ("nanobench.toml" if "nanobench" in name else "idsia_nanodrone.toml")
        yield rotorid.read(unpacked(name), mapping=mapping), library_layout("quad.x.crazyflie")
    for name in NEUROBEM:
        yield bem_record(unpacked(f"flight/neurobem_{name}.mat.xz")), BEM_LAYOUT
    yield made_record(unpacked("iris_sim/quadrotor_model.csv")), library_layout("quad.x")


def bem_record(path: Path) -> FlightRecord:
    from scipy.io import loadmat

    table = next(value for name, value in loadmat(path).items() if not name.startswith("__"))
    names = [*"pqr", *(f"motor_speed_{motor}" for motor in range(1, 5))]
    rows = np.vstack([table[:, 4:7].T * np.array([[1.0], [-1.0], [-1.0]]), table[:, 20:24].T])
    return _record(path.name, table[:, 0], names, rows)


def made_record(path: Path) -> FlightRecord:
    flight = iris_record(path, smooth=False)
    time_s = np.arange(flight.samples) / flight.sample_rate_hz
    return _record(path.name, time_s, [*(f"motor_{k}" for k in range(1, 5)), *"pqr"], [*flight.outputs, *flight.rates])


def _record(name: str, time_s: np.ndarray, names: list[str], rows: object) -> FlightRecord:
    channels = tuple(Channel(name=channel, unit=STANDARD_UNITS[channel]) for channel in names)
    topic = Topic(name="t", time_s=time_s, channels=channels, values=np.array(rows))
    return FlightRecord(source=Source(name=name, format="CSV", sha256=""), topics=(topic,))


def reordered(layout: RotorLayout, order: tuple[int, ...]) -> RotorLayout:
    numbers = list(order)
    return replace(layout, positions=layout.positions[numbers], spins=layout.spins[numbers], yaw_weights=None)


@pytest.mark.parametrize(
    ("name", "wrong", "typed"),
    [("betaflight/smooth_tune.BBL", "quad.x", "quad.x.betaflight"), ("crazyflie/log10", "quad.x", "quad.x.clockwise")],
    ids=["betaflight", "crazyflie"],
)
def test_the_order_of_a_real_flight_is_right_and_another_is_named_wrong(
    unpacked: Unpacked, name: str, wrong: str, typed: str
) -> None:
    record = rotorid.read(unpacked(name))
    own = rotor_order(record, layout_of(record))
    assert (own.verdict, own.directions) == ("fits", "fits")
    other = rotor_order(record, library_layout(wrong))
    assert other.verdict == "wrong"
    assert other.to_type == f"--layout {typed}"


def kinds(found: RotorOrder, claimed: RotorLayout, truth: RotorLayout) -> Iterator[str]:
    """What a window counts as: of the order, and of the directions where they are decided."""
    if found.verdict == "not enough data":
        because = found.why.split(":")[0].rstrip(".")
        unexplained = "explain too little" in because or "follow the motion" in because or "do not move" in because
        yield because if unexplained else "undecided"
        return
    same = found.fitting is not None and np.allclose(found.fitting.positions, truth.positions)
    fits = np.allclose(claimed.positions, truth.positions)
    yield "right" if same and (found.verdict == "fits") == fits else "wrong"
    if found.fitting is not None and found.directions != "not enough data":
        turns = np.array_equal(found.fitting.spins, truth.spins)
        yield f"directions {'right' if turns else 'wrong'}"


def test_a_soft_controller_in_noise_names_no_other_order(unpacked: Unpacked) -> None:
    """At a correlation of 0.5 one window of 5 s does."""
    record = rotorid.read(unpacked("real_stacks/ap_x_guided_multisine.BIN.xz"))
    assert "wrong" not in {found.verdict for found in window_orders(record, layout_of(record), window_s=5.0)}


def test_motors_that_turn_the_other_way_by_the_mixer_are_not_found_to_turn_as_named(unpacked: Unpacked) -> None:
    """No header says so; the yaw command, which the autopilot mixes by the directions, does."""
    record = rotorid.read(unpacked("everyday/betaflight_431_freestyle.bbl.xz"))
    layout = layout_of(record)
    motors = np.stack([record[name].values for name in layout.motor_names])
    free = (motors.min(axis=0) > 0.1) & (motors.max(axis=0) < 0.95)
    mixed = np.corrcoef((layout.spins @ motors)[free], record["yaw_command"].values[free])[0, 1]
    assert mixed < -0.99
    windows = window_orders(record, layout, window_s=5.0)
    decided = {(found.directions, found.to_type) for found in windows if found.directions != "not enough data"}
    assert decided <= {("wrong", "--layout quad.x.betaflight.reversed")}


@pytest.mark.slow
def test_all_orders_of_all_flights_in_windows(unpacked: Unpacked) -> None:
    """No order or direction is decided wrongly, whichever is claimed; most explained windows are decided."""
    counts: Counter[tuple[float, str]] = Counter()
    for record, truth in flights(unpacked):
        whole = rotor_order(record, truth)
        assert whole.verdict != "wrong", record.source.name
        for window_s in (5.0, 10.0):
            for order in permutations(range(truth.rotors)):
                claimed = reordered(truth, order)
                for found in window_orders(record, claimed, window_s=window_s):
                    counts.update((window_s, kind) for kind in kinds(found, claimed, truth))
    print({f"{window:g} s {kind}": count / 24 for (window, kind), count in sorted(counts.items())})
    assert not [key for key in counts if "wrong" in key[1]]
    right = sum(count for (_, kind), count in counts.items() if kind == "right")
    undecided = sum(count for (_, kind), count in counts.items() if kind == "undecided")
    assert right / (right + undecided) >= DECIDED
