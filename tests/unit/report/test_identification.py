"""The page is complete, self-contained, and shows hostile text as text."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import json
import math
from typing import Any

import pytest
from tests.unit.report.page_parser import Page
from tests.unit.report.sample import HOSTILE, document, doublet, identification, shown_with

from rotorid.documents.base import FindingDocument
from rotorid.errors import UsageError
from rotorid.report.frame import json_for_script
from rotorid.report.identification import render_sections, section
from rotorid.report.parts import Shown
from rotorid.results.summary import Checks, ParameterEstimate
from rotorid.verification.verification import Scores


@pytest.fixture(scope="module")
def page() -> Page:
    hostile = shown_with(identification(record=HOSTILE), verifications=(doublet(record=HOSTILE),))
    return Page(render_sections([identification(), hostile], title=HOSTILE, truth={"L_roll": 437.0}))


def changed(**updates: Any) -> Shown:
    return shown_with(identification(), document=document().model_copy(update=updates))


def test_hostile_text_makes_no_element(page: Page) -> None:
    assert len(page.scripts) == 3
    assert HOSTILE in "".join(page.text)
    assert not any(name.startswith("on") for _, attributes in page.elements for name in attributes)


def test_nothing_is_asked_from_the_network(page: Page) -> None:
    assert not page.attributes("src")
    assert all(target.startswith("#") for target in page.attributes("href"))
    assert not {"link", "img", "iframe", "object", "form", "base"} & {tag for tag, _ in page.elements}


def test_links_and_pictures_have_their_targets(page: Page) -> None:
    identifiers = page.attributes("id")
    assert len(set(identifiers)) == len(identifiers)
    assert {target.removeprefix("#") for target in page.attributes("href")} <= set(identifiers)
    assert sorted(page.attributes("data-picture")) == sorted(page.figures["pictures"])


def test_policy_allows_exactly_the_embedded_scripts(page: Page) -> None:
    (policy,) = [value for value in page.attributes("content") if "default-src" in value]
    for script in page.scripts[1:]:
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in policy
    assert "default-src 'none'" in policy
    assert "unsafe-inline" not in policy.split("script-src")[1].split(";")[0]


def test_answer_comes_first_and_truth_beside_it(page: Page) -> None:
    text = " ".join("".join(page.text).split())
    assert "Roll: 437 ± 3 rad/s² per unit command, motor lag 27.9 ± 0.6 ms, delay 2.43 ± 0.11 ms." in text
    assert text.index("437 ± 3") < text.index("Cramér–Rao") < text.index("Found by") < text.index("sha256")
    assert "Truth" in text


@pytest.mark.parametrize(("truth", "said"), [(437.0, False), (500.0, True)])
def test_why_a_truth_may_lie_far_off_is_said_where_one_does(truth: float, said: bool) -> None:
    text = "".join(Page(render_sections([identification()], title="t", truth={"L_roll": truth})).text)
    assert ("leaves out the coupling of the axes" in text) == said


def test_it_is_said_what_an_error_covers() -> None:
    text = " ".join("".join(Page(render_sections([identification()], title="t")).text).split())
    assert "± is one standard deviation of random and model error together" in text
    assert "errors of the model structure that the residuals show" in text


def test_guideline_of_coherence_is_the_one_in_force() -> None:
    shown = Page(render_sections([shown_with(identification(), least_coherence=0.4)], title="t"))
    assert "coherence is below 0.4 (dotted line)" in " ".join("".join(shown.text).split())
    levels = [
        shape["y0"] for shape in shown.figures["pictures"]["s1-response-0"]["views"]["rad/s dB"]["layout"]["shapes"]
    ]
    assert levels == [0.4]


def test_contents_show_the_worse_of_predictions_and_unseen_sweeps() -> None:
    missed = changed(verification=Checks(frequency={"p/roll_command": 4313.0}))
    unflown = shown_with(changed(verification=Checks()), verifications=())
    shown = [section(one, anchor="s1", truth={}).unseen for one in (identification(), missed, unflown)]
    assert [verdict and (verdict.level, verdict.words) for verdict in shown] == [
        ("good", "good"),
        ("poor", "cost 4310"),
        None,
    ]


def test_maneuvers_are_those_of_the_flight_and_not_those_of_data_cut_wide_around_them() -> None:
    one = identification()
    (first, *_) = one.data.segments
    wide = dataclasses.replace(first, maneuver=dataclasses.replace(first.maneuver, start_s=9.0, stop_s=110.0))
    shown = Page(render_sections([shown_with(one, segments=(wide,))], title="t"))
    shapes = shown.figures["pictures"]["s1-timeline-0"]["layout"]["shapes"]
    assert {(shape["x0"], shape["x1"]) for shape in shapes} == {(12.0, 52.0), (62.0, 102.0)}
    assert [row[2] for row in shown.rows("Excitation")] == ["12.00 to 52.00 s", "62.00 to 102.00 s"]


def test_no_truth_no_column() -> None:
    assert "Truth" not in "".join(Page(render_sections([identification()], title="t")).text)


@pytest.mark.parametrize("text", ["</script>", "<!--<script>", "\u2028", "a & b", "\x00"])
def test_json_cannot_end_its_script(text: str) -> None:
    written = str(json_for_script({text: text}))
    assert not set("<>&\u2028") & set(written)
    assert json.loads(written) == {text: text}


def test_missing_numbers_are_dashes() -> None:
    hollow = changed(
        cost=None,
        matrices=None,
        poles=[],
        findings=[],
        identifiability=[],
        verification=Checks(),
        parameters={"L_roll": ParameterEstimate(value=437.0, unit="rad/s^2", status="free")},
    )
    bare = shown_with(hollow, direct=None, segments=(), verifications=())
    text = "".join(Page(render_sections([bare], title="t")).text)
    assert "Not checked on unseen flight yet." in text
    assert "No warnings or notes." in text
    assert "None" not in text


def test_numbers_that_are_not_numbers_do_not_break_the_page() -> None:
    nan = math.nan
    broken = changed(
        parameters={
            "L_roll": ParameterEstimate(
                value=nan,
                unit="rad/s^2",
                std=nan,
                cramer_rao_percent=math.inf,
                insensitivity_percent=nan,
                status="free",
            )
        },
        findings=[FindingDocument(kind="odd", severity="info", where="", message="", numbers={"x": nan})],
    )
    scores = {"p": Scores(nrmse_fit_percent=-math.inf, tic=nan, rms=nan, bias=nan, reference_shift=nan)}
    unverified = dataclasses.replace(doublet(), scores=scores)
    shown = Page(render_sections([shown_with(broken, verifications=(unverified,))], title="t", truth={"L_roll": nan}))
    text = "".join(shown.text)
    assert "nan" not in text.split()
    assert "inf" not in text.split()


def test_nothing_to_report_is_refused() -> None:
    with pytest.raises(UsageError, match="at least one"):
        render_sections([], title="t")


def test_file_stays_small() -> None:
    """The library takes 1.2 MB; the pictures of two sweeps and a doublet must not double that."""
    assert len(render_sections([identification()], title="t").encode()) < 2_000_000
