"""An axis that fails while gains are searched costs no other axis its gains, and is named with the reason."""

from __future__ import annotations

from typing import Any

import pytest
from tests.unit.proposing.test_shared_filters import LOG, known

from rotorid.errors import InsufficientDataError
from rotorid.proposing import proposal
from rotorid.typing import Axis


@pytest.fixture(autouse=True)
def _lenient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROTORID_STRICT", raising=False)
    monkeypatch.setattr(proposal, "known_axis", lambda axis, *_, **__: known(axis, {}))


def failing(monkeypatch: pytest.MonkeyPatch, name: str, *axes: Axis) -> None:
    whole = getattr(proposal, name)

    def made(axis: Axis, *given: Any, **named: Any) -> Any:
        if axis in axes:
            raise KeyError(axis)
        return whole(axis, *given, **named)

    monkeypatch.setattr(proposal, name, made)


def test_an_axis_whose_search_fails_leaves_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    failing(monkeypatch, "axis_tuning", "roll")
    found = proposal.tune(records=LOG, axes=("roll", "pitch"))
    assert list(found.axes) == ["pitch"]
    (said,) = [finding for finding in found.findings if finding.kind == "not_tuned"]
    assert said.where == "roll"
    assert "KeyError" in said.message


def test_flights_to_the_goal_that_fail_leave_the_gains(monkeypatch: pytest.MonkeyPatch) -> None:
    failing(monkeypatch, "flights_to_goal", "pitch")
    found = proposal.tune(records=LOG, axes=("pitch",))
    assert found.axes["pitch"].path == ()
    assert [finding.where for finding in found.findings if finding.kind == "internal_error"] == ["pitch"]


def test_where_every_axis_fails_there_is_no_proposal(monkeypatch: pytest.MonkeyPatch) -> None:
    failing(monkeypatch, "axis_tuning", "roll", "pitch")
    with pytest.raises(InsufficientDataError) as refused:
        proposal.tune(records=LOG, axes=("roll", "pitch"))
    assert {finding.where for finding in refused.value.findings if finding.kind == "not_tuned"} == {"roll", "pitch"}
