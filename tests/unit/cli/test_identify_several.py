"""Several models in one run: each stands or is refused by itself, into one folder, one report, one list of results."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from tests.unit.cli.commands import rotorid

import rotorid as api
from rotorid.cli.identify import _unknown
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.errors import ModelError
from rotorid.flights.supports import supported_models
from rotorid.identifying.identify_many import identify_several
from rotorid.io.tables.csv import write_csv
from rotorid.results.model import IdentifiedModel
from rotorid.results.summary import ParameterEstimate

pytestmark = pytest.mark.usefixtures("computed_once")


def test_each_model_has_its_folder_and_all_share_a_report(flight: Path, tmp_path: Path) -> None:
    ran = rotorid("identify", flight, "--model", "rate.roll,rate.yaw", "--band", "12:50", "--out", tmp_path, "--json")
    assert ran.code == 0  # one model stands
    told = json.loads(ran.out)
    assert told["schema"] == "rotorid.results/1"
    stands, refused = told["results"]
    assert (stands["model"], refused["model"]) == ("rate.roll", "rate.yaw")
    assert stands["schema"] == "rotorid.result/1"
    assert "parameters" not in refused
    assert any(finding["severity"] == "error" for finding in refused["findings"])
    assert stands["provenance"]["command"][:2] == ["rotorid", "identify"]
    assert (tmp_path / "results.json").read_text(encoding="utf-8") == ran.out
    assert {path.name for path in (tmp_path / "rate.roll").iterdir()} >= {"result.json", "model.toml", "responses.npz"}
    assert api.load(tmp_path / "rate.roll")["L_roll"].value == pytest.approx(stands["parameters"]["L_roll"]["value"])


def test_a_second_model_is_not_the_only_one_that_counts(flight: Path, tmp_path: Path) -> None:
    ran = rotorid(
        "identify", flight, "--model", "rate.yaw", "--model", "rate.roll", "--band", "12:50", "--out", tmp_path
    )
    assert ran.code == 0
    assert "rate.yaw: no model" in ran.out
    assert "L_roll" in ran.out
    assert ran.out.splitlines()[0].split() == ["model", "fit", "warnings", "parameters"]


def test_a_parameter_with_an_error_above_its_value_is_marked() -> None:
    known = {
        name: ParameterEstimate(value=value, std=std, unit="1/s", status="free")
        for name, value, std in (("L_p", -2.0, 0.1), ("X_pitch", 2.0, 4.9), ("M_u", -1.0, 1.52))
    }
    assert _unknown(known) == ". Not determined: X_pitch ±245 %, M_u ±152 %"
    assert not _unknown({"L_p": known["L_p"]})
    zero = ParameterEstimate(value=0.0, std=2.6, unit="N", status="free")
    assert _unknown({"c_2": zero}) == ". Not determined: c_2 over ±1000 %"


def test_none_that_stands_is_a_refusal(flight: Path, tmp_path: Path) -> None:
    ran = rotorid("identify", flight, "--model", "rate.yaw,rate.vertical", "--out", tmp_path / "out", "--json")
    assert ran.code == 1
    assert [("parameters" in result) for result in json.loads(ran.out)["results"]] == [False, False]
    assert "not enough data for rate.yaw or rate.vertical" in ran.err
    assert not (tmp_path / "out").exists()


def test_all_is_what_the_log_may_support(flight: Path) -> None:
    record = api.read(flight)
    names = supported_models([record])
    assert "rate.roll" in names
    assert "rate.yaw" not in names
    answers = identify_several(record, "all", band_rad_s=(12.0, 50.0))
    assert tuple(answers) == names
    assert isinstance(answers["rate.roll"], IdentifiedModel)


@pytest.mark.parametrize(("rate_hz", "serves"), [(50.0, True), (39.0, False)])
def test_ordinary_flying_serves_rate_models_from_forty_hertz_on(rate_hz: float, serves: bool) -> None:
    time_s = np.arange(0.0, 60.0, 1.0 / rate_hz)
    stick = 0.2 * np.sign(np.sin(0.9 * time_s) + np.sin(2.3 * time_s))
    rows = {"roll_stick": stick, "roll_command": 0.05 * stick, "p": stick, "thrust_command": np.full_like(stick, 0.5)}
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name], source=name) for name in rows)
    topic = Topic(name="log", time_s=time_s, channels=channels, values=np.stack(list(rows.values())))
    record = FlightRecord(topics=(topic,), source=Source(name="ordinary.csv", format="CSV", sha256="0" * 64))
    assert ("rate.roll" in supported_models([record])) is serves


def test_a_parameter_of_no_model_is_said(flight: Path) -> None:
    with pytest.raises(ModelError, match="did you mean L_p"):
        identify_several(api.read(flight), ["rate.roll", "rate.pitch"], fix={"L_pp": -1.0})


def test_each_takes_the_choices_that_it_has(flight: Path, tmp_path: Path) -> None:
    asked = ("--model", "rate.roll,axis.roll", "--fix", "L_p=-2", "--constant", "theta0=0.01")
    ran = rotorid("identify", flight, *asked, "--band", "12:50", "--out", tmp_path, "--json")
    assert ran.code == 2  # neither has it
    assert "theta0" in ran.err
    ran = rotorid("identify", flight, *asked[:4], "--band", "12:50", "--out", tmp_path, "--json")
    assert [one["parameters"]["L_p"]["status"] for one in json.loads(ran.out)["results"][:1]] == ["fixed"]


def test_a_log_that_supports_nothing_says_what_each_model_lacks(tmp_path: Path) -> None:
    log = tmp_path / "still.csv"
    time_s = np.arange(0.0, 30.0, 0.02)
    write_csv(log, time_s, {"roll_command": 0.0 * time_s, "p": 0.0 * time_s})
    ran = rotorid("identify", log, "--model", "all", "--out", tmp_path / "out", "--json")
    assert ran.code == 1
    assert "not enough data in still.csv for any model" in ran.err
    told = json.loads(ran.out)
    assert told["results"] == []
    assert {"no_excitation", "missing_channel"} <= {finding["kind"] for finding in told["findings"]}
    assert "still.csv: the log lacks pitch_command and q." in {finding["message"] for finding in told["findings"]}
