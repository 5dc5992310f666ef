"""The page of ``compare``: who does best, on what, and where parameters differ."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from tests.unit.identifying.response_twins import flight, written
from tests.unit.report.page_parser import Page

import rotorid
from rotorid.documents.compare import CrossValidatedDocument, compare_document, read_results
from rotorid.identifying.comparison import Comparison, compare
from rotorid.report.compare import (
    comparison_summary,
    model_rows,
    render_comparison,
    render_documents,
    shared_rows,
    unshared_parameters,
    write_comparison,
)

LABELS = ("first", "second", "other")
HOSTILE = "<script>alert(1)</script>"


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("results")
    return [
        written(folder / "first", "response.first_order", 1),
        written(folder / "second", "response.second_order", 1),
        written(folder / "other", "response.second_order", 2),
    ]


@pytest.fixture(scope="module")
def unseen(results: list[Path]) -> Comparison:
    return compare(read_results(results), [flight(1), flight(3)])


@pytest.fixture(scope="module")
def page(unseen: Comparison) -> Page:
    return Page(render_comparison(unseen, title="three models"))


def test_the_best_on_unseen_data_comes_first(unseen: Comparison) -> None:
    (sentence, _) = comparison_summary(compare_document(unseen))
    assert sentence.startswith("Best on 1 maneuver unseen by all models: ")
    assert "(next: " in sentence


def test_without_logs_the_page_says_what_would_help(results: list[Path]) -> None:
    (sentence, _) = comparison_summary(compare_document(compare(read_results(results))))
    assert "--log" in sentence


def test_a_lead_within_the_spread_is_said_to_be_none(results: list[Path]) -> None:
    (sentence, _) = comparison_summary(compare_document(compare(read_results(results[1:]), [flight(3), flight(4)])))
    assert sentence.startswith("Best on 2 maneuvers unseen by all models: ")
    # Two estimates of one truth differ by less than two flights do.
    assert sentence.endswith("%, within the spread).")


def test_models_without_common_outputs_are_not_asked_for_a_log_again(unseen: Comparison) -> None:
    document = compare_document(unseen)
    apart = document.model_copy(update={"models": [m.model_copy(update={"on_logs": None}) for m in document.models]})
    sentence, *_ = comparison_summary(apart)
    assert "no maneuver of the logs has a score of every model" in sentence
    assert "--log" not in sentence
    sentence, *_ = comparison_summary(apart.model_copy(update={"maneuvers": []}))
    assert "Add --log LOG" in sentence


def test_cross_validated_results_are_ranked(results: list[Path]) -> None:
    document = compare_document(compare(read_results(results)))
    means = (72.5, 81.4, 80.0)
    models = [
        one.model_copy(
            update={
                "cross_validation": CrossValidatedDocument(
                    kind="each", mean_percent=mean, spread_percent=2.9, best_percent=mean + 2.0
                )
            }
        )
        for one, mean in zip(document.models, means, strict=True)
    ]
    crossed = document.model_copy(update={"models": models})
    ranked, _ = comparison_summary(crossed)
    assert ranked == "Best by cross-validation: second, with 81.4 % (next: other, 80 %)."
    assert [row.validated for row in model_rows(crossed)] == ["72.5 ± 2.9", "81.4 ± 2.9", "80.0 ± 2.9"]


def test_one_row_for_each_model(page: Page) -> None:
    rows = page.tables[0][1:]
    assert [row[0].startswith(label) for row, label in zip(rows, LABELS, strict=True)] == [True] * 3
    assert [row[0].endswith("_order") for row in rows] == [True] * 3
    assert [row[3:5] for row in rows] == [["1", "2"], ["2", "3"], ["2", "3"]]


def test_what_was_fitted_is_marked(page: Page) -> None:
    known, new = page.tables[1][1:]
    assert [cell.endswith("fitted") for cell in known[1:]] == [True, True, False]
    assert not any(cell.endswith("fitted") for cell in new)


def test_shared_parameters_stand_in_a_row(unseen: Comparison) -> None:
    rows = {row.name: row for row in shared_rows(compare_document(unseen))}
    assert rows.keys() == {"K_phi", "omega_phi", "zeta_phi"}
    assert rows["omega_phi"].values[0].text == "–"
    assert rows["omega_phi"].distances[1].text == ""
    assert rows["omega_phi"].distances[2].text.endswith(" σ")
    assert unshared_parameters(compare_document(unseen)) == {"first": 1, "second": 0, "other": 0}


def test_every_picture_is_placed_and_drawn(page: Page) -> None:
    placed = page.attributes("data-picture")
    assert placed == ["scores", "maneuver-0", "maneuver-1", "steps"]
    assert set(page.figures["pictures"]) == set(placed)
    names = {trace["name"] for trace in page.figures["pictures"]["maneuver-0"]["data"]}
    assert names == {"measured", "first", "second", "other"}


def test_both_files_are_written(unseen: Comparison, tmp_path: Path) -> None:
    write_comparison(tmp_path / "made", unseen, title="t")
    assert {path.name for path in (tmp_path / "made").iterdir()} == {"compare.json", "report.html"}


def test_a_hostile_label_can_only_be_read(results: list[Path]) -> None:
    first, *others = read_results(results)
    html = render_comparison(compare([replace(first, label=HOSTILE), *others], [flight(3)]), title=HOSTILE)
    assert HOSTILE not in html
    assert HOSTILE in "".join(Page(html).text)


def test_a_filter_before_a_prediction_is_named(unseen: Comparison) -> None:
    looks_ahead = "makes all scores a little too good"

    def shown(band_rad_s: tuple[float, float] | None, horizon_s: float | None) -> bool:
        update = {"band_rad_s": band_rad_s, "horizon_s": horizon_s}
        document = compare_document(unseen).model_copy(update=update)
        return looks_ahead in render_documents(document, unseen.maneuvers, title="t")

    assert shown((1.0, 20.0), 0.5)
    assert not shown(None, 0.5)
    assert not shown((1.0, 20.0), None)


def test_a_page_says_which_distances_are_left_out(page: Page, unseen: Comparison) -> None:
    assert "not given for results of the same log" in "".join(page.text)
    gain = next(row for row in shared_rows(compare_document(unseen)) if row.name == "K_phi")
    assert [bool(cell.text) for cell in gain.distances] == [False, False, True]


def test_a_comparison_shows_its_models_and_is_saved(unseen: Comparison, tmp_path: Path) -> None:
    lines = repr(unseen).splitlines()
    assert lines[0].startswith("3 models compared on ")
    assert {"first", "second", "other"} <= {line.split()[0] for line in lines[1:]}
    rotorid.save(unseen, tmp_path)
    assert rotorid.load_document(tmp_path) == compare_document(unseen)
