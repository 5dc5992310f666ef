"""The overview picture is a PNG, and says what is missing when matplotlib is."""

from __future__ import annotations

import dataclasses
import struct
import sys

import pytest
from tests.unit.report.sample import identification

from rotorid.errors import UsageError
from rotorid.plot.paper import overview_png


def size(png: bytes) -> tuple[int, int]:
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    width, height = struct.unpack(">II", png[16:24])
    return width, height


def test_one_column_for_each_identification() -> None:
    one = identification()
    unverified = dataclasses.replace(one, verifications=dataclasses.replace(one.verifications, maneuvers=()))
    narrow, wide = size(overview_png([one], dots_per_inch=40)), size(overview_png([one, unverified], dots_per_inch=40))
    assert wide[0] > narrow[0]
    assert wide[1] == narrow[1]


def test_line_of_coherence_is_the_limit_in_force(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[float] = []
    monkeypatch.setattr("matplotlib.axes.Axes.axhline", lambda self, y, **style: drawn.append(y))
    one = identification()
    strict = dataclasses.replace(one, data=dataclasses.replace(one.data, least_coherence=0.45))
    overview_png([strict], dots_per_inch=40)
    assert drawn == [0.45]


def test_missing_matplotlib_is_said_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(UsageError, match=r"pip install 'rotorid\[figures\]'"):
        overview_png([identification()])


def test_nothing_to_draw_is_refused() -> None:
    with pytest.raises(UsageError, match="at least one"):
        overview_png([])
