"""Numbers and words of the report."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.report.sample import document, maneuver

from rotorid.data.quantity import percent, significant, unit, with_error
from rotorid.documents.base import FindingDocument
from rotorid.documents.result import ResultDocument
from rotorid.report.findings import finding_rows
from rotorid.report.parts import Cell, cost_rows, parameter_groups, parameter_rows
from rotorid.report.words import parameter_words, pole_rows, prediction_verdict, summary
from rotorid.results.summary import Checks, PoleEstimate
from rotorid.results.verdicts import cost_verdict


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (436.83, 3.14, "437 ± 3"),
        (436.83, 0.314, "436.8 ± 0.3"),
        (436.83, 0.114, "436.83 ± 0.11"),
        (-0.00243, 0.00011, "−0.00243 ± 0.00011"),
        (43683.0, 1234.0, "43700 ± 1200"),
        (2.5e-5, 4e-6, "(2.5 ± 0.4)·10⁻⁵"),
        (2.5e8, 4e6, "(2.50 ± 0.04)·10⁸"),
        (0.0, 3.0, "0 ± 3"),
        (1.5, None, "1.5"),
        (1.5, math.nan, "1.5"),
        (math.nan, 1.0, "–"),
        (None, None, "–"),
    ],
)
def test_digits_follow_the_standard_deviation(value: float | None, std: float | None, text: str) -> None:
    assert with_error(value, std) == text


@given(st.floats(1e-2, 1e5), st.floats(1e-2, 1e5))
def test_rounding_is_small_against_the_deviation(value: float, std: float) -> None:
    shown = float(with_error(value, std).split(" ± ")[0])
    # Two digits from 1 on, or one from 3 on: half a unit of the last is at most a sixth of the deviation.
    assert abs(shown - value) <= std / 6.0 * (1.0 + 1e-9)


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (-3.14159, "−3.14"), (math.inf, "–"), (1.5e-7, "1.5·10⁻⁷"), (-2e9, "−2·10⁹")],
)
def test_significant_digits(value: float, text: str) -> None:
    assert significant(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.534, "0.53"), (9.94, "9.9"), (158.6, "159"), (1000.1, "> 1000"), (math.inf, "–"), (None, "–")],
)
def test_percents(value: float | None, text: str) -> None:
    assert percent(value) == text


def test_units_on_paper() -> None:
    assert [unit(text) for text in ("1", "1/s", "rad/s^2", "kg m^2")] == ["", "1/s", "rad/s²", "kg m²"]


@pytest.mark.parametrize(
    ("cost", "level"),
    [(1.9, "good"), (50.0, "good"), (51.0, "fair"), (100.0, "fair"), (101.0, "poor"), (math.nan, "poor")],
)
def test_cost_guidelines(cost: float, level: str) -> None:
    assert cost_verdict(cost).level == level


@pytest.mark.parametrize(
    ("tic", "fit", "level", "words"),
    [
        (0.25, 50.0, "good", "good"),
        (0.06, 49.0, "fair", "fit below the guideline"),
        (0.33, 50.0, "fair", "TIC above the guideline"),
        (0.26, 49.0, "poor", "TIC and fit outside the guideline"),
        (math.nan, math.nan, "poor", "TIC and fit outside the guideline"),
        (0.1, -math.inf, "fair", "fit below the guideline"),
    ],
)
def test_a_prediction_is_good_by_both_scores(tic: float, fit: float, level: str, words: str) -> None:
    verdict = prediction_verdict(tic, fit)
    assert (verdict.level, verdict.words) == (level, words)


def verified(*kinds: str, **costs: float) -> ResultDocument:
    """The sample with other costs on unseen sweeps and findings of these kinds."""
    found = [FindingDocument(kind=kind, severity="info", where="", message="") for kind in kinds]
    return document().model_copy(update={"verification": Checks(frequency=costs), "findings": found})


def test_summary_speaks_of_gain_lag_delay_and_cost() -> None:
    assert summary(document()) == (
        "Roll: 437 ± 3 rad/s² per unit command, motor lag 27.9 ± 0.6 ms, delay 2.43 ± 0.11 ms.",
        "Roll is unstable: it oscillates at 0.91 rad/s and doubles in 5.8 s.",
        "Fit: good. The cost is 1.9 (up to 50 is good, up to 100 acceptable).",
        "Unseen flight: 1 maneuver predicted well.",
        "Output in open loop: roll rate p, TIC 0.041, fit 92 % (good: TIC up to 0.25, fit 50 % and more).",
        "Unseen sweeps: worst cost 12.3 (practically indistinguishable from the flight).",
    )


def test_summary_of_a_foreign_model_counts_its_parameters() -> None:
    foreign = verified().model_copy(update={"model": "mine", "inputs": ["x"], "cost": None, "fit_percent": {"p": 88.0}})
    assert summary(foreign) == (
        "mine: 4 parameters identified.",
        "Roll is unstable: it oscillates at 0.91 rad/s and doubles in 5.8 s.",
        "The model explains 88 % of roll rate p.",
        "Fit: good. The model explains 88.0 % of p (50 % and more is good).",
        "Not checked on unseen flight yet.",
    )


def test_summary_names_the_worst_prediction() -> None:
    # Of two that miss one guideline each the larger Theil coefficient is the worse.
    several = [maneuver(), maneuver(tic=0.31, fit=55.0, verdict="poor"), maneuver(tic=0.2, fit=45.0, verdict="poor")]
    flown = document().model_copy(update={"verification": Checks(maneuvers=several)})
    assert "Unseen flight: 3 maneuvers, 1 predicted well, 2 predicted poorly." in summary(flown)
    assert summary(flown)[-1].startswith("Worst output in open loop: roll rate p, TIC 0.31, fit 55 %")


def test_an_unseen_sweep_counts_as_unseen_flight() -> None:
    sentences = summary(verified(p=4313.0))
    assert sentences[-1] == "Unseen sweeps: worst cost 4310 (the model misses the measurement)."
    assert not any("Not verified" in sentence for sentence in sentences)


def test_a_held_out_maneuver_is_not_said_to_judge_the_model_itself() -> None:
    held = verified("held_out", p=12.0)
    assert summary(held)[-1].startswith("Held-out maneuver (second model, fitted without it): worst cost 12 (")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("X_u", "forward force due to forward speed"),
        ("Z_thrust", "vertical force due to thrust command"),
        ("N_r", "yawing moment due to yaw rate"),
        ("tau_yaw", "delay of the yaw command"),
        ("T_motor", "motor lag"),
        ("L_wind", ""),
        ("tau_wind", ""),
        ("<b>", ""),
        ("g", ""),
    ],
)
def test_words_for_parameters(name: str, words: str) -> None:
    assert parameter_words(name) == words


def test_only_values_beyond_the_guidelines_are_marked() -> None:
    rows = {row.name: row for row in parameter_rows(document(), {})}
    marked = {name for name, row in rows.items() if row.cramer_rao.marked or row.insensitivity.marked}
    assert marked == {"L_p"}
    assert "L_v" not in rows


def test_truth_of_the_model_goes_before_truth_of_the_name() -> None:
    rows = {row.name: row for row in parameter_rows(document(), {"L_roll": 1.0, "rate.roll.L_roll": 437.0})}
    assert (rows["L_roll"].truth, rows["L_roll"].off) == ("437", Cell("0.1 σ"))
    assert (rows["L_p"].truth, rows["L_p"].off) == ("–", Cell(""))


@pytest.mark.parametrize(("truth", "far"), [(436.8 + 2.9 * 3.1, False), (436.8 - 3.1 * 3.1, True)])
def test_distances_that_random_errors_hardly_explain_are_marked(truth: float, far: bool) -> None:
    rows = {row.name: row for row in parameter_rows(document(), {"L_roll": truth})}
    assert rows["L_roll"].off.marked == far


def test_conjugate_poles_are_one_row_and_growth_is_said() -> None:
    rows = pole_rows(document().poles)
    assert [(row.real, row.imag) for row in rows] == [("0.12", "0.9"), ("−4.31", "0"), ("−35.8", "0")]
    assert [row.unstable for row in rows] == [True, False, False]


def test_integrator_has_no_time_constant() -> None:
    (row,) = pole_rows([PoleEstimate(real=0.0, imag=0.0, damping=math.nan, frequency_rad_s=0.0)])
    assert (row.words, row.damping) == ("neither decays nor grows", "–")


def test_costs_on_unseen_sweeps_stand_beside_those_of_the_fit() -> None:
    fitted, foreign = cost_rows(verified(**{"p/roll_command": 120.0, "q": 12.0}))
    assert fitted.pair == "p/roll_command"
    assert fitted.verdict is not None
    assert fitted.unseen is not None
    assert (fitted.value, fitted.verdict.level, fitted.unseen.words, fitted.unseen.level) == (
        "1.9",
        "good",
        "120",
        "poor",
    )
    assert (foreign.pair, foreign.value, foreign.verdict, foreign.band) == ("q", "–", None, "–")


def test_a_short_table_is_not_grouped() -> None:
    (group,) = parameter_groups(document(), {})
    assert group.title == ""
    assert group.rows == parameter_rows(document(), {})


def test_grave_findings_come_first_and_keep_their_order() -> None:
    rows = finding_rows(document().findings)
    assert [row.severity for row in rows] == ["error", "warning", "warning", "info"]
    assert [row.heading for row in rows][1:3] == ["Low coherence", "Unheard of"]


def test_sample_is_a_valid_document() -> None:
    assert ResultDocument.model_validate_json(document().model_dump_json(by_alias=True)) == document()
