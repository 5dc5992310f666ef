"""``--method accelerations`` of ``physical.motors``: from a log to a result, with its search, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from tests.unit.identifying.motor_logs import ARM_M, flight

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import UsageError
from rotorid.identifying.families import require_choices
from rotorid.identifying.identification import identify, identify_motors
from rotorid.io.registry import read
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.motors import MotorSettings
from rotorid.vehicles.motor_flight import TRUTH

CHOICES = MotorSettings(known={"m": TRUTH["m"]}, layout="quad.x", arm_m=ARM_M, method="accelerations")


@pytest.mark.slow
def test_values_come_back_with_what_the_search_reached_alone(tmp_path: Path) -> None:
    found = identify_motors([read(flight(tmp_path / "flight.csv"))], replace(CHOICES, search="genetic:6x5", runs=3))
    assert found.fit.method == "accelerations"
    for name in ("I_xx", "I_yy", "kappa_per_I_zz"):
        one = found[name]
        assert one.std is not None
        assert abs(one.value - TRUTH[name]) < 3.0 * one.std, name
        assert one.std < 0.2 * TRUTH[name], name
    search = found.fit.search
    assert search is not None
    assert search.objective == "accelerations"
    assert [count for count, _ in search.trace] == [6, 12, 18, 24, 30]
    assert search.alone is not None
    assert search.alone.cost == pytest.approx(search.trace[-1][1])
    assert search.alone.cost >= search.minima[0].cost
    assert search.runs is not None
    table = search.runs.alone
    assert len(table.costs) == 3
    assert all(one.min <= one.mean <= one.max for one in (table.cost, *table.parameters.values()))
    assert search.runs.polished.cost.std < search.runs.alone.cost.std


@pytest.mark.parametrize(
    ("options", "came"),
    [
        ({"runs": 100}, "--runs needs a search"),
        ({"runs": 1, "search": "genetic:15x50"}, "--runs 1 is too few"),
        ({"method": "accelerations", "bootstrap": 20}, "--method accelerations has no bootstrap"),
        ({"method": "accelerations", "outputs": ("q",)}, "--outputs q"),
        ({"outputs": ("phi",)}, "--outputs phi"),
    ],
)
def test_what_does_not_go_together_is_refused(options: dict[str, object], came: str) -> None:
    with pytest.raises(UsageError, match=came):
        require_choices("physical.motors", IdentifySettings(**options))  # type: ignore[arg-type]


NOTHING = FlightRecord(source=Source(name="nothing.csv", format="CSV", sha256=""), topics=())


def test_the_method_is_of_motors_alone() -> None:
    with pytest.raises(UsageError, match="--method accelerations does not apply to"):
        identify(NOTHING, "rate.roll", method="accelerations")
