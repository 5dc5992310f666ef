"""Flights of real autopilots with channels left out: no interval becomes narrower where less is known.

Where the measured response stays what it was, the random error stays too, and only what could not be checked may change
the interval: 2 % are allowed, since attitude from another topic shows a lean that differs by as much. Where another
instrument, or another sensor, makes another response, the size of the model error is estimated from other residuals: a
chi-square of some 30 independent points scatters by 13 %, and the random error with it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.identifying import identify
from rotorid.results.model import IdentifiedModel

SAME_RESPONSE, OTHER_RESPONSE = 0.98, 0.87


class Flown(NamedTuple):
    """A log, the model of its sweep, and the channels without which there is none."""

    path: str
    model: str
    needed: tuple[str, ...]


FLIGHTS = (
    Flown("px4_sitl/roll.ulg", "rate.roll", ("roll_command", "p")),
    Flown("px4_sitl/pitch.ulg.xz", "rate.pitch", ("pitch_command", "q")),
    Flown("ardupilot_sitl/x_calm_roll.BIN", "rate.roll", ("roll_command", "p", "roll_excitation")),
)

COMBINED = (
    ("phi", "theta", "psi"),
    ("phi",),
    ("thrust_command",),
    ("phi", "theta", "psi", "thrust_command"),
    ("phi", "theta", "psi", "thrust_command", "ax", "ay", "az"),
)
"""Channels that checks need, together."""


def without_topic(record: FlightRecord, name: str) -> FlightRecord:
    return replace(record, topics=tuple(topic for topic in record.topics if topic.name != name))


def without_channels(record: FlightRecord, names: Collection[str]) -> FlightRecord:
    topics = []
    for topic in record.topics:
        rows = [row for row, channel in enumerate(topic.channels) if channel.name not in names]
        if rows:
            channels = tuple(topic.channels[row] for row in rows)
            topics.append(replace(topic, channels=channels, values=topic.values[rows]))
    return replace(record, topics=tuple(topics))


def narrowed(whole: IdentifiedModel, left: IdentifiedModel) -> dict[str, float]:
    """Parameters whose interval became narrower than is allowed, with the ratio of standard deviations."""
    before, after = whole.data.response, left.data.response
    assert before is not None
    assert after is not None
    same = before.values.shape == after.values.shape and np.allclose(before.values, after.values, rtol=1e-12)
    least = SAME_RESPONSE if same else OTHER_RESPONSE
    ratios = {
        name: left.parameters[name].std / one.std
        for name, one in whole.parameters.items()
        if one.std and left.parameters[name].std
    }
    return {name: ratio for name, ratio in ratios.items() if ratio < least}


def test_channels_that_are_left_out_together_never_narrow_an_interval(unpacked: Callable[[str], Path]) -> None:
    flown = FLIGHTS[0]
    record = rotorid.read(unpacked(flown.path))
    assert_not_narrowed(flown, record, {", ".join(names): without_channels(record, names) for names in COMBINED})


@pytest.mark.slow
@pytest.mark.parametrize("flown", [pytest.param(flown, id=flown.path) for flown in FLIGHTS])
def test_channels_that_are_left_out_never_narrow_an_interval(flown: Flown, unpacked: Callable[[str], Path]) -> None:
    """Each topic by itself, and the channels of checks together."""
    record = rotorid.read(unpacked(flown.path))
    kept = {topic.name for topic in record.topics if set(flown.needed) & {channel.name for channel in topic.channels}}
    logs = {
        name: without_topic(record, name) for name in dict.fromkeys(t.name for t in record.topics) if name not in kept
    }
    logs |= {", ".join(names): without_channels(record, names) for names in COMBINED}
    assert_not_narrowed(flown, record, logs)


def assert_not_narrowed(flown: Flown, record: FlightRecord, logs: Mapping[str, FlightRecord]) -> None:
    whole = identify([record], flown.model)
    found = {name: narrowed(whole, identify([log], flown.model)) for name, log in logs.items()}
    assert {name: ratios for name, ratios in found.items() if ratios} == {}


def test_what_could_not_be_checked_is_said_and_the_truth_stays_inside(unpacked: Callable[[str], Path]) -> None:
    """The real flight whose log lacks attitude and thrust: 113.1 rad/s² per unit and 48 ms are true."""
    found = identify([rotorid.read(unpacked("real_stacks/px4_sih_offboard_plan.ulg.xz"))], "rate.roll")
    for name, truth in (("L_roll", 113.1), ("L_p", -1.0), ("T_motor", 0.048), ("tau_roll", 0.0053)):
        one = found.parameters[name]
        assert one.lower is not None
        assert one.upper is not None
        assert one.lower < truth < one.upper, name
    gain = found.parameters["L_roll"]
    # The whole log states ± 2.2, with what it lets one look at; this copy must not state less.
    assert gain.std is not None
    assert 1.96 * gain.std > 2.2
    unseen = {finding.where for finding in found.findings if finding.kind == "error_not_checked"}
    assert unseen == {"slope", "lean", "scale"}
