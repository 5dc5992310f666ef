"""The page of a state-space model: dozens of numbers, and each stands once where it belongs."""

from __future__ import annotations

import dataclasses
import itertools
import math
from types import SimpleNamespace
from typing import Any

import pytest
from tests.unit.report.hover_sample import (
    DROPPED,
    FREE,
    GROWTH_1_S,
    INPUTS,
    OUTPUTS,
    correlation,
    delay,
    hover_document,
    hover_identification,
    poles,
)
from tests.unit.report.page_parser import Page
from tests.unit.report.sample import HOSTILE, doublet, shown_with

from rotorid.documents.result import ResultDocument
from rotorid.report.identification import (
    correlation_picture,
    correlation_sentence,
    delay_rows,
    delay_sentence,
    matrix_tables,
    reduction_sentence,
    render_sections,
    section,
)
from rotorid.report.parts import constants_sentence, dropped_parameters, parameter_groups
from rotorid.report.words import (
    fit_sentences,
    mode_sentences,
    pole_rows,
    poles_picture,
    poles_sentence,
    sparkline,
    summary,
)
from rotorid.results.summary import Correlation, DelayBudget, FitEnd, PoleEstimate


@pytest.fixture(scope="module")
def page() -> Page:
    return Page(render_sections([hover_identification()], title="t", truth={"M_q": 0.9, "M_u": 11.5}))


def changed(**updates: Any) -> ResultDocument:
    return hover_document().model_copy(update=updates)


def test_the_page_is_whole_and_its_links_lead_somewhere(page: Page) -> None:
    identifiers = page.attributes("id")
    assert len(set(identifiers)) == len(identifiers)
    assert {target.removeprefix("#") for target in page.attributes("href")} <= set(identifiers)
    assert sorted(page.attributes("data-picture")) == sorted(page.figures["pictures"])
    assert "None" not in page.words.split()


def test_hostile_names_stay_text() -> None:
    parameters = {HOSTILE: hover_document().parameters["M_u"], **hover_document().parameters}
    named = Correlation(names=[HOSTILE, *"abcd"], matrix=[[0.5] * 5] * 5)
    hostile = changed(parameters=parameters, correlation=named, states=[HOSTILE, "u", "w", "theta"])
    shown = Page(render_sections([shown_with(hover_identification(), document=hostile)], title="t"))
    assert len(shown.scripts) == 3
    map_of = shown.figures["pictures"]["s1-correlation"]
    assert HOSTILE not in str(map_of)
    assert "&lt;script&gt;" in str(map_of)


class TestSummary:
    def test_it_says_what_the_vehicle_is(self) -> None:
        assert summary(hover_document()) == (
            "Pitch: 149.2 ± 0.3 rad/s² per unit command, delay 39.70 ± 0.14 ms.",
            "Thrust: −13.80 ± 0.05 m/s² per unit command, delay 39.70 ± 0.14 ms.",
            "Pitch is unstable: it oscillates at 5.02 rad/s and doubles in 0.27 s, as usual for a multirotor without "
            "an autopilot.",
            "Fit: good. The average cost is 25.6 (up to 50 is good, up to 100 acceptable). "
            "Worst of 10 responses: az/pitch_command, cost 120 (the model misses the measurement).",
            "Unseen sweeps: worst cost 4.7 (practically indistinguishable from the flight).",
        )

    def test_a_lag_that_axes_share_is_said_once(self) -> None:
        lag = dataclasses.replace(hover_document().parameters["tau_pitch"], value=0.03, std=0.0004)
        sentences = summary(changed(parameters={**hover_document().parameters, "T_motor": lag}))
        assert [one for one in sentences if "lag" in one] == ["Motor lag of all axes: 30.0 ± 0.4 ms."]


class TestParameters:
    def test_they_stand_by_force_and_moment(self) -> None:
        groups = parameter_groups(hover_document(), {})
        assert [(group.title, [row.name for row in group.rows]) for group in groups] == [
            ("Pitching moment", ["M_u", "M_pitch"]),
            ("Forward force", ["X_u", "X_pitch"]),
            ("Vertical force", ["Z_w", "Z_thrust"]),
            ("Delays and lags", ["tau_pitch", "tau_thrust"]),
        ]

    def test_what_has_no_axis_comes_last(self) -> None:
        physical = {"J_x": hover_document().parameters["M_u"], **hover_document().parameters}
        assert [group.title for group in parameter_groups(changed(parameters=physical), {})][-1] == "Others"

    def test_a_tied_one_has_its_deviation(self, page: Page) -> None:
        rows = {row[0].split()[0]: row for row in page.rows("Status") if len(row) > 1}
        assert rows["tau_thrust"][1] == "0.03970 ± 0.00014"
        assert rows["tau_thrust"][5] == "tied"

    def test_dropped_ones_are_a_sentence_that_links_to_the_reason(self, page: Page) -> None:
        targets = {one.name: one.target for one in dropped_parameters(hover_document(), anchor="s1")}
        assert targets == {"M_q": "s1-step-0", "T_motor": "s1-findings"}
        assert "(click for the reason): M_q, T_motor. True values: M_q 0.9." in page.words
        assert set(DROPPED) & {row[0] for group in page.tables for row in group} == set()


class TestFit:
    def test_words_say_weights_end_and_trace(self) -> None:
        fit = hover_document().fit
        assert fit is not None
        assert " ".join(fit_sentences(fit)).endswith(
            "The solver ended after 6 evaluations: the cost no longer falls. In 2 steps the total cost fell from 66 to "
            "26.9."
        )

    def test_words_say_what_the_structure_misses(self) -> None:
        fit = FitEnd(
            weights="cifer",
            outcome="Done.",
            evaluations=1,
            trace=(3.0,),
            inflation=2.0,
            model_error={"p/roll_command": 0.005, "ay/roll_command": 0.04},
        )
        assert fit_sentences(fit)[-1] == (
            "The model structure misses ay/roll_command by 4 % and the others by less. With this and with clock "
            "errors, standard deviations are 2 times those of random errors."
        )

    def test_nothing_is_said_of_what_did_not_happen(self) -> None:
        still = FitEnd(weights="cifer", outcome="Done.", evaluations=1, trace=(3.0,), inflation=1.0)
        assert fit_sentences(still) == (
            "Errors are weighted by coherence, as in CIFER.",
            "The solver ended after 1 evaluation: done.",
        )

    def test_the_curve_falls_on_a_logarithmic_scale(self) -> None:
        corners = [tuple(map(float, corner.split(","))) for corner in sparkline([1000.0, 100.0, 10.0, 1.0]).split()]
        steps = {round(after[1] - before[1], 1) for before, after in itertools.pairwise(corners)}
        # Drawn with one decimal: 20/3 down for every decade.
        assert steps <= {6.6, 6.7}
        assert sparkline([2.0, math.nan, 0.0, 1.0]) == ""
        assert sparkline([2.0, 2.0, 2.0]).endswith("117.0,3.0")


class TestPoles:
    def test_a_pair_is_a_row_with_deviations(self) -> None:
        rows = pole_rows(poles())
        assert [row.real for row in rows] == ["−0.140 ± 0.010", "−4.6", "2.600 ± 0.008"]
        assert [row.imag for row in rows] == ["0", "0", "4.300 ± 0.009"]
        assert [row.unstable for row in rows] == [False, False, True]
        assert rows[-1].words == f"grows, doubling in {math.log(2.0) / GROWTH_1_S:.2g} s, oscillates at 5.02 rad/s"
        assert poles_sentence(poles()) == "4 poles, 2 unstable."

    def test_growth_within_its_deviation_is_not_called_growth(self) -> None:
        doubtful = PoleEstimate(real=0.01, imag=0.0, damping=-1.0, frequency_rad_s=0.01, real_std=0.02)
        (row,) = pole_rows([doubtful])
        assert not row.unstable
        assert row.words == "grows slowly, or not at all within 2 σ"
        assert mode_sentences(changed(poles=[doubtful])) == ()

    @pytest.mark.parametrize(
        ("states", "start"),
        [
            (["p", "r", "v", "phi"], "Roll is unstable: it oscillates"),
            (["q"], "Pitch is unstable: it oscillates"),
            (["u", "v", "p", "q", "phi", "theta"], "The vehicle is unstable: it oscillates"),
            (["x1"], "The vehicle is unstable: it oscillates"),
        ],
    )
    def test_a_mode_is_named_where_the_states_leave_no_doubt(self, states: list[str], start: str) -> None:
        (sentence,) = mode_sentences(changed(states=states))
        assert sentence.startswith(start)
        assert ("as usual for a multirotor" in sentence) == ("v" in states)

    def test_several_modes_share_a_sentence(self) -> None:
        faster = [dataclasses.replace(pole, real=2.0 * pole.real) for pole in poles()[:2]]
        lone = PoleEstimate(real=0.2, imag=0.0, damping=-1.0, frequency_rad_s=0.2)
        assert mode_sentences(changed(poles=[*poles(), *faster, lone])) == (
            "2 oscillations are unstable; the fastest doubles in 0.13 s, as usual for a multirotor without an "
            "autopilot.",
            "One mode is unstable without oscillation and doubles in 3.5 s.",
        )

    def test_no_finite_pole_no_picture(self) -> None:
        lost = PoleEstimate(real=math.nan, imag=0.0, damping=0.0, frequency_rad_s=math.nan)
        assert poles_picture([lost], key="k") is None
        assert poles_picture([], key="k") is None


class TestDelays:
    def test_outputs_that_share_a_budget_share_a_row(self) -> None:
        rows = delay_rows(hover_document())
        assert [(row.input, row.outputs, row.after, row.total, row.known) for row in rows] == [
            (name, *rest)
            for name in INPUTS
            for rest in (("q, u, w", "0", "39.7 ± 0.4", "–"), ("ax, az", "5", "44.7 ± 0.4", "5"))
        ]

    def test_the_sentence_is_of_the_first_budget(self) -> None:
        assert delay_sentence(hover_document()) == (
            "The vehicle responds to the pitch command after 39.7 ± 0.4 ms and the thrust command after 39.7 ± 0.4 ms."
        )

    @pytest.mark.parametrize(("status", "told"), [("free", False), ("dropped", True)])
    def test_what_answers_by_spin_up_first_has_no_delay_in_words(self, *, status: str, told: bool) -> None:
        yaw = DelayBudget(input_delay_s=0.005, motor_lag_s=0.048, output_delay_s=0.0, total_s=0.053, total_std_s=0.002)
        document = ResultDocument.model_construct(
            delays={"r/yaw_command": yaw}, parameters={"N_spin": SimpleNamespace(status=status, value=1.3)}
        )
        assert bool(delay_sentence(document)) is told

    def test_known_filters_have_a_column_where_they_are_known(self, page: Page) -> None:
        assert [row[-1] for row in page.rows("Known filters")] == ["–", "5", "–", "5"]
        bare = changed(delays={"q/pitch_command": delay("q", "pitch_command")})
        shown = Page(render_sections([shown_with(hover_identification(), document=bare)], title="t"))
        assert not any("Known filters" in cell for table in shown.tables for cell in table[0])


def test_ranges_are_in_the_units_of_paper(page: Page) -> None:
    assert page.rows("Minimum") == [
        ["forward speed u", "−2.49", "3.37", "1.04", "m/s"],
        ["pitch angle theta", "−30", "20", "10", "°"],
        ["throttle (thrust command)", "−20.4", "15.2", "8.1", "%"],
        ["battery voltage", "14.2", "16.1", "15.1", "V"],
    ]
    assert "Constants of the model: g = 9.807 m/s², U0 = 2.1 m/s, theta0 = −5.73 °." in page.words
    assert constants_sentence({"phi0": 0.0}) == ""


def test_every_step_has_its_reason_and_is_told_once(page: Page) -> None:
    assert page.rows("Why") == [
        ["1", "M_q dropped", "M_q is seen, but not apart from M_u.", "0.25 → 2.24", "9.1", "> 1000"],
        ["2", "Z_w protected", "Z_w is essential physics.", "2.24", "–", "–"],
    ]
    assert page.words.count("M_q is seen, but not apart from M_u.") == 1
    assert "1 more is listed under" in page.words
    assert "No lag is seen." in page.words
    assert reduction_sentence(hover_document().reduction) == (
        "1 of 2 tested parameters dropped; the mean cost changed from 0.25 to 2.24."
    )
    assert reduction_sentence(hover_document().reduction[1:]) == "None of 1 tested parameter dropped."


class TestCorrelation:
    def test_strong_pairs_are_named(self) -> None:
        assert correlation_sentence(correlation()).endswith("in the other): M_u and X_u: −0.97.")
        assert correlation_sentence(correlation(-0.9)) == (
            "No parameters are correlated by more than 0.9. Highest: M_u and X_u: −0.90."
        )

    def test_many_strong_pairs_are_counted(self) -> None:
        names = [f"k{number}" for number in range(6)]
        every = Correlation(names=tuple(names), matrix=[[0.95] * 6] * 6)
        assert correlation_sentence(every).endswith("; and 7 more.")

    @pytest.mark.parametrize("empty", [None, Correlation(names=("a",), matrix=((1.0,),))])
    def test_nothing_to_correlate_is_nothing_to_say(self, empty: Correlation | None) -> None:
        assert correlation_sentence(empty) == ""
        assert correlation_picture(empty, key="k") is None


def test_pictures_of_the_axis_lead_and_the_others_fold() -> None:
    shown = section(hover_identification(), anchor="s1", truth={})
    words = [picture.description for picture in shown.responses]
    assert [one.split(" over ")[0].removeprefix("Bode plot of ") for one in words] == [
        "pitch rate q",
        "forward speed u",
        "forward specific force ax",
        "downward speed w",
        "downward specific force az",
    ]
    assert len(shown.responses) + len(shown.folded_responses) == len(OUTPUTS) * len(INPUTS)
    assert [row.pair for row in shown.costs][:4] == [
        "q/pitch_command",
        "u/pitch_command",
        "ax/pitch_command",
        "w/thrust_command",
    ]


def test_only_the_first_check_is_open() -> None:
    checked = shown_with(hover_identification(), verifications=(doublet(), doublet(seed=2)))
    shown = Page(render_sections([checked], title="t"))
    checks = [found for tag, found in shown.elements if tag == "details" and "fold" not in (found.get("class") or "")]
    assert sum("open" in found for found in checks) == 1
    assert shown.words.count("Doublet in roll_doublet.ulg") + shown.words.count("Roll doublet in") == 2


def test_matrices_that_say_nothing_are_left_out() -> None:
    tables = matrix_tables(hover_document())
    assert [table.symbol for table in tables] == ["F", "G"]
    assert tables[1].columns == INPUTS
    assert tables[1].rows[0] == ("q", ("149.2", "0"))
    assert matrix_tables(changed(matrices=None)) == ()
    assert matrix_tables(changed(states=["one too few"]))[0].columns == ("1", "2", "3", "4")


def test_file_stays_small() -> None:
    """The library takes 1.2 MB; ten responses must not double that."""
    assert len(render_sections([hover_identification()], title="t").encode()) < 2_400_000


def test_the_sample_is_a_valid_document_with_all_fields() -> None:
    document = hover_document()
    assert ResultDocument.model_validate_json(document.model_dump_json(by_alias=True)) == document
    assert set(FREE) < set(document.parameters)
