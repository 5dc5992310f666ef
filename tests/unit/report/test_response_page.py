"""The page of responses shows the numbers of its document, stands alone, and shows hostile text as text."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from tests.unit.report.page_parser import Page
from tests.unit.report.response_sample import CROSSOVER_RAD_S, DELAY_S, HOLLOW, OMEGA, axis_loop, responses
from tests.unit.report.sample import HOSTILE

from rotorid.data.quantity import significant, with_error
from rotorid.data.response import Estimate
from rotorid.documents.response import BoundDocument, EstimatedDocument, LoopDocument, loops_of, response_document
from rotorid.report.parts import by_axis, leading_pairs
from rotorid.report.response import loop_rows, pair_rows, render_responses, unseen
from rotorid.report.response_words import response_summary
from rotorid.spectral.margins import attitude_bandwidth


@pytest.fixture(scope="module")
def page() -> Page:
    return Page(render_responses(responses(), title="Responses from a sweep"))


@pytest.fixture(scope="module")
def hostile() -> Page:
    return Page(render_responses(responses(record=HOSTILE), title=HOSTILE))


def test_the_table_shows_the_numbers_of_the_document(page: Page) -> None:
    rows = page.rows("Usable")
    document = responses()
    assert [row[0].split()[0] for row in rows] == [name for name in document.pairs if name != HOLLOW]
    for row in rows:
        pair = document.pairs[row[0].split()[0]]
        assert pair.band_rad_s is not None
        assert row[1].startswith(f"{significant(pair.band_rad_s[0])} to {significant(pair.band_rad_s[1])}")
        assert row[1].endswith(f"to {significant(pair.band_rad_s[1] / 2.0 / math.pi)} Hz")
        assert int(row[2]) == pair.points
        assert float(row[3]) == pytest.approx(pair.mean_coherence, abs=0.005)
        # Two significant digits: half a unit of the second is at most 5 % of the number.
        assert float(row[4]) == pytest.approx(100.0 * pair.mean_random_error, rel=0.05)
        assert float(row[5]) == pytest.approx(pair.direct_difference_db, rel=0.05)
        assert float(row[6]) == pytest.approx(3.0)


def test_margins_are_those_of_the_loop_with_their_deviations(page: Page) -> None:
    shown = {row[0]: row[1:] for row in page.rows("Number")}
    numbers = responses().loops["roll"].numbers
    margin = numbers["phase_margin_rad"]
    assert shown["Phase margin"] == [with_error(math.degrees(margin.value), math.degrees(margin.std)), "°"]
    told = float(shown["Phase margin"][0].split(" ± ")[0])
    truth = 90.0 - math.degrees(CROSSOVER_RAD_S * DELAY_S)
    assert told == pytest.approx(truth, abs=3.0 * math.degrees(margin.std))
    gain = float(shown["Gain margin upward"][0].split(" ± ")[0])
    assert gain == pytest.approx(20.0 * math.log10(math.pi / 2.0 / DELAY_S / CROSSOVER_RAD_S), abs=0.5)
    assert shown["Gain margin upward"][1] == "dB"
    assert float(shown["Delay margin"][0].split(" ± ")[0]) == pytest.approx(
        1e3 * numbers["delay_margin_s"].value, rel=0.02
    )


def test_every_number_that_a_loop_can_have_has_its_words() -> None:
    loop = axis_loop()
    attitude = attitude_bandwidth(loop.loop)
    hollow = [dataclasses.replace(part, **blank(part)) for part in (loop.margins, loop.rejection, attitude)]
    margins, rejection, attitude = hollow  # type: ignore[assignment]
    document = dataclasses.replace(loop, margins=margins, rejection=rejection, attitude=attitude)
    assert len(unseen(document)) == len(document.not_seen) == 15
    seen = axis_loop()
    assert len(loop_rows(seen)) == len(seen.numbers)
    assert [entry.words for entry in unseen(seen)] == ["Gain margin downward"]


def test_a_rate_loop_and_the_whole_loop_stand_beside_each_other() -> None:
    both = dataclasses.replace(axis_loop(), scope="rate", whole=axis_loop())
    found = dataclasses.replace(responses(), loops={"roll": both})
    assert [(axis, key, loop.scope) for axis, key, loop in loops_of(found.loops)] == [
        ("roll", "roll", "rate"),
        ("roll", "roll_whole", "whole"),
    ]
    words = " ".join(response_summary(found))
    assert "Rate loop of roll: crossover at" in words
    assert "Whole loop of roll: crossover at" in words
    written = response_document(found).loops["roll"]
    assert (written.scope, written.whole.scope if written.whole else "") == ("rate", "whole")
    assert all(number.lower < number.value < number.upper for number in written.numbers.values())


def blank(part: Any) -> dict[str, Any]:
    """Everything that a part may fail to see, each for a reason of its own."""
    told = ("crossovers", "not_seen", "bounds")
    names = [field.name for field in dataclasses.fields(part) if not field.name.endswith(told)]
    return dict.fromkeys(names) | {"not_seen": {name: f"{type(part).__name__} {name}" for name in names}}


def test_what_was_missed_for_one_reason_is_told_once() -> None:
    reason = "no peak in 1 to 20 rad/s"
    names = ("modulus_margin", "modulus_omega_rad_s", "disturbance_rejection_peak")
    (entry,) = unseen(LoopDocument(method="", not_seen=dict.fromkeys(names, reason)))
    assert (entry.words, entry.reason) == ("Modulus margin, disturbance-rejection peak", reason)


def test_a_peak_at_the_end_of_a_band_is_bounded_and_not_missed() -> None:
    peak = "disturbance_rejection_peak"
    bound = BoundDocument(value=2.7, std=0.1, omega_rad_s=119.0, at_least=True)
    missed = dict.fromkeys((peak, f"{peak}_omega_rad_s"), "no peak in 1 to 119 rad/s")
    assert unseen(LoopDocument(method="", not_seen=missed, bounds={peak: bound})) == ()


def test_a_factor_is_shown_in_decibels() -> None:
    two = LoopDocument(method="", numbers={"gain_margin_up": EstimatedDocument(value=2.0, std=0.1)})
    (row,) = loop_rows(two)
    # 20 log10(2) and 20 / ln(10) * 0.1 / 2.
    assert (row.value, row.unit) == ("6.0 ± 0.4", "dB")


def test_pictures_are_of_usable_pairs_and_fit_their_places(page: Page) -> None:
    placed = page.attributes("data-picture")
    assert sorted(placed) == sorted(page.figures["pictures"])
    assert [key for key in placed if key.startswith("response")] == ["response-0", "response-1", "response-2"]
    assert [key for key in placed if key.startswith("windows")] == ["windows-0", "windows-1", "windows-2"]
    assert {"bands", "loop-roll", "rejection-roll", "timeline-0"} <= set(placed)
    assert f"Nothing can be used of {HOLLOW}." in page.words


def test_the_timeline_shades_the_maneuvers_that_were_used(page: Page) -> None:
    shapes = page.figures["pictures"]["timeline-0"]["layout"]["shapes"]
    assert {(shape["x0"], shape["x1"]) for shape in shapes} == {(12.0, 52.0), (52.0, 92.0)}
    assert [row[-1] for row in page.rows("Maneuver")] == ["used", "used", "left out"]
    assert "coherence alone: p/roll_command 0.21" in page.words


def test_the_map_shows_the_band_that_was_asked_for(page: Page) -> None:
    for units, factor in (("rad/s", 1.0), ("Hz", 0.5 / math.pi)):
        shapes = page.figures["pictures"]["bands"]["views"][units]["layout"]["shapes"]
        assert {(shape["x0"], shape["x1"]) for shape in shapes} == {(0.4 * factor, 90.0 * factor)}


def test_a_lonely_point_is_a_band_on_the_map() -> None:
    used = np.zeros((2, 2, OMEGA.size), dtype=bool)
    used[0, 0, [0, 40, -1]] = True
    shown = Page(render_responses(responses(used=used), title="t"))
    bar = shown.figures["pictures"]["bands"]["views"]["rad/s"]["data"][0]["x"]
    starts, stops = bar[::3], bar[1::3]
    for k, start, stop in zip((0, 40, -1), starts, stops, strict=True):
        assert start <= float(f"{OMEGA[k]:.5g}") <= stop
        assert start < stop


def test_words_come_first_and_name_what_was_measured(page: Page) -> None:
    first, second, *rest = response_summary(responses())
    assert first == (
        "Roll rate p and sideward specific force ay over roll command and yaw command, "
        "from 2 roll sweeps of 80 s together."
    )
    assert second == (
        "Joint estimate with roll_excitation and yaw_excitation as instruments, so feedback does not bias it."
    )
    assert rest[0] == "3 of 4 responses are usable in some band."
    # All of them have the same band: none is the widest.
    assert rest[1].startswith("Each is usable from 0.5 to ")
    assert rest[1].endswith(" at worst.")
    assert "Whole loop of roll: crossover at" in " ".join(rest)
    assert rest[-1] == ("Most serious finding: unheard of (roll_sweeps.ulg): A file was named roll_sweeps.ulg.")
    shown = page.words[page.words.index(first) :]
    order = [shown.index(words) for words in ("Frequency responses", "Loops and margins", "Usable bands", "sha256")]
    assert order == sorted(order)


@pytest.mark.parametrize(("estimate", "said"), [("joint", False), ("direct", True)])
def test_a_direct_estimate_is_said_to_be_biased_by_feedback(estimate: Estimate, said: bool) -> None:
    shown = Page(render_responses(responses(estimate=estimate), title="t"))
    assert ("feedback through the controller may bias it" in shown.words) == said
    assert ("differs [dB]" in shown.words) != said


def test_the_coherence_in_force_is_told_and_drawn(page: Page) -> None:
    assert "a coherence of at least 0.3" in page.words
    shapes = page.figures["pictures"]["response-0"]["views"]["Hz dB"]["layout"]["shapes"]
    assert [shape["y0"] for shape in shapes] == [0.3]


def test_nothing_usable_leaves_a_page_that_says_so() -> None:
    nothing = responses(used=np.zeros((2, 2, OMEGA.size), dtype=bool))
    shown = Page(render_responses(dataclasses.replace(nothing, loops={}), title="t"))
    assert "None of the 4 responses is usable." in shown.words
    assert not any(row.usable for row in pair_rows(nothing))
    assert not [key for key in shown.attributes("data-picture") if key.startswith(("response", "windows", "loop"))]
    assert "None" not in shown.words.replace("None of the", "")


def test_hostile_text_makes_no_element(page: Page, hostile: Page) -> None:
    assert len(hostile.scripts) == len(page.scripts) == 3
    assert HOSTILE in hostile.words
    assert not any(name.startswith("on") for _, attributes in hostile.elements for name in attributes)


def test_nothing_is_asked_from_the_network_and_links_have_targets(hostile: Page) -> None:
    assert not hostile.attributes("src")
    identifiers = hostile.attributes("id")
    assert len(set(identifiers)) == len(identifiers)
    assert {f"#{name}" for name in identifiers} >= set(hostile.attributes("href"))
    assert not {"link", "img", "iframe", "object", "form", "base"} & {tag for tag, _ in hostile.elements}


def test_views_bring_numbers_only_where_no_conversion_gives_them(page: Page) -> None:
    pictures = page.figures["pictures"]
    assert all("data" not in view for view in pictures["response-0"]["views"].values())
    assert set(pictures["windows-0"]["views"]) == {"rad/s", "Hz"}
    assert {len(view["data"]) for view in pictures["loop-roll"]["views"].values()} == {
        len(pictures["loop-roll"]["views"]["rad/s dB"]["data"])
    }


def test_the_file_stays_small() -> None:
    """The library takes 1.2 MB; three pairs, a loop and a record must not double that."""
    assert len(render_responses(responses(), title="t").encode()) < 2_000_000


def test_of_many_responses_those_on_axis_are_in_sight() -> None:
    outputs, inputs = ("q", "az", "p", "r"), ("pitch_command", "thrust_command", "roll_command", "yaw_command")
    pairs = by_axis([(output, input) for output in outputs for input in inputs])
    assert pairs[: leading_pairs(pairs)] == list(zip(outputs, inputs, strict=True))
    motors = [(output, f"motor_{number}") for output in outputs for number in range(4)]
    assert leading_pairs(by_axis(motors)) == len(motors)
