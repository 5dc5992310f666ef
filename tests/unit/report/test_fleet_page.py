"""The page of a fleet: what stands in its sentences and in its table of what is normal."""

from __future__ import annotations

import numpy as np
from tests.fleet_logs import table_of

from rotorid.documents.fleet import fleet_document
from rotorid.fleets import analyze
from rotorid.fleets.table import Counts
from rotorid.report.fleet import render_fleet


def page() -> str:
    """Four vehicles of six flights, of 500 ± 2 by chance and ± 10 with what all have alike."""
    values = 500.0 + np.random.default_rng(1).standard_normal((4, 6))
    analysis = analyze(table_of(values.tolist(), 10.0, std_random=2.0))
    counts = Counts(logs=26, answered=24, refused=0, unreadable=2, duplicates=0, resumed=0, rows=24)
    return render_fleet(analysis, fleet_document(analysis, failed=(), counts=counts, settings={}))


def test_logs_that_could_not_be_read_are_those_of_the_counts() -> None:
    assert "24 of 26 logs gave 24 numbers of 4 vehicles; 2 could not be read." in page()


def test_a_mean_stands_beside_the_error_that_all_flights_share() -> None:
    row = page().partition('id="of-population"')[2].partition("<tbody>")[2].partition("</tr>")[0]
    cells = [cell.partition("</td>")[0].rpartition(">")[2] for cell in row.split("<td")[1:]]
    assert cells[0] == "Roll control power L_roll"
    mean, shared = cells[2], float(cells[3])
    assert mean.startswith(("499", "500"))
    assert abs(shared - np.sqrt(10.0**2 - 2.0**2)) < 0.1
