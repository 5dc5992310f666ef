"""``rotorid tune``: exit codes, sentences and files for what a person may give."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.unit.cli.commands import fly_roll_sweeps, rotorid

from rotorid.errors import InsufficientDataError
from rotorid.io.registry import read
from rotorid.proposing import proposal

pytestmark = pytest.mark.usefixtures("computed_once")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight without the parameters of any autopilot."""
    path = tmp_path_factory.mktemp("flight") / "flight.csv"
    fly_roll_sweeps(path)
    return path


def test_a_log_without_gains_is_refused_with_the_reason(log: Path, tmp_path: Path) -> None:
    ran = rotorid("tune", log, "--axis", "roll", "--out", tmp_path / "out", "--json")
    assert ran.code == 1
    document = json.loads(ran.out)
    assert document["schema"] == "rotorid.tune/1"
    assert document["axes"] == {}
    assert "no_controller" in {finding["kind"] for finding in document["findings"]}
    assert not (tmp_path / "out").exists()


def test_gains_around_an_unknown_vehicle_are_not_called_safe(log: Path, tmp_path: Path) -> None:
    gains = tmp_path / "gains.txt"
    gains.write_text("roll: P=0.1 D=0.002\n")
    ran = rotorid("tune", log, "--axis", "roll", "--judge", gains, "--out", tmp_path / "out", "--json")
    assert ran.code == 1
    assert json.loads(ran.out)["judged"] == {"source": "gains.txt", "axes": {}, "verdict": "not_enough_data"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--set", "IMU_GYRO_CUTOFF"), "expected NAME=VALUE"),
        (("--set", "IMU_GYRO_CUTOFF=fast"), "expected NAME=VALUE"),
        (("--keep", "P", "--only", "D"), "exclude each other"),
        (("--keep", "X"), "unknown gain 'X'; use P, I, D or A"),
        (("--robustness", "9"), "from 1.2 to 2.5"),
        (("--noise", "0"), "a factor from 0.1 to 10"),
        (("--scale", "0.1"), "from 1 to 1000"),
        (("--axes", "surge"), "use roll, pitch, yaw, velocity"),
        (("--check", "nowhere"), "a tune.json"),
        (("--judge", "nowhere"), "nowhere cannot be read"),
        (("--judge", "nowhere", "--check", "nowhere"), "exclude each other"),
    ],
)
def test_a_slip_is_one_sentence(log: Path, tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    ran = rotorid("tune", log, *words, "--out", tmp_path / "out")
    assert ran.code == 2
    assert said in ran.err
    assert ran.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("remedy", "said"), [("lower --coherence", "c; this needs n."), ("fly a sweep", "c; fly a sweep.")]
)
def test_no_remedy_is_an_option_of_identify(log: Path, remedy: str, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*given: object, **look: object) -> None:
        raise InsufficientDataError("c", needed="n", remedy=remedy)

    monkeypatch.setattr(proposal, "known_axis", refused)
    with pytest.raises(InsufficientDataError) as caught:
        proposal.tune(records=read(log), axes=("roll",))
    (message,) = [finding.message for finding in caught.value.findings if finding.kind == "not_tuned"]
    assert message == f"Not enough data to tune roll: {said}"


@pytest.mark.parametrize("text", ["{", "[]", '{"schema": "rotorid.result/1"}', '{"schema": "rotorid.tune/1"}', "3"])
def test_a_foreign_document_is_no_proposal(log: Path, tmp_path: Path, text: str) -> None:
    file = tmp_path / "tune.json"
    file.write_text(text)
    ran = rotorid("tune", log, "--check", file, "--out", tmp_path / "out")
    assert ran.code == 2
    assert "a tune.json that rotorid tune wrote" in ran.err
    assert not (tmp_path / "out").exists()


def test_a_proposal_without_axes_cannot_be_checked(log: Path, tmp_path: Path) -> None:
    folder = tmp_path / "refused"
    refused = json.loads(rotorid("tune", log, "--axes", "roll", "--out", folder, "--json").out)
    file = tmp_path / "tune.json"
    file.write_text(json.dumps(refused))
    ran = rotorid("tune", log, "--check", file, "--out", tmp_path / "out")
    assert ran.code == 2
    assert "contains no axis" in ran.err


def test_a_check_needs_a_log(tmp_path: Path) -> None:
    ran = rotorid("tune", tmp_path / "result.json", "--check", tmp_path)
    assert ran.code == 2
