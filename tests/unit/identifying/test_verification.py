"""Judging a model on other logs: several inputs and outputs, filters, segments."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rotorid.checking import linear
from rotorid.checking.candidate import Candidate, read_candidate
from rotorid.checking.maneuvers import with_known_delays
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Maneuver, Source, Topic
from rotorid.documents.base import ManeuverDocument, ProvenanceDocument
from rotorid.documents.verify import verify_document
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.excitation.switching import doublet
from rotorid.identifying.verification import verify
from rotorid.models.library import rate_model
from rotorid.models.toml import from_toml
from rotorid.settings.parsing import parse_segment
from rotorid.settings.verifying import VerifySettings
from rotorid.simulation.hover_flight import STEP_RATE_HZ, Excitation, Flight, fly
from rotorid.vehicles import s500
from rotorid.vehicles.demo import demo_plan

BAND = (0.6, 50.0)
LATERAL = """
name = "lateral"
inputs = ["roll_command", "yaw_command"]
states = ["p", "r", "v", "phi"]
outputs = ["p", "r", "ay"]
F = [["L_p", "L_r", "L_v", "0"], ["N_p", "N_r", "N_v", "0"], ["Y_p", "Y_r", "Y_v", "9.80665"], ["1", "0", "0", "0"]]
G = [["L_roll", "L_yaw"], ["N_roll", "N_yaw"], ["Y_roll", "Y_yaw"], ["0", "0"]]
H0 = [["1", "0", "0", "0"], ["0", "1", "0", "0"], ["0", "0", "0", "-9.80665"]]
H1 = [["0", "0", "0", "0"], ["0", "0", "0", "0"], ["0", "0", "1", "0"]]
input_delays = ["tau_roll", "tau_yaw"]
"""


def model_text(**changed: float) -> str:
    """The lateral model of the S500 as a file, with some values changed."""
    values = {**s500.LATERAL, **changed}
    units = {name: "s" if name.startswith("tau") else "1" for name in values}
    return LATERAL + "".join(
        f'[parameters.{name}]\nvalue = {value!r}\nunit = "{units[name]}"\n' for name, value in values.items()
    )


def candidate(**changed: float) -> Candidate:
    structure = from_toml(model_text(**changed))
    return Candidate(structure=structure, band_rad_s=BAND)


def recorded(flight: Flight, name: str = "flight.csv") -> FlightRecord:
    channels = tuple(Channel(name=n, unit=STANDARD_UNITS[n], source=f"CSV.{n}") for n in flight.columns)
    topic = Topic(name="CSV", time_s=flight.time_s, channels=channels, values=np.stack(list(flight.columns.values())))
    axes = ("roll", "pitch", "yaw", "thrust")
    return FlightRecord(
        source=Source(name=name, format="CSV", sha256=name),
        topics=(topic,),
        declared=flight.maneuvers,
        instruments={axis: (f"{axis}_excitation",) for axis in axes},
    )


@pytest.fixture(scope="module")
def doublets() -> FlightRecord:
    """A roll and a yaw doublet in calm air."""
    plan = []
    for axis, amplitude, start_s in (("roll", 0.1, 5.0), ("yaw", 0.3, 11.0)):
        values = doublet(amplitude=amplitude, pulse_s=0.3, sample_rate_hz=STEP_RATE_HZ, trim_s=0.0)
        maneuver = Maneuver(
            axis=axis, kind="doublet", start_s=start_s, stop_s=start_s + 0.6, origin="declared",  # type: ignore[arg-type]
            signal=f"{axis}_excitation",
        )  # fmt: skip
        plan.append(Excitation(maneuver=maneuver, values=values, sample_rate_hz=STEP_RATE_HZ))
    return recorded(fly(s500.vehicle(), plan, turbulence_m_s=0.01, rng=np.random.default_rng(0)))


@pytest.fixture(scope="module")
def sweeps() -> FlightRecord:
    """The roll and yaw sweeps of the demonstration, one of each."""
    rng = np.random.default_rng(2)
    plan = [part for part in demo_plan(rng=rng) if part.maneuver.kind == "sweep"]
    roll, yaw = (next(p for p in plan if p.maneuver.axis == axis) for axis in ("roll", "yaw"))
    moved = replace(yaw.maneuver, start_s=roll.maneuver.stop_s + 3.0, stop_s=roll.maneuver.stop_s + 53.0)
    return recorded(fly(s500.vehicle(), (roll, replace(yaw, maneuver=moved)), rng=rng), "sweeps.csv")


def kinds(verified: object) -> set[str]:
    return {finding.kind for finding in verify_document(verified).findings}  # type: ignore[attr-defined]


def test_the_right_model_is_not_called_poor(doublets: FlightRecord) -> None:
    verified = verify(candidate(), [doublets])
    assert [one.verdict for one in verify_document(verified).maneuvers] == ["good", "good"]
    assert "poor_verification" not in kinds(verified)
    first = verify_document(verified).maneuvers[0]
    assert first.growth_1_s == pytest.approx(1.871, abs=1e-3)
    assert {horizon.horizon_s for horizon in first.ahead} == {0.5, 1.0}
    assert first.biases.keys() == {"p", "r", "v", "phi"}
    assert first.trim is not None
    assert first.trim.hover


@pytest.mark.parametrize("wrong", [{"L_roll": 1.3 * 153.4}, {"L_v": 6.7}, {"tau_roll": 0.091}])
def test_a_wrong_model_is(wrong: dict[str, float], doublets: FlightRecord) -> None:
    assert "poor_verification" in kinds(verify(candidate(**wrong), [doublets]))


def test_what_was_fitted_is_shown_as_seen(doublets: FlightRecord) -> None:
    fitted = ProvenanceDocument(
        version="1",
        command=[],
        inputs={"flight.csv": doublets.source.sha256},
        settings={},
        seed=0,
        maneuvers=[
            ManeuverDocument(
                record="flight.csv", axis="roll", kind="sweep", start_s=5.3, stop_s=6.0, origin="given", signal=""
            )
        ],
    )
    verified = verify(replace(candidate(), provenance=fitted), [doublets])
    seen = [finding for finding in verify_document(verified).findings if finding.kind == "seen_data"]
    assert [(one.severity, one.numbers["start_s"]) for one in seen] == [("warning", 5.0)]
    assert "seen_data" not in kinds(verify(candidate(), [doublets]))


def test_a_segment_is_judged_alone(doublets: FlightRecord) -> None:
    verified = verify(candidate(), [doublets], settings=VerifySettings(segments=(parse_segment("yaw:11:11.6"),)))
    assert [(one.axis, one.start_s) for one in verify_document(verified).maneuvers] == [("yaw", 11.0)]


def test_the_guideline_is_scaled_only_when_asked(doublets: FlightRecord) -> None:
    assert verify_document(verify(candidate(), [doublets])).j_rms_guideline is None
    scaled = verify_document(verify(candidate(), [doublets], settings=VerifySettings(scale=16.0))).j_rms_guideline
    assert scaled is not None
    assert (scaled.root, scaled.printed) == ((4.0, 8.0), (16.0, 32.0))


@pytest.mark.parametrize("scale", [0.0, -1.0, np.inf])
def test_an_impossible_scale_is_refused(scale: float) -> None:
    with pytest.raises(UsageError, match="scale"):
        VerifySettings(scale=scale)


def without(record: FlightRecord, *names: str) -> FlightRecord:
    (topic,) = record.topics
    kept = [row for row, channel in enumerate(topic.channels) if channel.name not in names]
    fewer = replace(topic, values=topic.values[kept], channels=tuple(topic.channels[row] for row in kept))
    return replace(record, topics=(fewer,))


def test_outputs_that_a_log_lacks_are_left_out_and_named(doublets: FlightRecord, sweeps: FlightRecord) -> None:
    verified = verify(candidate(), [without(doublets, "ay"), without(sweeps, "ay")])
    assert {frozenset(one.scores) for one in verify_document(verified).maneuvers} == {frozenset({"p", "r"})}
    assert {name.split("/")[0] for name in verify_document(verified).frequency[0].pairs} <= {"p", "r"}
    missing = [finding.where for finding in verify_document(verified).findings if finding.kind == "missing_channel"]
    assert sorted(missing) == ["flight.csv: ay", "sweeps.csv: ay"]


@pytest.mark.parametrize("names", [("roll_command",), ("p", "r", "ay")])
def test_a_log_that_cannot_judge_says_why(names: tuple[str, ...], doublets: FlightRecord) -> None:
    with pytest.raises(InsufficientDataError, match=names[0]) as caught:
        verify(candidate(), [without(doublets, *names)])
    assert [finding.kind for finding in caught.value.findings] == ["not_verified"]


def test_sweeps_are_judged_by_response_and_carry_it_along(sweeps: FlightRecord) -> None:
    verified = verify(candidate(), [sweeps])
    (judged,) = verified.found.sweeps
    assert judged.response is not None
    assert judged.model_response is not None
    assert judged.used is not None
    assert judged.response.values.shape == judged.model_response.shape == judged.used.shape
    # The responses that matter: each command to its own rate, and the side force of roll.
    assert {"p/roll_command", "r/yaw_command", "ay/roll_command"} <= judged.pairs.keys()
    for name, pair in judged.pairs.items():
        output, given = name.split("/")
        y, u = judged.response.pair(output, given)
        omega = judged.response.omega_rad_s[judged.used[y, u]]
        assert (pair.points, pair.band_rad_s) == (omega.size, (omega[0], omega[-1]))
        assert BAND[0] <= omega[0] < omega[-1] <= BAND[1]
    (document,) = verify_document(verified).frequency
    assert {name: pair.value for name, pair in document.pairs.items()} == judged.costs
    assert all(judged.costs[name] < 100.0 for name in ("p/roll_command", "r/yaw_command"))


def test_what_was_covered_is_said(sweeps: FlightRecord) -> None:
    covered = verify_document(verify(candidate(), [sweeps])).covered
    assert covered["thrust_command"].lowest < 0.5 < covered["thrust_command"].highest
    assert {"p", "r", "phi", "roll_command"} <= covered.keys()


class TestFilters:
    """A gyro behind the autopilot's filter shows the model later."""

    record = FlightRecord(
        source=Source(name="log.ulg", format="PX4 ULog", sha256=""),
        topics=(),
        parameters={"IMU_GYRO_CUTOFF": 40.0, "IMU_GYRO_NF0_FRQ": 0.0, "IMU_GYRO_NF0_BW": 20.0},
    )
    system = rate_model("rate.roll").matrices({"L_roll": 100.0, "L_p": -1.0, "T_motor": 0.05, "tau_roll": 0.02})
    raw, filtered = {"p": "sensor_combined.gyro_rad[0]"}, {"p": "vehicle_angular_velocity.xyz[0]"}

    def test_later(self) -> None:
        shifted, findings = with_known_delays(self.system, self.record, ("p",), fitted=self.raw, judged=self.filtered)
        assert 0.005 < shifted.output_delays_s[0] < 0.006
        assert [finding.kind for finding in findings] == ["known_filter"]

    def test_and_back(self) -> None:
        later, _ = with_known_delays(self.system, self.record, ("p",), fitted=self.raw, judged=self.filtered)
        sooner, _ = with_known_delays(self.system, self.record, ("p",), fitted=self.filtered, judged=self.raw)
        omega = np.array([10.0])
        turned = later.response(omega) * sooner.response(omega) / self.system.response(omega) ** 2
        assert abs(turned[0, 0, 0] - 1.0) < 1e-12

    @pytest.mark.parametrize("fitted", [{}, {"p": "vehicle_angular_velocity.xyz[0]"}])
    def test_where_nothing_is_known_or_different_nothing_is_shifted(self, fitted: dict[str, str]) -> None:
        same, findings = with_known_delays(self.system, self.record, ("p",), fitted=fitted, judged=self.filtered)
        assert same is self.system
        assert findings == ()


class TestReading:
    """A model is found behind a folder, a result or a model file."""

    def write(self, folder: Path, **changed: object) -> None:
        (folder / "model.toml").write_text(model_text())
        pairs = {"p/roll_command": {"band_rad_s": [2.0, 30.0]}, "r/yaw_command": {"band_rad_s": [1.0, 20.0]}}
        table = {"schema": "rotorid.result/1", "model": "lateral", "cost": {"pairs": pairs}} | changed
        (folder / "result.json").write_text(json.dumps(table))

    @pytest.mark.parametrize("name", ["", "result.json", "model.toml"])
    def test_by_any_name(self, name: str, tmp_path: Path) -> None:
        self.write(tmp_path)
        found = read_candidate(tmp_path / name)
        assert found.band_rad_s == (1.0, 30.0)
        assert found.structure.parameters["L_roll"].value == s500.LATERAL["L_roll"]

    def test_the_file_that_was_given_is_read(self, tmp_path: Path) -> None:
        self.write(tmp_path)
        table = json.loads((tmp_path / "result.json").read_text())
        (tmp_path / "mine.json").write_text(json.dumps(table | {"cost": None}))
        assert read_candidate(tmp_path / "mine.json").band_rad_s is None
        (tmp_path / "mine.json").write_text(json.dumps(table | {"parameters": {"L_roll": {"value": 1.0}}}))
        with pytest.raises(UsageError, match="has other values"):
            read_candidate(tmp_path / "mine.json")

    def test_a_model_alone_has_no_band(self, tmp_path: Path) -> None:
        self.write(tmp_path)
        (tmp_path / "result.json").unlink()
        assert read_candidate(tmp_path / "model.toml").band_rad_s is None

    def test_a_result_of_another_model_is_refused(self, tmp_path: Path) -> None:
        self.write(tmp_path, model="other")
        with pytest.raises(UsageError, match="not the result of"):
            read_candidate(tmp_path)
        assert read_candidate(tmp_path / "model.toml").band_rad_s is None

    @pytest.mark.parametrize("text", ["[]", "{", '{"schema": "rotorid.verify/1"}'])
    def test_what_is_no_result_is_refused(self, text: str, tmp_path: Path) -> None:
        self.write(tmp_path)
        (tmp_path / "result.json").write_text(text)
        with pytest.raises(UsageError):
            read_candidate(tmp_path / "result.json")

    def test_nothing_there(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="does not exist"):
            read_candidate(tmp_path / "nowhere")


def test_a_log_that_fails_leaves_the_other(doublets: FlightRecord, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = linear._attempts

    def attempts(*given: Any) -> Any:
        def broken() -> Any:
            raise KeyError("channel")

        return [
            (logs, broken if any(log.record.source.name == "other.csv" for log in logs) else attempt)
            for logs, attempt in whole(*given)
        ]

    monkeypatch.delenv("ROTORID_STRICT", raising=False)
    monkeypatch.setattr(linear, "_attempts", attempts)
    other = replace(doublets, source=replace(doublets.source, name="other.csv", sha256="other"))
    verified = verify(candidate(), [doublets, other])
    assert {check.record for check in verify_document(verified).maneuvers} == {doublets.source.name}
    (said,) = [finding for finding in verified.findings if finding.kind == "not_verified"]
    assert said.where == "other.csv"
    assert "KeyError" in said.message
