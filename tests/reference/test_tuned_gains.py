"""Gains from real autopilots' own simulators: what flew is told, other gains are refused, and the proposal holds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.cli.tune import _print
from rotorid.data.quantity import Quantity
from rotorid.documents.tune import tune_document
from rotorid.errors import InsufficientDataError
from rotorid.flights.selection import excited_pairs
from rotorid.proposing import TuningProposal, check_tuning, tune
from rotorid.proposing.check import Foretold
from rotorid.report.tune import render_tune
from rotorid.tuning import read_gains
from rotorid.tuning.loops import quantities

SWEEP = "ardupilot_sitl/x_calm_roll.BIN"


@pytest.fixture(scope="module")
def sweep(shared_data: Path) -> rotorid.FlightRecord:
    return rotorid.read(shared_data / SWEEP)


@pytest.fixture(scope="module")
def model(sweep: rotorid.FlightRecord) -> rotorid.IdentifiedModel:
    return rotorid.identify(sweep, "rate.roll")


@pytest.fixture(scope="module")
def plain(sweep: rotorid.FlightRecord, model: rotorid.IdentifiedModel) -> TuningProposal:
    """Gains for what flew, nothing chosen."""
    return tune(model, sweep, axes=("roll",))


def test_hot_gains_of_ardupilot_come_down(plain: TuningProposal) -> None:
    one = plain.axes["roll"]
    assert np.median(one.proposal.flown.whole.sensitivity_peak) > 3.0
    assert np.quantile(one.proposal.proposed.whole.sensitivity_peak, 0.9) < 1.75
    assert one.parameters["ATC_RAT_RLL_P"][1] < 0.8 * one.parameters["ATC_RAT_RLL_P"][0]
    assert sorted(plain.files) == ["proposed.param"]
    # The sweep logs the rate in front of the filters of the gyro, and still says that these gains flew.
    assert not [one for one in plain.findings if one.kind == "controller_unchecked"]


def test_gains_of_the_firmwares_own_autotune_are_judged(
    sweep: rotorid.FlightRecord, model: rotorid.IdentifiedModel, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """AUTOTUNE ended with these on this vehicle; on its exact plant their M_s is 2.7."""
    text = "ATC_RAT_RLL_P,0.117\nATC_RAT_RLL_I,0.117\nATC_RAT_RLL_D,0.0006\nATC_ANG_RLL_P,34\n"
    found = tune(model, sweep, axes=("roll",), keep=("P", "I", "D"), judge=read_gains(text, name="autotune.param"))
    document = tune_document(found)
    assert document.judged is not None
    roll = document.judged.axes["roll"]
    assert (document.judged.verdict, roll.verdict) == ("do_not_fly", "do_not_fly")
    assert roll.usual_peak == pytest.approx(2.7, abs=0.15)
    assert document.breaks["roll_rad_s"] == pytest.approx(90.0, rel=0.1)
    assert roll.lower
    assert "gains_out_of_range" in {finding.kind for finding in found.findings}
    _print(document, tmp_path, given=[])
    shown = capsys.readouterr().out
    assert shown.startswith(
        "autotune.param: do not fly these gains.\nRoll: do not fly these gains: on a likely vehicle (gain "
    )
    assert "do not fly these gains" in render_tune(found, title="Gains")


@pytest.mark.parametrize("factor", [0.4, 2.5])
def test_other_gains_than_those_of_the_log_are_refused(
    sweep: rotorid.FlightRecord, model: rotorid.IdentifiedModel, factor: float
) -> None:
    names = ("ATC_RAT_RLL_P", "ATC_RAT_RLL_I", "ATC_RAT_RLL_D")
    wrong = {name: factor * sweep.parameters[name] for name in names}
    with pytest.raises(InsufficientDataError) as refused:
        tune(model, replace(sweep, parameters={**sweep.parameters, **wrong}), axes=("roll",))
    assert "other_controller" in {finding.kind for finding in refused.value.findings}


def test_another_filter_is_judged_and_written(
    sweep: rotorid.FlightRecord, model: rotorid.IdentifiedModel, plain: TuningProposal
) -> None:
    faster = tune(model, sweep, axes=("roll",), filters={"INS_GYRO_FILTER": 60.0})
    prices = {price.name: price.phase_deg for price in plain.axes["roll"].prices}
    assert max(prices, key=lambda name: prices[name]).startswith("gyro: ")
    assert max(prices.values()) > 5.0
    assert faster.axes["roll"].proposal.better < plain.axes["roll"].proposal.better
    assert "INS_GYRO_FILTER,60" in faster.files["proposed.param"]
    assert "INS_GYRO_FILTER,20" in faster.rollback_files["rollback.param"]


TUNED = "real_stacks/ap_x_wind_soft_tuned_card_flight.BIN.xz"
WIDE = "real_stacks/ap_x_wind_soft_wide.BIN.xz"


def foretold(record: rotorid.FlightRecord, axis: str, whole: dict[str, tuple[float, float, float]]) -> Foretold:
    """What was said of the whole loop before this log was flown: value, lower and upper end."""
    units = {"crossover_rad_s": "rad/s", "phase_margin_deg": "deg", "sensitivity_peak": "1"}
    told = {
        name: Quantity(value=value, std=(upper - lower) / 3.92, lower=lower, upper=upper, unit=units[name])
        for name, (value, lower, upper) in whole.items()
    }
    short = {"roll": "RLL", "pitch": "PIT"}[axis]
    gains = {
        name: record.parameters[name] for name in (f"ATC_RAT_{short}_P", f"ATC_RAT_{short}_I", f"ATC_ANG_{short}_P")
    }
    return Foretold(flown={}, proposed=gains, rate={}, whole=told)


def test_a_proposal_from_a_wrong_model_is_not_acquitted(shared_data: Path) -> None:
    """Flown by the real firmware with gains of a plant that was wrong in roll; a model of this flight is wrong alike.

    Right by injection: roll M_s 1.25, 16.2 rad/s, 47 degrees; pitch 32.5 rad/s, 49 degrees, and M_s 1.51 beyond the
    sweep.
    """
    record = rotorid.read(shared_data / TUNED)
    said = {
        "roll": {
            "crossover_rad_s": (18.5, 17.9, 19.4),
            "phase_margin_deg": (43.7, 42.0, 46.5),
            "sensitivity_peak": (1.47, 1.32, 1.71),
        },
        "pitch": {
            "crossover_rad_s": (32.6, 31.6, 33.7),
            "phase_margin_deg": (49.0, 47.1, 51.3),
            "sensitivity_peak": (1.5, 1.39, 1.71),
        },
    }
    found = check_tuning({axis: foretold(record, axis, whole) for axis, whole in said.items()}, record)  # type: ignore[misc]
    assert found.axes["roll"].verdict == "inside_limits"
    assert "Keep these gains" not in found.axes["roll"].advice
    assert found.axes["pitch"].verdict == "as_foretold"
    assert "No better gains" not in found.axes["pitch"].advice
    measured = {
        axis: {one.name: one for one in checked.figures if one.method == "injection"}
        for axis, checked in found.axes.items()
    }
    assert measured["roll"]["crossover_rad_s"].measured.value == pytest.approx(16.2, rel=0.02)
    assert measured["roll"]["phase_margin_deg"].measured.value == pytest.approx(47.0, abs=1.0)
    assert measured["roll"]["sensitivity_peak"].measured.value == pytest.approx(1.25, abs=0.02)
    assert measured["pitch"]["crossover_rad_s"].measured.value == pytest.approx(32.5, rel=0.02)
    assert measured["pitch"]["phase_margin_deg"].measured.value == pytest.approx(49.0, abs=1.0)
    # The peak lies above the sweep: its last points look like one, and lower.
    assert "sensitivity_peak" not in measured["pitch"]


@pytest.fixture(scope="module")
def wide(shared_data: Path) -> TuningProposal:
    return tune(records=rotorid.read(shared_data / WIDE), axes=("roll", "pitch"))


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_a_wide_sweep_of_the_real_firmware_gives_the_gains_that_were_flown_as_foretold(
    wide: TuningProposal, axis: str
) -> None:
    """P .0845 I .816 D .00036 A 6 with M_s 1.66 were proposed and flown: 1.66, 40.4 rad/s, 51 degrees."""
    one = wide.axes[axis]  # type: ignore[index]
    short = {"roll": "RLL", "pitch": "PIT"}[axis]
    proposed = {name: after for name, (_, after) in one.parameters.items()}
    assert proposed[f"ATC_RAT_{short}_P"] == pytest.approx(0.0845, rel=0.02)
    assert proposed[f"ATC_RAT_{short}_I"] == pytest.approx(0.816, rel=0.02)
    assert proposed[f"ATC_RAT_{short}_D"] == pytest.approx(0.00036, rel=0.02)
    assert proposed[f"ATC_ANG_{short}_P"] == pytest.approx(6.0, rel=0.001)
    told = quantities(one.proposal.proposed.whole)
    assert told["sensitivity_peak"].lower < 1.66 < told["sensitivity_peak"].upper
    assert told["crossover_rad_s"].lower < 40.4 < told["crossover_rad_s"].upper
    assert told["phase_margin_deg"].lower < 51.0 < told["phase_margin_deg"].upper
    flown = quantities(one.proposal.flown.whole)
    assert flown["sensitivity_peak"].value == pytest.approx(1.88, abs=0.03)
    assert flown["crossover_rad_s"].value == pytest.approx(61.0, rel=0.02)
    assert flown["phase_margin_deg"].value == pytest.approx(78.0, abs=1.5)


def test_the_path_of_the_wide_sweep_ends_where_a_second_step_was_flown(wide: TuningProposal) -> None:
    """The real firmware flew it after the first step: A 12 with M_s 1.66, as foretold."""
    path = wide.axes["roll"].path
    assert [(one.flight, one.goal) for one in path] == [(1, False), (2, True)]
    goal = path[-1]
    assert goal.parameters["ATC_ANG_RLL_P"] == pytest.approx(12.0, rel=0.001)
    assert quantities(goal.judged.whole)["sensitivity_peak"].value == pytest.approx(1.66, abs=0.02)
    assert np.median(goal.judged.attitude_rms) < 0.85 * np.median(path[0].judged.attitude_rms)
    # Only the first flight comes as a file.
    assert "ATC_ANG_RLL_P,6" in wide.files["proposed.param"]


def test_the_path_stands_on_the_terminal_on_the_page_and_in_the_document(
    wide: TuningProposal, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = tune_document(wide)
    first, goal = document.axes["roll"].path
    assert (first.flight, first.goal, goal.flight, goal.goal) == (1, False, 2, True)
    assert first.gains["ATC_ANG_RLL_P"] == document.axes["roll"].gains["ATC_ANG_RLL_P"].proposed
    assert goal.attitude_ratio.value < first.attitude_ratio.value
    assert document.robustness.startswith("M_s up to 1.7 (recommended)")
    _print(document, tmp_path, given=[], verbose=True)
    shown = capsys.readouterr().out
    assert "flights to the best gains of roll" in shown
    assert "2, goal" in shown
    assert "Limit of the new gains: M_s up to 1.7" in shown
    page = render_tune(wide, title="Gains")
    assert "Flights to the best gains" in page
    # Long names break where the page is narrow: the last column is not cut.
    assert "ATC_<wbr>RAT_<wbr>RLL_<wbr>P</th>" in page
    # I grows tenfold here: it is no gain that a flight limits.
    assert "P, D and angle P at most double in one flight" in page
    assert "(recommended): stable if the gain grows" in page
    assert "a disturbance tilts the vehicle 6.3 times less than today" in page


def test_a_sweep_at_the_mixer_needs_no_channels_to_be_named(shared_data: Path) -> None:
    """Its set-points rest: the excited pairs are those of the commands."""
    found = excited_pairs([rotorid.read(shared_data / WIDE)])
    assert found == (("roll_command", "p"), ("pitch_command", "q"))
