"""The page of a fleet of ten thousand logs: it draws, filters and sorts, and holds no more lines than can be seen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from tests.browser.chromium import asked, elements
from tests.fleet_logs import table_of

from rotorid.documents.fleet import fleet_document
from rotorid.fleets import Row, analyze
from rotorid.fleets.table import Counts
from rotorid.report.fleet import render_fleet

READY = 'document.documentElement.dataset.fleet === "ready"'
PROBE = """
() => {
  const lines = () => Array.from(document.querySelectorAll("#fleet-table tbody tr"))
    .filter((row) => row.cells.length > 1);
  const shown = document.getElementById("fleet-shown");
  const told = { all: shown.textContent, lines: lines().length };
  const begun = performance.now();
  const filter = document.getElementById("fleet-filter");
  filter.value = "v07 roll";
  filter.dispatchEvent(new Event("input"));
  told.filtered = shown.textContent;
  document.querySelectorAll("#fleet-table th button")[6].click();
  told.sort = document.querySelectorAll("#fleet-table th")[6].getAttribute("aria-sort");
  told.first = Number.parseFloat(lines()[0].cells[6].textContent);
  told.second = Number.parseFloat(lines()[1].cells[6].textContent);
  told.points = document.getElementById("fleet-history").data[0].x.length;
  told.chosen = document.getElementById("fleet-vehicle").selectedOptions[0].textContent;
  return told;
}
"""


def page_of(rows: list[Row]) -> str:
    analysis = analyze(rows)
    counts = Counts(
        logs=len(rows), answered=len(rows), refused=0, unreadable=0, duplicates=0, resumed=0, rows=len(rows)
    )
    return render_fleet(analysis, fleet_document(analysis, failed=(), counts=counts, settings={}))


def test_ten_thousand_logs_stay_smooth(alone: Any, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    values = 100.0 + rng.normal(0, 3.0, (100, 1)) + rng.normal(0, 1.0, (100, 100))
    values[7, 60:] *= 0.9
    html = page_of(table_of(values))
    assert len(html) < 8e6
    told, said = asked(alone, html, tmp_path, PROBE, ready=READY)
    assert not said
    assert told["all"] == "10000 of 10000 lines"
    assert told["lines"] < 100
    assert told["filtered"] == "100 of 10000 lines"
    assert (told["sort"], told["first"] <= told["second"]) == ("ascending", True)
    assert (told["chosen"], told["points"]) == ("v07 (changed or unlike others)", 100)


def test_names_of_logs_can_do_nothing(alone: Any, tmp_path: Path) -> None:
    evil = "</script><script>document.title='owned'</script><img src=x onerror=alert(1)>"
    rows = table_of([[1.0, 2.0, 3.0, 4.0, 5.0]], findings=evil)
    rows = [row.__class__(**{**row.__dict__, "log": f"{evil}{k}.ulg", "vehicle": evil}) for k, row in enumerate(rows)]
    page, said = elements(alone, page_of(rows), tmp_path, ready=READY)
    assert not said
    assert "<title>owned" not in page
    assert "<img src" not in page
