"""Twelve logs, each command once: what two of them answer is one answer, and what they propose runs."""

from __future__ import annotations

import lzma
from collections.abc import Mapping
from pathlib import Path

import pytest
from tests.agreement.answers import (
    Ran,
    answers,
    bold_cards,
    bold_verdicts,
    contradictions,
    next_commands,
    run,
    run_all,
)

pytestmark = pytest.mark.slow

LOGS = (
    "px4_sitl/roll.ulg",
    "px4_sitl/verify.ulg.xz",
    "px4/sample.ulg",
    "ardupilot_sitl/x_wind_rollpitch.BIN.xz",
    "ardupilot_sitl/x_calm_verify.BIN.xz",
    "ardupilot/erle_brain3.BIN",
    "everyday/arducopter_462_log_4.bin.xz",
    "betaflight/smooth_tune.BBL",
    "everyday/betaflight_431_freestyle.bbl.xz",
    "crazyflie/log10",
    "s500/roll_sweeps.csv",
    "s500/pitch_doublets.csv",
)


FITTED = "over the points of the response, and over those that were fitted"
DIFFER: Mapping[str, Mapping[str, str]] = {
    "betaflight/smooth_tune.BBL": {
        "closed_loop_bias": "over the points of the response, and over those that were fitted"
    },
    "s500/roll_sweeps.csv": {"closed_loop_bias": FITTED},
    "everyday/betaflight_431_freestyle.bbl.xz": {
        "rate loop": "D moves in flight: review states the end that flew, tune the base; each names its end",
        "yaw: gains proposed": "identify refuses the model; tune of the log takes its response alone",
    },
}
"""Questions, by words in them, that two commands answer differently of a log, and why; nothing else may."""


@pytest.fixture(scope="module", params=LOGS)
def flown(
    request: pytest.FixtureRequest, shared_data: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[str, Path, dict[str, Ran]]:
    """A log, the folder it was copied to, and what each command left there."""
    source, folder = shared_data / request.param, tmp_path_factory.mktemp("agreement")
    packed = source.suffix == ".xz"
    log = folder / (source.stem if packed else source.name)
    log.write_bytes(lzma.decompress(source.read_bytes()) if packed else source.read_bytes())
    return request.param, folder, run_all(Path(log.name), folder)


def test_two_commands_give_one_answer(flown: tuple[str, Path, dict[str, Ran]]) -> None:
    name, _, ran = flown
    known, found = DIFFER.get(name, {}), contradictions(answers(ran))
    assert {question: given for question, given in found.items() if not any(words in question for words in known)} == {}
    assert {words for words in known if any(words in question for question in found)} == set(known)


def test_green_is_all_of_a_question(flown: tuple[str, Path, dict[str, Ran]]) -> None:
    _, _, ran = flown
    assert bold_cards(ran) == []
    assert bold_verdicts(ran) == []


def test_what_is_proposed_next_runs(flown: tuple[str, Path, dict[str, Ran]]) -> None:
    _, folder, ran = flown
    failed = {" ".join(words): code for words in next_commands(ran) if (code := run([*words, "--quiet"], folder).code)}
    assert failed == {}
