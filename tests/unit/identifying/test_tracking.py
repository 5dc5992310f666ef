"""What is said beside a followed gain: advice that the command can take, and trims that moved."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from tests.unit.exports.models import model

from rotorid.data.findings import warn
from rotorid.data.record import Channel, FlightRecord, Source, Topic
from rotorid.errors import RotoridError, UsageError
from rotorid.identifying.tracking import _axis, _reference_remarks, _trims
from rotorid.models.library import library_model


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
    reference = SimpleNamespace(findings=[warn("gap", "p", message)])
    found = [finding.message for finding in _reference_remarks(reference)]  # type: ignore[arg-type]
    assert found == ([told] if told else [])


def trimmed(moves_at_s: float, gap_s: tuple[float, float]) -> FlightRecord:
    """A roll command about a trim of 0.1, which moves by 0.05, in a log with a gap."""
    time_s = np.arange(0.0, 200.0, 0.02)
    values = 0.1 + 0.05 * (time_s > moves_at_s) + 0.01 * np.random.default_rng(1).standard_normal(time_s.size)
    kept = (time_s < gap_s[0]) | (time_s > gap_s[1])
    channels = (Channel(name="roll_command", unit="1"),)
    topic = Topic(name="command", time_s=time_s[kept], values=values[None, kept], channels=channels)
    return FlightRecord(source=Source(name="flight.csv", format="", sha256=""), topics=(topic,))


@pytest.mark.parametrize("gap_s", [(80.0, 80.0), (90.0, 121.9), (20.0, 43.0)], ids=["none", "a gap", "early"])
def test_a_gap_moves_no_trim(gap_s: tuple[float, float]) -> None:
    assert not list(_trims(trimmed(1000.0, gap_s), 0.0, 200.0, 60.0))
    (step,) = _trims(trimmed(140.0, gap_s), 0.0, 200.0, 60.0)
    assert step.before == pytest.approx(0.1, abs=0.002)
    assert step.after == pytest.approx(0.15, abs=0.005)
    assert 140.0 < step.at_s < 170.0


def test_a_result_with_several_rates_is_tracked_in_the_first_or_the_named() -> None:
    whole = model(library_model("hover.lateral"), responses=False)
    assert whole.rate_axes == ("roll", "yaw")
    axis, (said,) = _axis(whole, None)
    assert axis == "roll"
    assert said.message == "hover.lateral was tracked in roll. For another axis, add --axis yaw."
    assert _axis(whole, "yaw") == ("yaw", [])
    assert _axis("rate.pitch", None) == ("pitch", [])
    with pytest.raises(UsageError, match="has no rate of pitch; expected --axis roll or yaw"):
        _axis(whole, "pitch")
    with pytest.raises(UsageError, match="has no rate by its command"):
        _axis(model(whole.structure.select(outputs=["v"]), responses=False), None)
    with pytest.raises(RotoridError, match="no model to track"):
        _axis("hover.lateral", None)
