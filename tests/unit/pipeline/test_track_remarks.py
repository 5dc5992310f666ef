"""What is said beside a followed gain: advice that the command can take."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from rotorid.data.findings import warn
from rotorid.pipeline.tracking import _told


@pytest.mark.parametrize(
    ("message", "told"),
    [
        ("Half of the points count. All of them: --band 0.1:2.5.", "Half of the points count."),
        (
            "Lag and delay are alike (--fix T_motor=VALUE). Trust their sum.",
            "Lag and delay are alike. Trust their sum.",
        ),
        ("Nothing was held out; give another log with --verify.", "Nothing was held out."),
        ("A gap of 0.2 s in p.", "A gap of 0.2 s in p."),
        ("Name it with --segment.", None),
    ],
)
def test_no_option_of_identify_is_advised(message: str, told: str | None) -> None:
    model = SimpleNamespace(findings=[warn("gap", "p", message)])
    found = [finding.message for finding in _told(model)]  # type: ignore[arg-type]
    assert found == ([told] if told else [])
