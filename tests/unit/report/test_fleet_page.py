"""The page of a fleet: what stands in its sentences and in its table of what is normal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from tests.fleet_logs import table_of

from rotorid.documents.fleet import fleet_document
from rotorid.fleets import analyze
from rotorid.fleets.table import Failed
from rotorid.report.fleet import render_fleet


def page(failed: Sequence[Failed] = ()) -> str:
    """Four vehicles of six flights, of 500 ± 2 by chance and ± 10 with what all have alike."""
    values = 500.0 + np.random.default_rng(1).standard_normal((4, 6))
    analysis = analyze(table_of(values.tolist(), 10.0, std_random=2.0))
    counts = {"logs": 26, "done": 24, "resumed": 0, "duplicates": 0, "rows": 24, "vehicles": 4}
    return render_fleet(analysis, fleet_document(analysis, failed=failed, counts=counts, settings={}))


def unread(place: int, *, flight: int = 0, model: str = "") -> Failed:
    return Failed(
        log="LOG00001.BFL",
        log_sha256=f"{place}",
        vehicle="",
        flight=flight,
        model=model,
        kind="unreadable",
        reason="It is no log.",
    )


def test_logs_of_one_name_in_several_folders_are_several() -> None:
    failed = [unread(1), unread(2), unread(3, flight=1, model="rate.roll")]
    assert "; 2 logs could not be used." in page(failed)
    assert "could not be used" not in page()


def test_a_mean_stands_beside_the_error_that_all_flights_share() -> None:
    row = page().partition('id="of-population"')[2].partition("<tbody>")[2].partition("</tr>")[0]
    cells = [cell.partition("</td>")[0].rpartition(">")[2] for cell in row.split("<td")[1:]]
    mean, shared = cells[3], float(cells[4])
    assert mean.startswith(("499", "500"))
    assert abs(shared - np.sqrt(10.0**2 - 2.0**2)) < 0.1
