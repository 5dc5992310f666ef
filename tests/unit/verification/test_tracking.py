"""A gain that is followed: steps are found with their size, and what cannot tell says so."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from tests.twins import track_flights as twin

from rotorid import identify, track
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.simulation.wind import Wind
from rotorid.verification.tracking import RATE_HZ, track_gain

AIR = Wind(north_m_s=2.1, east_m_s=2.1, turbulence_m_s=0.5)
PREDICT = partial(twin.prediction, gain=113.1, damping=-1.0, lag_s=0.048, delay_s=0.0054)


@pytest.fixture(scope="module")
def calm() -> dict[str, np.ndarray]:
    return twin.columns(twin.fly(120.0, level=0.5, wind=AIR, seed=3))


@pytest.fixture(scope="module")
def loaded(calm: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    after = twin.columns(twin.fly(60.0, level=0.5, wind=AIR, seed=4, changes=twin.payload()))
    return twin.joined(calm, after)


def test_a_payload_is_a_step_of_its_size(loaded: dict[str, np.ndarray]) -> None:
    found = track_gain(loaded["roll_command"], loaded["p"], loaded["roll_stick"], predict=PREDICT)
    first = found.steps[0]
    assert 120.0 < first.at_s < 132.0
    assert 118.0 <= first.since_s <= first.at_s
    assert first.ratio == pytest.approx(1 / 1.15, abs=3.0 * first.std)
    assert found.ratio[-1] == pytest.approx(1 / 1.15, abs=2.0 * float(found.std[-1]))
    assert found.reference_gain == pytest.approx(1.0, abs=0.05)


def test_without_a_change_there_is_no_step(calm: dict[str, np.ndarray]) -> None:
    found = track_gain(calm["roll_command"], calm["p"], calm["roll_stick"], predict=PREDICT)
    assert not found.steps
    assert set(found.cannot_tell) == {"reference", ""}
    told = np.array([not why for why in found.cannot_tell])
    assert (np.abs(found.ratio - 1.0)[told] < 2.5 * found.std[told]).all()


def test_a_stick_at_rest_cannot_tell(calm: dict[str, np.ndarray]) -> None:
    rest = twin.columns(twin.fly(60.0, level=0.04, wind=AIR, seed=8, changes=twin.payload()))
    data = twin.joined(calm, rest)
    found = track_gain(data["roll_command"], data["p"], data["roll_stick"], predict=PREDICT)
    assert not found.steps
    assert found.cannot_tell[-60:] == ("stick",) * 60


def test_noise_and_seeds_do_not_matter_to_repeated_calls(calm: dict[str, np.ndarray]) -> None:
    one, other = (track_gain(calm["roll_command"], calm["p"], calm["roll_stick"], predict=PREDICT) for _ in range(2))
    assert (one.ratio == other.ratio).all()


@pytest.mark.parametrize("seconds", [20, 62])
def test_too_short_a_flight_is_refused(calm: dict[str, np.ndarray], seconds: int) -> None:
    part = {name: values[: int(seconds * RATE_HZ)] for name, values in calm.items()}
    with pytest.raises(InsufficientDataError, match="of flight is too short"):
        track_gain(part["p"], part["p"], part["roll_stick"], predict=PREDICT)


def test_a_reference_without_stick_is_refused(calm: dict[str, np.ndarray]) -> None:
    with pytest.raises(InsufficientDataError, match="the stick moved only"):
        track_gain(calm["p"], calm["p"], 0.1 * calm["roll_stick"], predict=PREDICT)


def test_a_record_is_followed_with_a_model_of_its_beginning(loaded: dict[str, np.ndarray]) -> None:
    found = track(twin.record_of(loaded), "rate.roll")
    assert found.instrument == "roll_stick"
    assert [step.at_s > 120.0 for step in found.tracking.steps] == [True] * len(found.tracking.steps)
    assert found.tracking.steps
    assert found.tracking.steps[0].ratio == pytest.approx(1 / 1.15, abs=0.06)


def test_a_weak_propeller_moves_the_trim_and_hardly_the_gain(calm: dict[str, np.ndarray]) -> None:
    still = Wind(north_m_s=0.7, east_m_s=0.7, turbulence_m_s=0.2)
    before = twin.columns(twin.fly(120.0, level=0.5, wind=still, seed=5))
    after = twin.columns(twin.fly(60.0, level=0.5, wind=still, seed=6, flying=twin.with_weak_rotor(0.08)))
    livelier = twin.record_of(calm)
    model = identify(livelier, "rate.roll", band_rad_s=(2.0, 38.0))
    found = track(twin.record_of(twin.joined(before, after)), model)
    assert found.given
    assert not found.tracking.steps
    (trim,) = found.trims
    assert trim.channel == "roll_command"
    assert abs(trim.after - trim.before) > 0.01
    assert 120.0 < trim.at_s < 145.0


def test_unknown_models_and_steps_are_refused(calm: dict[str, np.ndarray]) -> None:
    record = twin.record_of(calm)
    with pytest.raises(ModelError, match=r"hover\.full"):
        track(record, "hover.full")
    with pytest.raises(UsageError, match="step_share=3 is out of range"):
        track(record, "rate.roll", step_share=3.0)
