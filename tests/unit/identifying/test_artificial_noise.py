"""Artificial noise: what it is added to, how much, and what runs with it say of a model."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from tests.unit.data.test_sensor_filters import RATE_HZ, record_of, sweep_record

import rotorid
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.identifying.artificial_noise import judge_noise_runs, rms_of_channels, with_noise, with_noise_runs
from rotorid.identifying.families import method_of, require_choices
from rotorid.models.families import FLIGHT, LARGE_MOTION, MOTOR_SPEED, MOTORS
from rotorid.results.model import IdentifiedModel
from rotorid.results.summary import FailedRun, NoiseRuns, NoiseSpread
from rotorid.settings.identifying import IdentifySettings


@pytest.fixture(scope="module")
def noisy() -> IdentifiedModel:
    return rotorid.identify(sweep_record(), "rate.roll", add_noise_percent=5.0, runs=3, seed=2)


def test_noise_is_on_sensors_alone_and_has_the_share_of_their_rms() -> None:
    time_s = np.arange(0.0, 100.0, 1.0 / RATE_HZ)
    wave = np.sin(time_s)
    record = record_of({"p": wave, "az": wave - 9.81, "roll_command": wave, "p_setpoint": wave, "motor_1": wave})
    rms = rms_of_channels(record, (), ())
    assert rms.keys() == {"p", "az"}
    # About the mean: gravity is no signal.
    assert rms == pytest.approx({"p": np.sqrt(0.5), "az": np.sqrt(0.5)}, rel=0.01)
    again = with_noise(record, {name: 0.05 * value for name, value in rms.items()}, np.random.default_rng(0))
    added = again.topics[0].values - record.topics[0].values
    assert added[:2].std(axis=1) == pytest.approx(0.05 * np.sqrt(0.5), rel=0.05)
    assert not added[2:].any()


def test_rms_is_that_of_the_maneuvers() -> None:
    record = record_of({"p": np.where(np.arange(1000) < 500, 0.0, np.tile([1.0, -1.0], 500))})
    assert rms_of_channels(record, [(2.0, 4.0)], ())["p"] == pytest.approx(1.0, rel=1e-2)
    assert rms_of_channels(record, [(0.0, 1.9)], ())["p"] == 0.0


def test_runs_scatter_about_the_value_as_they_state(noisy: IdentifiedModel) -> None:
    runs = noisy.fit.noise_runs
    assert runs is not None
    assert (runs.percent, runs.runs, runs.asked, runs.failed, runs.stopped) == (5.0, 3, 3, (), False)
    gain = runs.parameters["L_roll"]
    assert gain.value == noisy["L_roll"].value
    assert gain.bias == pytest.approx(gain.mean - gain.value)
    # Three runs know their deviation to half, and scatter by 0.1 to 2.2 of it in 99 of 100 cases.
    assert gain.stated_std_in_runs is not None
    assert 0.05 < gain.std / gain.stated_std_in_runs < 3.0
    assert len(runs.draws["L_roll"]) == 3
    assert runs.cost is not None
    assert noisy.provenance.settings["add_noise_percent"] == 5.0
    assert noisy.provenance.settings["runs"] == 3


def test_too_few_models_are_refused_with_their_reasons(noisy: IdentifiedModel) -> None:
    def fails(_records: object, _settings: object) -> None:
        raise InsufficientDataError("no sweep")

    with pytest.raises(InsufficientDataError, match=r"0 of 2 runs with 5 % of noise gave a model \(no sweep"):
        with_noise_runs(
            noisy,
            [sweep_record()],
            IdentifySettings(add_noise_percent=5.0, runs=2),
            fails,  # type: ignore[arg-type]
        )


def _summary(**changes: object) -> NoiseRuns:
    spread = NoiseSpread(
        value=1.0,
        unit="1/s",
        stated_std=0.1,
        stated_std_random=0.1,
        mean=1.3,
        std=0.2,
        bias=0.3,
        bias_std=0.02,
        min=0.8,
        max=1.9,
        runs=90,
    )
    plain = {
        "percent": 5.0,
        "runs": 90,
        "asked": 100,
        "seed": 0,
        "stopped": False,
        "failed": (),
        "channels": {},
        "parameters": {"L_p": spread},
    }
    return NoiseRuns(**{**plain, **changes})  # type: ignore[arg-type]


def test_a_bias_beyond_chance_and_the_stated_error_is_a_finding() -> None:
    (finding,) = judge_noise_runs(_summary())
    assert (finding.kind, finding.where) == ("noise_bias", "L_p")
    assert "3.0 stated standard deviations" in finding.message


def test_runs_that_failed_or_were_stopped_are_counted_and_named() -> None:
    failed = tuple(FailedRun(run=run, reason="no sweep.") for run in (3, 8))
    words = [
        finding.message
        for finding in judge_noise_runs(_summary(failed=failed, stopped=True))
        if finding.kind == "noise_runs_incomplete"
    ]
    assert words[0].startswith("2 of 100 runs with noise gave no model (run 3, 8): no sweep.")
    assert words[1].startswith("Stopped after 92 of 100 runs")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"add_noise_percent": 0.0}, "--add-noise 0 is out of range"),
        ({"add_noise_percent": -5.0}, "--add-noise -5 is out of range"),
        ({"add_noise_percent": float("nan")}, "--add-noise nan is out of range"),
        ({"add_noise_percent": 5.0, "runs": 1}, "--runs 1 is too few"),
        ({"runs": 5}, "--runs needs a search or noise"),
        ({"workers": 0}, "--workers 0 is out of range"),
    ],
)
def test_impossible_choices_are_refused(changes: dict[str, float], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        IdentifySettings(**changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("model", [MOTORS.name, FLIGHT.name, MOTOR_SPEED.name, "drag.linear", "rate.roll"])
def test_every_family_takes_noise(model: str) -> None:
    known = {"arm_m": 0.2, "fix": {"m": 1.0}} if model == MOTORS.name else {}
    require_choices(model, IdentifySettings(add_noise_percent=5.0, runs=3, workers=2, **known))  # type: ignore[arg-type]
    assert callable(partial(method_of, model))
    assert LARGE_MOTION.name
