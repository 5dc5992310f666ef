"""The page of ``verify``: verdicts in words, scores, pictures."""

from __future__ import annotations

import dataclasses

from tests.unit.report.page_parser import Page
from tests.unit.report.sample import HOSTILE, maneuver
from tests.unit.report.verification_sample import flown, verified, verify_document

from rotorid.report.verification import (
    check_section,
    j_rms_sentence,
    render_checks,
    score_rows,
    verification_summary,
)
from rotorid.report.words import unseen_sentences


def page(**options: float) -> Page:
    return Page(render_checks(*verified(**options), title="t"))  # type: ignore[arg-type]


def test_the_verdicts_come_first() -> None:
    assert verification_summary(verify_document()) == (
        "rate.roll predicts 1 unseen maneuver well.",
        *unseen_sentences(verify_document().maneuvers)[1:],
        "In closed loop, with the controller of the flight, the roll command has a TIC of 0.17 at worst; the logged "
        "controller alone has 0.03.",
        "rate.roll predicts unseen sweeps very well: cost 12.3 in p/roll_command (up to 50 is very good, up to 100 "
        "acceptable).",
    )


def test_one_row_for_each_signal() -> None:
    head, rate, command = page().tables[0]
    assert head[-2:] == ["TIC ahead", "TIC in closed loop"]
    assert rate[1:3] == ["good", "1.4"] or rate[1] == "good"
    assert rate[3:] == ["roll rate p", "0.041", "92", "0.06 · 0.06", "0.05"]
    assert command == ["roll command", "–", "–", "–", "0.17"]


def test_without_a_controller_there_is_no_column_for_it() -> None:
    document, found = verified()
    bare = dataclasses.replace(found, maneuvers=(dataclasses.replace(flown(), closed_loop=None),))
    assert "closed loop" not in Page(render_checks(document, bare, title="t")).tables[0][0][-1]


def test_every_picture_is_placed_and_drawn() -> None:
    shown = page()
    placed = shown.attributes("data-picture")
    assert placed == ["check-0", "check-0-ahead", "check-0-loop", "sweeps-0-0"]
    assert set(shown.figures["pictures"]) == set(placed)


def test_a_sweep_is_shown_with_its_cost_and_its_error() -> None:
    shown = page()
    names = {trace.get("name") for trace in shown.figures["pictures"]["sweeps-0-0"]["data"]}
    assert {"measured", "model"} <= names
    (row,) = [row for row in shown.rows("Response") if row[0] == "p/roll_command"]
    assert row[1] == "12.3"


def test_both_readings_of_the_guideline() -> None:
    assert j_rms_sentence(verify_document(scale=16.0)) == (
        "J_rms is 1.4 in degrees and feet. The guideline is 1 to 2 at full scale. For N = 16 it is 4 to 8 by the "
        "square root of N, as speeds scale, or 16 to 32 by N, as in print."
    )
    assert "--scale" in j_rms_sentence(verify_document())


def test_outputs_that_did_not_move_are_not_judged() -> None:
    still = dataclasses.replace(
        flown(),
        moved=("r",),
        output_names=("p", "r"),
        measured=[flown().measured[0]] * 2,
        predicted=[flown().predicted[0]] * 2,
        scores={"p": flown().scores["p"], "r": flown().scores["p"]},
        ahead=None,
        closed_loop=None,
    )
    first, second = score_rows(still)
    assert (first.output, first.moved, second.output, second.moved) == ("yaw rate r", True, "roll rate p", False)
    assert second.verdict is None
    assert check_section(still, key="k").ahead is None


def test_several_maneuvers_are_counted_by_verdict() -> None:
    several = [
        maneuver(),
        maneuver(verdict="diverges", tic=0.5, fit=-20.0),
        maneuver(verdict="disturbed"),
        maneuver(verdict="poor", tic=0.4, fit=30.0),
    ]
    first, second, *_ = verification_summary(verify_document().model_copy(update={"maneuvers": several}))
    assert first == (
        f"{verify_document().model} on 4 unseen maneuvers: 1 predicted well, 1 predicted well over short times (the "
        "airframe is unstable, so the open loop diverges), 1 too disturbed to judge, 1 predicted poorly."
    )
    assert second.startswith("Worst output in open loop: roll rate p, TIC 0.5, fit −20 %")


def test_a_hostile_log_can_only_be_read() -> None:
    html = render_checks(*verified(record=HOSTILE), title=HOSTILE)
    assert HOSTILE not in html
    assert HOSTILE in "".join(Page(html).text)
