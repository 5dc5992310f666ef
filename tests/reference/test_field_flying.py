"""Was it flying: small inputs that people's logs led to, each made from a known flight."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import rotorid
from rotorid.errors import InsufficientDataError
from rotorid.reviewing.cards import cards
from rotorid.signal.airborne import airborne

SMOOTH = "betaflight/smooth_tune.BBL"


@pytest.fixture(scope="module")
def made(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the inputs, as their script makes them."""
    script = shared_data / "field" / "make_inputs.py"
    if not script.is_file():
        pytest.skip(f"no {script}; set ROTORID_DATA to the folder of flights")
    folder = tmp_path_factory.mktemp("field")
    subprocess.run([sys.executable, str(script), str(folder)], check=True, capture_output=True)
    return folder


def test_a_bench_whose_motors_never_ran_is_no_flight(made: Path) -> None:
    bench = rotorid.read(made / "f3_disarmed_bench.BIN")
    with pytest.raises(InsufficientDataError, match="the motors never ran"):
        airborne(bench)
    first, *others = cards(rotorid.review(bench, models=False))
    assert {card.state for card in (first, *others)} == {"cannot"}
    assert "the motors never ran" in first.details
    assert rotorid.inspect(bench).flights == ()


def test_the_first_frames_that_were_lost_are_unknown(made: Path, unpacked: Callable[[str], Path]) -> None:
    whole, cut = airborne(rotorid.read(unpacked(SMOOTH))), airborne(rotorid.read(made / "f6_cut_header.BBL"))
    assert cut.longest == pytest.approx(whole.longest, abs=0.1)
    assert cut.longest[0] == pytest.approx(33.9, abs=0.1)


@pytest.mark.parametrize(
    ("log", "flight"),
    [
        # Height and thrust show the touch-down; the landed event comes 1.5 s later.
        ("ardupilot_sitl/x_calm_verify.BIN.xz", (54.9, 254.2)),
        ("real_stacks/ap_x_wind_ordinary_soft.BIN.xz", (45.3, 157.6)),
        ("px4_sitl/roll.ulg", (13.8, 136.9)),
        ("crazyflie/log10", (32.0, 69.1)),
    ],
)
def test_the_flight_of_a_known_log(unpacked: Callable[[str], Path], log: str, flight: tuple[float, float]) -> None:
    (found,) = airborne(rotorid.read(unpacked(log))).intervals
    assert found == pytest.approx(flight, abs=0.5)


@pytest.mark.parametrize("log", ["px4/sample.ulg", "px4/sample_logging_tagged_and_default_params.ulg"])
def test_what_was_never_armed_never_flew(unpacked: Callable[[str], Path], log: str) -> None:
    with pytest.raises(InsufficientDataError, match="the vehicle was never armed"):
        airborne(rotorid.read(unpacked(log)))
