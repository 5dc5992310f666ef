"""Flights cut into logs that each hold some channels: joined, they give the model of all of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.pipeline.summary import ParameterEstimate

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


def apart_and_both(
    model: str, unpacked: Callable[[str], Path]
) -> tuple[list[FlightRecord], Mapping[str, ParameterEstimate]]:
    """Logs without the command of the other axis, and what the whole ones tell."""
    records = {name: rotorid.read(unpacked(f"s500/{name}.csv")) for name in ONE_AXIS[model]}
    both = rotorid.identify(list(records.values()), model).parameters
    return [only(records[name], held) for name, held in ONE_AXIS[model].items()], both


# Found: roll and yaw differ by up to 2.9 of the larger deviation (L_roll 156.4 ± 1.1 for 153.4 ± 1.0, L_r dropped for
# -21.6), pitch and thrust are refused with an average cost of 1082. What the missing command did is in the responses,
# coherent with the instrument, so that no coherence tells, and no other channel of such a log says what it was.
@pytest.mark.slow
@pytest.mark.xfail(
    strict=True,
    raises=(AssertionError, InsufficientDataError),
    reason="a command that feedback moved and no log holds cannot be accounted for",
)
@pytest.mark.parametrize("model", list(ONE_AXIS))
def test_logs_without_the_other_command_give_the_model_of_both(model: str, unpacked: Callable[[str], Path]) -> None:
    apart, both = apart_and_both(model, unpacked)
    joined = rotorid.identify(apart, model).parameters
    for name, one in both.items():
        if one.std:
            assert abs(joined[name].value - one.value) < max(one.std, joined[name].std or 0.0), name


@pytest.mark.slow
def test_a_log_without_the_other_command_is_said_to_hold_its_share(unpacked: Callable[[str], Path]) -> None:
    """Off by at most four deviations, coherent all the same, and named."""
    apart, both = apart_and_both("hover.lateral", unpacked)
    joined = rotorid.identify(apart, "hover.lateral")
    assert [f.where for f in joined.findings if f.kind == "joined_records"] == ["roll_sweeps.csv", "yaw_sweeps.csv"]
    response = joined.data.response
    rolling = response.coherence[response.outputs.index("p"), response.inputs.index("roll_command")]
    middle = (response.omega_rad_s > 3.0) & (response.omega_rad_s < 20.0)
    assert np.median(rolling[middle]) > 0.9
    for name in ("L_roll", "Y_v", "Y_p", "Y_roll", "tau_roll"):
        one = joined.parameters[name]
        assert one.std is not None
        assert abs(one.value - both[name].value) < 4.0 * one.std, name


@pytest.mark.slow
def test_logs_of_pitch_and_thrust_without_the_other_command_are_refused(unpacked: Callable[[str], Path]) -> None:
    records = {name: rotorid.read(unpacked(f"s500/{name}.csv")) for name in ONE_AXIS["hover.longitudinal"]}
    apart = [only(records[name], held) for name, held in ONE_AXIS["hover.longitudinal"].items()]
    with pytest.raises(InsufficientDataError, match="does not describe these flights"):
        rotorid.identify(apart, "hover.longitudinal")
