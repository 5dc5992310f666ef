"""What a page shows of a search and of a bootstrap; nothing of either where there was none."""

from __future__ import annotations

import dataclasses

from tests.unit.report.page_parser import Page
from tests.unit.report.sample import HOSTILE, document, identification, shown_with

from rotorid.data.quantity import error_columns
from rotorid.documents.base import FindingDocument
from rotorid.documents.result import ResultDocument
from rotorid.report.identification import bootstrap_shown, render_sections, search_shown
from rotorid.results.summary import BootstrapSummary, Correlation, SearchMinimum, SearchSummary, Spread


def basin(cost: float, share: float, gain: float) -> SearchMinimum:
    return SearchMinimum(cost=cost, share=share, parameters={"L_roll": gain, "tau_roll": 0.0024})


def a_search(*, name: str = "sobol:10", minima: int = 2) -> SearchSummary:
    return SearchSummary(
        name=name,
        objective="frequency",
        evaluations=10,
        polishing=123,
        local_searches=10,
        minima=[basin(21.5 + place, 1.0 / minima, 437.0 + place) for place in range(minima)],
        trace=(
            (14, 60.0),
            (31, 21.5),
        ),
    )


def a_bootstrap(*, relative_percent: float | None = 0.71, left_out: int = 0) -> BootstrapSummary:
    spread = Spread(mean=437.4, std=3.11, relative_percent=relative_percent, low=431.4, median=437.3, high=443.6)
    return BootstrapSummary(
        source="responses",
        runs=500,
        seed=0,
        left_out={"no value": left_out} if left_out else {},
        parameters={"L_roll": spread},
        correlation=Correlation(names=("L_roll",), matrix=((1.0,),)),
    )


def page_of(result: ResultDocument) -> Page:
    return Page(render_sections([shown_with(identification(), document=result)], title="t"))


def test_a_search_shows_how_its_cost_fell_and_every_minimum() -> None:
    page = page_of(document().model_copy(update={"search": a_search()}))
    assert "sobol:10 minimized CIFER's cost, summed over the responses: 10 evaluations" in page.words
    assert "then 123 in 10 local searches" in page.words
    assert "Local searches found 2 minima" in page.words
    assert page.rows("Local searches [%]") == [["21.5", "50", "437", "0.0024"], ["22.5", "50", "438", "0.0024"]]
    figure = page.figures["pictures"]["s1-search-cost"]
    assert figure["data"][0]["x"] == [14, 31]
    assert figure["data"][0]["y"] == [60, 21.5]
    assert set(figure["data"][1]["y"]) == {21.5}
    assert "#s1-search" in page.attributes("href")
    assert "how much of the box leads to this minimum" in page.words


def test_the_share_of_a_population_is_said_to_say_little() -> None:
    page = page_of(document().model_copy(update={"search": a_search(name="genetic:15x50", minima=1)}))
    assert "They do not measure how wide a basin is" in page.words
    assert "ended in the same minimum" in page.words


def test_of_many_minima_the_lowest_are_shown() -> None:
    shown = search_shown(a_search(minima=15), key="k")
    assert shown is not None
    assert (len(shown.rows), shown.more) == (12, 3)


def test_a_search_that_began_at_its_best_has_no_curve() -> None:
    shown = search_shown(dataclasses.replace(a_search(), trace=((14, 21.5), (31, 21.5))), key="k")
    assert shown is not None
    assert shown.picture is None


def test_a_bootstrap_stands_beside_what_is_stated() -> None:
    result = document().model_copy(update={"bootstrap": a_bootstrap(left_out=3)})
    page = page_of(result)
    one = result.parameters["L_roll"]
    assert one.std is not None
    ((name, unit, value, stated, *spread),) = page.rows("Stated std")
    assert (name, unit, (value, stated)) == ("L_roll", "rad/s²", error_columns(one.value, one.std))
    assert spread == ["437", "3", "0.71", "431 to 444"]
    assert "500 refits, each to newly drawn random errors of the responses" in page.words
    assert "3 did not converge and are not counted" in page.words


def test_a_spread_that_contradicts_what_is_stated_is_marked() -> None:
    finding = FindingDocument(kind="bootstrap_disagrees", severity="warning", where="L_roll", message="It is wider.")
    plain = document().model_copy(update={"bootstrap": a_bootstrap(relative_percent=None)})
    for findings, marked in (([], False), ([finding], True)):
        shown = bootstrap_shown(plain.model_copy(update={"findings": findings}))
        assert shown is not None
        assert shown.rows[0].std.marked is marked
        assert shown.rows[0].relative == "–"


def test_names_do_not_act() -> None:
    page = page_of(document().model_copy(update={"search": a_search(name=HOSTILE), "bootstrap": a_bootstrap()}))
    assert len(page.scripts) == 3


def test_without_them_the_page_has_neither() -> None:
    assert search_shown(None, key="k") is None
    assert bootstrap_shown(document()) is None
    identifiers = page_of(document()).attributes("id")
    assert not {"s1-search", "s1-bootstrap"} & set(identifiers)
