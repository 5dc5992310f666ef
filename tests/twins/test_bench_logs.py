"""A bench log of motors and an angle, nothing else: the rig's truth comes back, in the unit of the log.

Written as a logger writes it, about the trim of each motor: no channel declares a test input. The angle carries noise
of 5 %, a loop holds the rig, and its answers are in the inputs, so that the estimate is a direct one.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.documents.base import to_json
from rotorid.documents.compare import compare_document
from rotorid.documents.result import result_document, save
from rotorid.documents.vehicle import named_vehicle
from rotorid.errors import UsageError
from rotorid.flying.flown_models import fly_log
from rotorid.plot.paper import bode_figure
from rotorid.report.compare import shared_rows
from rotorid.report.parts import parameter_rows
from rotorid.results.model import IdentifiedModel
from rotorid.signal.excitations import find_excitations
from rotorid.vehicles import rig

MAP = """clock = "t"
channels.motor_3 = "U3 [{unit}]"
channels.motor_4 = "U4 [{unit}]"
channels.phi = "angle [deg]"
"""
UNITS = {
    "V": (6.0, 1.0, "N/V", rig.TRUTH["K_f"]),
    "%": (50.0, 8.0, "N", rig.TRUTH["K_f"] / 0.08),
    "us": (1500.0, 80.0, "N/us", rig.TRUTH["K_f"] / 80.0),
    "rpm": (5000.0, 700.0, "N s/rad", rig.TRUTH["K_f"] / (700.0 * np.pi / 30.0)),
}
"""Unit of the log to its trim and size of a volt, unit of the thrust gain, and its truth."""


@cache
def moved(seed: int) -> FlightRecord:
    return rig.fly(("motor_3", "motor_4"), np.random.default_rng(seed))


def logged(folder: Path, unit: str, seed: int = 1) -> FlightRecord:
    """The rig in a table with columns of one's own."""
    (topic,) = moved(seed).topics
    trim, size = UNITS[unit][:2]
    motors = [trim + size * topic.values[topic.row(name)] for name in ("motor_3", "motor_4")]
    rows = np.column_stack([topic.time_s, *motors, np.degrees(topic.values[topic.row("phi")])])
    np.savetxt(folder / "rig.csv", rows, delimiter=",", header="t,U3,U4,angle", comments="", fmt="%.8g")
    (folder / "rig.toml").write_text(MAP.format(unit=unit), encoding="utf-8")
    return rotorid.read(folder / "rig.csv", mapping=folder / "rig.toml")


@pytest.fixture(scope="module")
def volts(tmp_path_factory: pytest.TempPathFactory) -> FlightRecord:
    return logged(tmp_path_factory.mktemp("volts"), "V")


@pytest.fixture(scope="module")
def with_inertia(volts: FlightRecord) -> IdentifiedModel:
    return rotorid.identify([volts], "rig.roll", outputs=("phi",), fix={"J_x": rig.TRUTH["J_x"]})


@pytest.fixture(scope="module")
def with_nothing(volts: FlightRecord) -> IdentifiedModel:
    """Where neither the inertia nor the gain is given."""
    return rotorid.identify([volts], "rig.roll", outputs=("phi",))


@pytest.mark.parametrize("unit", UNITS)
def test_the_truth_comes_back_in_the_unit_of_the_log(tmp_path: Path, unit: str, with_inertia: IdentifiedModel) -> None:
    *_, gain_unit, truth = UNITS[unit]
    model = with_inertia
    if unit != "V":
        record = logged(tmp_path, unit)
        model = rotorid.identify([record], "rig.roll", outputs=("phi",), fix={"J_x": rig.TRUTH["J_x"]})
    expected = {"K_f": truth, "tau_3": rig.TRUTH["tau_3"], "tau_4": rig.TRUTH["tau_4"]}
    for name, value in expected.items():
        found = model.parameters[name]
        assert abs(found.value - value) < 2.0 * found.std, name
        assert found.std < 0.1 * value, name
    assert model.parameters["K_f"].unit == gain_unit
    assert f'"unit": "{gain_unit}"' in to_json(result_document(model))
    assert {finding.kind for finding in model.findings} >= {"closed_loop_bias"}


def test_inertia_follows_where_the_gain_is_known(volts: FlightRecord) -> None:
    model = rotorid.identify([volts], "rig.roll", outputs=("phi",), fix={"K_f": rig.TRUTH["K_f"]})
    found = model.parameters["J_x"]
    assert (found.unit, abs(found.value - rig.TRUTH["J_x"]) < 2.0 * found.std) == ("kg m^2", True)


def test_an_arm_that_was_not_given_is_said(volts: FlightRecord, with_inertia: IdentifiedModel) -> None:
    given = {"J_x": rig.TRUTH["J_x"], "L": 0.197}
    with_arm = rotorid.identify([volts], "rig.roll", outputs=("phi",), fix=given)
    (finding,) = (one for one in with_inertia.findings if one.kind == "assumed_geometry")
    assert "L = 0.197 m was assumed" in finding.message
    assert "--fix L=VALUE" in finding.message
    assert "assumed_geometry" not in {one.kind for one in with_arm.findings}


def test_what_the_data_do_not_show_has_no_value(with_nothing: IdentifiedModel) -> None:
    document = result_document(with_nothing)
    for row in (line for line in repr(with_nothing).splitlines() if line.split()[0] in ("J_x", "K_f")):
        assert row.split()[1] == "–"
        assert row.endswith("not identified")
    status = {row.name: (row.value, row.status) for row in parameter_rows(document, {})}
    assert status["J_x"] == status["K_f"] == ("–", "not identified")
    assert status["tau_3"][1] == "free"


def test_motors_in_two_units_fit_no_model(tmp_path: Path) -> None:
    logged(tmp_path, "V")
    mixed = MAP.format(unit="V").replace("U4 [V]", "U4 [rpm]")
    (tmp_path / "rig.toml").write_text(mixed, encoding="utf-8")
    with pytest.raises(UsageError, match=r"motor_3 is in V and motor_4 is in rad/s; expected one unit"):
        rotorid.identify([rotorid.read(tmp_path / "rig.csv", mapping=tmp_path / "rig.toml")], "rig.roll")


def test_a_model_of_volts_predicts_no_log_of_pulses(tmp_path: Path, volts: FlightRecord) -> None:
    pulses = logged(tmp_path, "us", seed=2)
    with pytest.raises(UsageError, match=r"are in us, and rig.roll is of motors in V"):
        rotorid.identify([volts], "rig.roll", outputs=("phi",), fix={"J_x": rig.TRUTH["J_x"]}, verify=[pulses])


def test_motors_at_their_limits_are_said(volts: FlightRecord) -> None:
    topic = volts.topics[0]
    values = np.array(topic.values)
    values[:2] = np.clip(values[:2], 5.7, 6.3)
    clipped = replace(volts, topics=(replace(topic, values=values),))
    with pytest.raises(rotorid.InsufficientDataError, match=r"no sweep of single motors.*at a limit were motor_3 for"):
        rotorid.identify([clipped], "rig.roll", outputs=("phi",))


def test_a_response_is_per_unit_of_the_log(tmp_path: Path) -> None:
    for unit, expected in {"V": "rad/V", "us": "rad/us", "rpm": "rad/(rad/s)", "%": "rad"}.items():
        found = rotorid.response([logged(tmp_path, unit)], inputs=("motor_3", "motor_4"), outputs=("phi",))
        assert found.pairs["phi/motor_3"].unit == expected
        drawn = bode_figure(found.response, output="phi", input="motor_3", magnitude="linear")
        assert drawn.axes[0].get_ylabel() == f"magnitude [{expected}]"


def one_voltage(seed: int) -> FlightRecord:
    """A rig in whose log one voltage drives both motors, the difference of the two."""
    rng = np.random.default_rng(seed)
    swept = rig.sweep(rng)
    moved = rig.move(np.stack([0.0 * swept, 0.0 * swept, swept, -swept]), rng)
    topic = moved.topics[0]
    channels = tuple(channel for channel in topic.channels if channel.name in ("motor_3", "phi"))
    drive = topic.values[topic.row("motor_3")] - topic.values[topic.row("motor_4")]
    values = np.stack([drive, topic.values[topic.row("phi")]])
    return replace(moved, declared=(), topics=(replace(topic, channels=channels, values=values),))


@pytest.mark.parametrize("seed", [1, 2])
def test_one_voltage_for_both_motors_shows_their_mean_delay(seed: int) -> None:
    model = rotorid.identify([one_voltage(seed)], "rig.roll", outputs=("phi",), fix={"J_x": rig.TRUTH["J_x"]})
    expected = {"K_f": rig.TRUTH["K_f"], "tau_3": 0.5 * (rig.TRUTH["tau_3"] + rig.TRUTH["tau_4"])}
    for name, value in expected.items():
        assert abs(model.parameters[name].value - value) < 2.0 * model.parameters[name].std, name
    (said,) = [finding for finding in model.findings if finding.where == "delays"]
    assert "motor_4 has no input of its own, so one delay stands for both motors" in said.message
    assert 0.02 < said.numbers["size"] < 0.05


def test_a_bench_is_swept_again_to_verify() -> None:
    model = rotorid.identify([one_voltage(1)], "rig.roll", outputs=("phi",), fix={"J_x": rig.TRUTH["J_x"]})
    (said,) = [finding for finding in model.findings if finding.kind == "not_verified"]
    assert said.message.endswith("Sweep again, and give that log with --verify.")


def test_a_fit_in_time_says_that_delays_are_taken_as_equal() -> None:
    model = rotorid.identify(
        [one_voltage(1)], "rig.roll", outputs=("phi",), fix={"J_x": rig.TRUTH["J_x"]}, method="output_error"
    )
    assert any("does not widen the intervals" in finding.message for finding in model.findings)


RIG = {"L": 0.22, "J_x": 0.031, "K_f": 0.085, "tau_3": 0.12, "tau_4": 0.09}


def held_by_both(folder: Path, seed: int) -> FlightRecord:
    """A rig of one's own in voltages alone: motors 3 and 4 are swept in turn, and both hold the angle all the time."""
    rng = np.random.default_rng(seed)
    step_s, length_s = 0.002, 60.0
    time_s = step_s * np.arange(int(150.0 / step_s))
    since_s = step_s * np.arange(int(length_s / step_s))
    omega = 0.5 + 9.5 * 0.0187 * np.expm1(4.0 * since_s / length_s)
    fades = np.minimum(1.0, np.minimum(since_s / 4.0, (length_s - since_s) / 2.0))
    swept = np.zeros((2, time_s.size))
    for motor, start_s in enumerate((8.0, 76.0)):
        first = round(start_s / step_s)
        swept[motor, first : first + since_s.size] = 0.9 * fades * np.sin(step_s * np.cumsum(omega))
    late = [round(RIG[name] / step_s) for name in ("tau_3", "tau_4")]
    pushes = 0.001 * np.sqrt(2.0 * step_s) * rng.standard_normal(time_s.size)
    volts, angle = [swept[0].tolist(), swept[1].tolist()], np.zeros(time_s.size)
    phi, rate, push, hold = 0.02, 0.0, 0.0, 0.0
    for k in range(time_s.size):
        hold = 1.2 * phi + 1.3 * rate if k % 5 == 0 else hold
        volts[0][k] -= hold
        volts[1][k] += hold
        thrust = (volts[0][k - late[0]] if k >= late[0] else 0.0) - (volts[1][k - late[1]] if k >= late[1] else 0.0)
        push += pushes[k] - step_s * push
        rate += step_s * (RIG["L"] * RIG["K_f"] * thrust + push) / RIG["J_x"]
        phi += step_s * rate
        angle[k] = phi
    degrees = 0.044 * np.round(np.degrees(angle[::5]) / 0.044) + 0.02 * rng.standard_normal(angle[::5].size)
    rows = np.column_stack([time_s[::5], *(5.5 + np.array(volts)[:, ::5]), degrees])
    np.savetxt(folder / "rig.csv", rows, delimiter=",", header="t,U3,U4,angle", comments="", fmt="%.5f")
    (folder / "rig.toml").write_text(MAP.format(unit="V"), encoding="utf-8")
    return rotorid.read(folder / "rig.csv", mapping=folder / "rig.toml")


@pytest.fixture(scope="module")
def held(tmp_path_factory: pytest.TempPathFactory) -> tuple[FlightRecord, IdentifiedModel]:
    record = held_by_both(tmp_path_factory.mktemp("rig"), 2)
    given = {"J_x": RIG["J_x"], "L": RIG["L"]}
    return record, rotorid.identify([record], "rig.roll", outputs=("phi",), fix=given)


def test_a_rig_that_both_motors_hold_shows_which_one_was_swept(held: tuple[FlightRecord, IdentifiedModel]) -> None:
    record, model = held
    assert [found.signal for found in find_excitations(record, "roll")] == ["motor_3", "motor_4"]
    assert model.fit.cost is not None
    assert model.fit.cost.average < 5.0
    assert not {finding.kind for finding in model.findings} & {"structure_error", "poor_fit"}
    for name in ("K_f", "tau_3", "tau_4"):
        found = model.parameters[name]
        assert abs(found.value - RIG[name]) < 2.0 * found.std < 0.1 * RIG[name], name


def test_an_angle_that_drifts_off_is_no_fault_of_the_model(held: tuple[FlightRecord, IdentifiedModel]) -> None:
    record, model = held
    whole, pieces = fly_log(model, record), fly_log(model, record, pieces_s=10.0)
    (said,) = [finding for finding in whole.findings if finding.kind == "open_loop_diverges"]
    assert said.numbers["fit_percent"] < 0.0
    assert said.numbers["fit_in_band_percent"] > 70.0
    assert "--pieces SECONDS" in said.message
    assert pieces.stretches[0].scores["phi"].nrmse_fit_percent > 30.0
    assert "open_loop_diverges" not in {finding.kind for finding in pieces.findings}


def test_a_comparison_shows_no_number_that_the_data_do_not(tmp_path: Path, with_nothing: IdentifiedModel) -> None:
    other = rotorid.identify([logged(tmp_path, "V", seed=2)], "rig.roll", outputs=("phi",))
    document = compare_document(rotorid.compare([with_nothing, other]))
    rows = {row.name: row for row in shared_rows(document)}
    for name in ("J_x", "K_f"):
        assert [cell.text for cell in rows[name].values] == ["not identified"] * 2
        assert [cell.text for cell in rows[name].distances] == ["", ""]
        assert not any(value.identified for value in document.parameters[name].values.values())
    assert "σ" in rows["tau_3"].distances[1].text


def test_a_rig_gets_no_wings_from_a_vehicle(tmp_path: Path, with_inertia: IdentifiedModel) -> None:
    save(with_inertia, tmp_path / "rig")
    with pytest.raises(UsageError, match=r"is a rig on a pivot, which does not fly.*leave out --like"):
        named_vehicle([str(tmp_path / "rig")], like="px4_quad")
