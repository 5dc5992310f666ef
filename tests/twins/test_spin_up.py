"""A rate model of yaw whose rotors are heavy: it gets the reaction to their spin-up, and says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.twins.twin_flights import BAND, HUMMINGBIRD_YAW, flown, plan

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.models.library import library_model
from rotorid.vehicles import hummingbird


def swept(spin_up: float) -> FlightRecord:
    """The Hummingbird's yaw in gusts, with a reaction of its own to the spin-up of its rotors."""
    system = library_model("axis.yaw").matrices({**hummingbird.YAW, "N_spin": spin_up})
    loop = replace(HUMMINGBIRD_YAW, system=system)
    rng = np.random.default_rng(1)
    return flown(loop, plan({"yaw": 10.0}, rng, (BAND[0], 70.0)), rng)


def test_a_rate_model_gets_the_spin_up_that_it_lacks() -> None:
    found = rotorid.identify(swept(hummingbird.YAW["N_spin"]), "rate.yaw")
    (said,) = (one for one in found.findings if one.kind == "spin_up_added")
    assert said.numbers["cost_without"] > 100.0 > 50.0 >= said.numbers["average_cost"]
    assert found.structure.name == "rate.yaw"
    for name in ("N_yaw", "N_spin", "T_motor", "tau_yaw"):
        one = found[name]
        assert one.lower is not None
        assert one.upper is not None
        assert one.lower < hummingbird.YAW[name] < one.upper
        assert one.std is not None
        assert one.std < 0.1 * one.value


def test_a_response_that_it_follows_gets_none() -> None:
    found = rotorid.identify(swept(0.0), "rate.yaw")
    assert "N_spin" not in found.parameters
    assert not [one for one in found.findings if one.kind == "spin_up_added"]


def test_what_leads_to_the_other_side_is_no_spin_up() -> None:
    with pytest.raises(InsufficientDataError) as refused:
        rotorid.identify(swept(-0.5 * hummingbird.YAW["N_spin"]), "rate.yaw")
    assert "poor_fit" in {one.kind for one in refused.value.findings}
