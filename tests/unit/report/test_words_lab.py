"""The lab uses the words of reports."""

from __future__ import annotations

import re
from importlib.resources import files
from typing import get_args

from rotorid.report.words import maneuver_verdict
from rotorid.verification.verification import Verdict


def test_verdicts_on_unseen_maneuvers_have_the_words_of_reports() -> None:
    script = (files("rotorid.lab") / "static" / "results.js").read_text(encoding="utf-8")
    (table,) = re.findall(r"^const PREDICTIONS = \{ (.*) \};$", script, re.MULTILINE)
    assert dict(re.findall(r'(\w+): "([^"]*)"', table)) == {
        one: maneuver_verdict(one).words for one in get_args(Verdict)
    }
