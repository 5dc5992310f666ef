"""Yaw of vehicles with heavy rotors, and with light ones: rate models know the reaction to their spin-up."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.twins.coverage import flown_truth
from tests.twins.motor_twins import twin
from tests.twins.twin_flights import BAND, HUMMINGBIRD_YAW, flown, plan

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.models.library import library_model
from rotorid.vehicles import hummingbird


def swept(share: float) -> FlightRecord:
    """The Hummingbird's yaw in gusts, with this share of its reaction to the spin-up of its rotors."""
    system = library_model("axis.yaw").matrices({**hummingbird.YAW, "N_spin": share * hummingbird.YAW["N_spin"]})
    loop = replace(HUMMINGBIRD_YAW, system=system)
    rng = np.random.default_rng(1)
    return flown(loop, plan({"yaw": 10.0}, rng, (BAND[0], 70.0)), rng)


@pytest.mark.parametrize("share", [0.2, 0.5, 1.0])
def test_spin_up_comes_back(share: float) -> None:
    """Without it N_yaw takes the place of N_spin, and comes out several times too large."""
    truth = {**hummingbird.YAW, "N_spin": share * hummingbird.YAW["N_spin"]}
    found = rotorid.identify(swept(share), "rate.yaw")
    for name in ("N_yaw", "N_spin", "T_motor", "tau_yaw"):
        one = found[name]
        assert one.std is not None
        assert abs(one.value - truth[name]) < 2.5 * one.std, name
        assert one.std < 0.15 * one.value, name


@pytest.mark.parametrize("share", [0.0, -0.1])
def test_what_is_no_lead_gets_none(share: float) -> None:
    """Rotors turn a vehicle to one side by drag and by spin-up: what leads to the other side is something else."""
    found = rotorid.identify(swept(share), "rate.yaw")
    assert found["N_spin"].status == "dropped"
    assert [one for one in found.findings if (one.kind, one.where) == ("dropped_parameter", "N_spin")]


def test_a_lead_that_no_rotor_has_is_none(tmp_path: Path) -> None:
    """What turns the S500 beside its motors looks like rotors that react for seven seconds."""
    record = twin("s500", "calm", 1, tmp_path).record
    with pytest.raises(InsufficientDataError, match="no rotor reacts"):
        rotorid.identify(record, "axis.yaw")
    found = rotorid.identify(record, "rate.yaw")
    assert found["N_spin"].status == "dropped"
    assert found["N_yaw"].std is not None
    assert abs(found["N_yaw"].value - flown_truth("s500", record)["N_yaw"]) < 2.0 * found["N_yaw"].std
