"""Flights cut into logs that each hold some channels: joined, they give the model of all of them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError

COMMANDS = {"hover.lateral": ("roll_command", "yaw_command"), "hover.longitudinal": ("pitch_command", "thrust_command")}
LOGS = {
    "hover.lateral": {
        "roll_sweeps": ("phi_setpoint", "p", "phi", "v", "ay", "r"),
        "yaw_sweeps": ("r_setpoint", "r", "p", "v"),
    },
    "hover.longitudinal": {
        "pitch_sweeps": ("theta_setpoint", "q", "theta", "u", "w", "ax", "az"),
        "thrust_sweeps": ("thrust_excitation", "q", "u", "w", "ax", "az"),
    },
}


def only(record: FlightRecord, names: tuple[str, ...]) -> FlightRecord:
    """A log of some channels."""
    topics = []
    for topic in record.topics:
        rows = [row for row, channel in enumerate(topic.channels) if channel.name in names]
        channels = tuple(topic.channels[row] for row in rows)
        topics.append(replace(topic, channels=channels, values=topic.values[rows]))
    return replace(record, topics=tuple(topics))


# Each log without the command of the other axis, which moved in it by feedback.
ONE_AXIS = {
    "hover.lateral": {
        "roll_sweeps": ("phi_setpoint", "roll_command", "p", "phi", "v", "ay", "r"),
        "yaw_sweeps": ("r_setpoint", "yaw_command", "r", "p", "v", "ay"),
    },
    "hover.longitudinal": {
        "pitch_sweeps": ("theta_setpoint", "pitch_command", "q", "theta", "u", "ax", "w", "az"),
        "thrust_sweeps": ("thrust_excitation", "thrust_command", "w", "az", "u", "q"),
    },
}


@pytest.mark.slow
@pytest.mark.parametrize("model", list(LOGS))
def test_logs_of_one_axis_each_give_the_model_of_both(model: str, unpacked: Callable[[str], Path]) -> None:
    records = {name: rotorid.read(unpacked(f"s500/{name}.csv")) for name in LOGS[model]}
    both = rotorid.identify(list(records.values()), model)
    apart = [only(records[name], (*COMMANDS[model], *held)) for name, held in LOGS[model].items()]
    joined = rotorid.identify(apart, model)
    truth = json.loads(unpacked("s500/truth.json").read_text())[model.partition(".")[2]]
    known = [name for name, one in both.parameters.items() if one.std and joined.parameters[name].std]
    assert len(known) >= 15
    assert [f.where for f in joined.findings if f.kind == "joined_records"] == [next(iter(LOGS[model])) + ".csv"]
    for name in known:
        one, other = both.parameters[name], joined.parameters[name]
        assert one.std is not None
        assert other.std is not None
        # Both share most of the data: the difference is that of what one of them leaves out.
        assert abs(other.value - one.value) < max(one.std, other.std), name
        assert abs(other.value - truth.get(name, 0.0)) < 2.0 * other.std, name


@pytest.mark.slow
@pytest.mark.parametrize("model", list(ONE_AXIS))
def test_logs_that_lack_the_other_command_are_refused(model: str, unpacked: Callable[[str], Path]) -> None:
    """Feedback moved it too, and what it did counts as the effect of the command that is there."""
    records = {name: rotorid.read(unpacked(f"s500/{name}.csv")) for name in ONE_AXIS[model]}
    apart = [only(records[name], held) for name, held in ONE_AXIS[model].items()]
    with pytest.raises(InsufficientDataError, match="does not describe these flights"):
        rotorid.identify(apart, model)
