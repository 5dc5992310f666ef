"""One verdict of a fit: a word, a color and a reason that contradict no finding, equal wherever it is shown."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from tests.unit.flying.test_vehicle_from_results import result
from tests.unit.report.made_reviews import made_review

from rotorid.cli.console import INKS
from rotorid.cli.identify import print_result
from rotorid.data.findings import Finding, remark, warn
from rotorid.documents.base import to_json
from rotorid.documents.compare import _model
from rotorid.documents.result import refused_document, result_document
from rotorid.documents.review import review_document
from rotorid.identifying.comparison import Entry
from rotorid.report.compare import _model_row
from rotorid.report.parts import cost_rows
from rotorid.report.review import render_reviews
from rotorid.report.words import document_verdict, summary
from rotorid.results.model import IdentifiedModel, Refused
from rotorid.results.summary import Cost, PairCost, ParameterEstimate
from rotorid.results.verdicts import LEVEL_OF, badge, cost_verdict, error_of, response_verdict, verdict

MISSED = warn("structure_error", "p/roll_command", "It misses.", model_error_percent=18.0)
UNDECIDED = warn("structure_error", "p/roll_command", "It may miss.", model_error_percent=16.0, log_likelihood=1.0)
COSTLY = warn("structure_error", "p/roll_command", "It costs.", cost=60.0, median_cost=2.0)
RESTLESS = warn("not_converged", "rate.roll", "It did not come to rest.")
IMPOSSIBLE = warn("impossible_physics", "thrust", "It carries too much.")


def model(
    *, cost: float | None = 0.2, percent: dict[str, float] | None = None, findings: tuple[Finding, ...] = ()
) -> IdentifiedModel:
    made = result("rate.roll", {"L_p": -1.0})
    pairs = {"p/roll_command": PairCost(value=cost or 0.0, band_rad_s=(1.0, 40.0), points=40)}
    fit = replace(
        made.fit,
        cost=None if cost is None else Cost(average=cost, pairs=pairs),
        fit_percent=percent,
        method="output_error" if percent else "frequency",
    )
    return replace(made, fit=fit, findings=findings)


CASES = [
    (model(), "good", "green"),
    (model(cost=50.0), "good", "green"),
    (model(cost=72.0), "acceptable", "yellow"),
    (model(cost=141.0), "poor", "red"),
    (model(cost=7.3, findings=(MISSED,)), "follows the data only", "yellow"),
    (model(cost=141.0, findings=(MISSED,)), "poor", "red"),
    (model(cost=7.3, findings=(COSTLY,)), "partly valid", "yellow"),
    (model(cost=0.2, findings=(RESTLESS, MISSED)), "not settled", "yellow"),
    (model(cost=0.2, findings=(IMPOSSIBLE,)), "not physical", "yellow"),
    (model(cost=0.2, findings=(UNDECIDED,)), "partly valid", "yellow"),
    (model(cost=0.2, findings=(remark("structure_error", "p", "Said only."),)), "good", "green"),
    (model(cost=None, percent={"p": 91.0, "q": 66.0}), "good", "green"),
    (model(cost=None, percent={"p": 91.0, "q": 37.0}), "weak", "yellow"),
    (model(cost=None, percent={"p": -4.0}), "poor", "red"),
    (model(cost=None), "not judged", "gray"),
]
IDS = [f"{word}-{number}" for number, (_, word, _) in enumerate(CASES)]


@pytest.mark.parametrize(("made", "word", "color"), CASES, ids=IDS)
def test_word_and_color_follow_one_rule(made: IdentifiedModel, word: str, color: str) -> None:
    found = verdict(made)
    assert (found.word, found.color) == (word, color)
    assert found.reason.endswith(".")


@pytest.mark.parametrize(("made", "word", "color"), CASES, ids=IDS)
def test_every_place_shows_the_same_verdict(
    made: IdentifiedModel, word: str, color: str, tmp_path: object, capsys: pytest.CaptureFixture[str]
) -> None:
    found, document = verdict(made), result_document(made)
    # The file, the page, the lab (which shows the file), the terminal, and a review with its file.
    assert json.loads(to_json(document))["verdict"] == {
        "word": word,
        "color": color,
        "reason": found.reason,
        "number": found.number,
    }
    assert document_verdict(document) == found
    if document.cost is not None or document.fit_percent:
        assert any(f"Fit: {word}. {found.reason}" in sentence for sentence in summary(document))
    print_result(document, tmp_path)  # type: ignore[arg-type]
    printed = " ".join(capsys.readouterr().out.split())
    assert f"fit: {word}. {found.reason}" in printed
    assert color in INKS
    seen = replace(made_review(), models={"rate.roll": made})
    assert review_document(seen).models["rate.roll"].verdict == found
    shown = badge(found)
    assert shown.level == LEVEL_OF[found.color]
    assert f'<span class="badge {shown.level}">{shown.words}</span>' in render_reviews([seen])
    assert f"fit: {word}. " in repr(made)
    compared = _model(Entry(label="one", model=made), None)
    assert compared.verdict == found
    assert _model_row(compared).fit == shown


@pytest.mark.parametrize("cost", [0.1, 7.3, 49.9])
def test_no_green_stands_beside_values_without_physical_meaning(cost: float) -> None:
    made = model(cost=cost, findings=(MISSED,))
    assert "no physical meaning" in verdict(made).reason
    assert verdict(made).color != "green"
    (row,) = cost_rows(result_document(made))
    assert row.verdict == response_verdict("p/roll_command", cost, made.findings)
    assert row.verdict is not None
    assert row.verdict.level == "fair"
    # Nor is a response wrong whose structure the data cannot judge.
    note = remark("structure_error", "p/roll_command", "Not enough data.", log_likelihood=1.0)
    assert response_verdict("p/roll_command", cost, [note]) == cost_verdict(cost)
    # Another response is not touched.
    assert response_verdict("q/pitch_command", cost, made.findings) == cost_verdict(cost)


def test_a_model_error_that_the_data_cannot_decide_is_no_pass_and_no_verdict() -> None:
    assert response_verdict("p/roll_command", 7.3, [UNDECIDED]).words == "the model may miss it by 16 %"


def test_what_was_refused_is_gray_and_says_why() -> None:
    why = Finding(kind="no_excitation", severity="error", where="roll", message="Nothing moved roll.")
    refused = Refused(name="rate.roll", structure=None, findings=(why,), provenance=model().provenance)
    found = verdict(refused)
    assert (found.word, found.color, found.reason) == ("no model", "gray", "Nothing moved roll.")
    document = refused_document(refused)
    assert document.verdict == document_verdict(document) == found


def test_a_number_that_was_fitted_first_keeps_its_error() -> None:
    fixed = ParameterEstimate(value=-0.23, std=None, unit="1/s", status="fixed")
    said = [remark("speed_damping_first", "X_u", "X_u was estimated first, and then fixed.", value=-0.23, std=0.04)]
    assert error_of("X_u", fixed, said) == 0.04
    assert error_of("Y_v", fixed, said) is None
    assert error_of("X_u", replace(fixed, std=0.1, status="free"), said) == 0.1
