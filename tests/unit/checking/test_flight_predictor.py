"""The physics of flight on a log: a vehicle that is known predicts it, and says where it flew beyond what is known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import pytest
from tests.twins.flight_flights import AIR, Case, FlightTwin, craft_of, twin

from rotorid.checking.checks import flight_scores
from rotorid.checking.flight import FlightPredictor, _unjudged, known_flight, torque_bands
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.flight.fit import FlightRange, covered
from rotorid.fitting.flight.motion import motion
from rotorid.models.flight import FLIGHT_PARAMETERS
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.results.model import Verifications
from rotorid.settings import FlySettings, IdentifySettings, VerifySettings
from rotorid.verification.flight import USUAL_OUTSIDE_PERCENT
from rotorid.verification.verification import Verification

ACCELEROMETER_M_S2 = 0.1
"""Noise of the twin's accelerometer on each axis."""


@pytest.fixture(scope="module")
def flown() -> Iterator[FlightTwin]:
    """A flight without flapping, which the simulator and the model need not describe alike."""
    own = AIR["x500"]
    craft_of.cache_clear()
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(AIR, "x500", own._replace(pitching_1_m_s=0.0))  # type: ignore[arg-type]
        yield twin(Case("x500", "climbs", duration_s=15.0, seed=1))
    craft_of.cache_clear()


def predictor(flown: FlightTwin, changed: Mapping[str, float] | None = None) -> FlightPredictor:
    """The true vehicle, or one with other numbers."""
    values = {**flown.truth, **(changed or {})}
    return FlightPredictor(
        parameters=ParameterSet(
            [
                Parameter(name=name, value=value, unit=FLIGHT_PARAMETERS[name].unit, status="fixed")
                for name, value in values.items()
            ]
        ),
        airframe=flown.frame,
        layout=flown.layout,
        kind="speed",
        velocity="measured",
        tested=covered([flown.motors], [motion(flown.motors, values)]),
        bands_hz={"p": (2.0, 8.0), "q": (2.0, 8.0)},
    )


@pytest.fixture(scope="module")
def found(flown: FlightTwin) -> Verifications:
    """What the true vehicle says of the flight."""
    return predictor(flown).predict([flown.record], VerifySettings()).found


@pytest.fixture(scope="module")
def check(found: Verifications) -> Verification:
    (only,) = found.maneuvers
    return only


def test_the_true_vehicle_is_off_by_the_noise_of_the_sensors(
    flown: FlightTwin, found: Verifications, check: Verification
) -> None:
    assert check.flight is not None
    noise_n = flown.frame.mass_kg * ACCELEROMETER_M_S2 * np.sqrt(3.0)
    # Interpolation onto one clock takes some of it.
    assert 0.8 * noise_n < (check.flight.errors.force_rms_n or 0.0) < 1.05 * noise_n
    assert check.flight.skew_s is not None
    assert abs(check.flight.skew_s) < 0.003
    assert check.flight.outside_percent is not None
    assert check.flight.outside_percent < USUAL_OUTSIDE_PERCENT
    assert {"ax", "ay", "az", "p_dot", "q_dot"} == set(check.output_names)
    assert not [finding for finding in found.findings if finding.severity == "warning"]


def test_motors_alone_predict_half_a_second(check: Verification) -> None:
    assert check.flight is not None
    assert check.flight.ahead is not None
    assert check.flight.ahead.horizons_s[-1] == pytest.approx(0.5, abs=0.01)
    # Velocity of a start is known to 5 cm/s and attitude to 3 mrad, its motors to 2 rad/s.
    assert max(check.flight.ahead.ratios.values()) < 0.3
    scores = flight_scores(check.flight)
    assert scores.ahead is not None
    assert len(scores.ahead.errors["position"]) == 5
    assert scores.ahead.errors["rates"][-1].horizon_s == pytest.approx(0.5, abs=0.01)


def test_the_center_of_gravity_is_that_of_the_flight(flown: FlightTwin, check: Verification) -> None:
    """Another battery place than in the fit, by 5 mm: found, and then nothing else of the prediction changes."""
    same = check
    (moved,) = (
        predictor(flown, {"x_cg": 0.005, "y_cg": -0.003}).predict([flown.record], VerifySettings()).found.maneuvers
    )
    assert same.flight is not None
    assert moved.flight is not None
    assert np.abs(list(same.flight.center.values())).max() < 0.001
    assert dict(moved.flight.center) == pytest.approx(dict(same.flight.center), abs=2e-4)
    assert moved.flight.errors.moment_rms_nm == pytest.approx(same.flight.errors.moment_rms_nm, rel=0.01)
    assert flight_scores(moved.flight).center_m == dict(moved.flight.center)


def test_an_axis_that_the_motors_do_not_turn_judges_no_vehicle(flown: FlightTwin) -> None:
    vehicle = replace(predictor(flown), bands_hz={"p": (2.0, 8.0), "q": (2.0, 8.0), "r": (2.0, 8.0)})
    (topic,) = flown.record.topics
    names = [channel.name for channel in topic.channels]
    values = topic.values.copy()
    noise = np.random.default_rng(2).standard_normal(values.shape[1])
    values[names.index("r")] = 0.01 * noise
    (check,) = vehicle.predict(
        [replace(flown.record, topics=(replace(topic, values=values),))], VerifySettings()
    ).found.maneuvers
    assert "r_dot" in check.output_names
    assert "r_dot" not in check.moved
    assert {"p_dot", "q_dot"} <= set(check.moved)


def test_what_does_not_judge_is_named_once_with_its_reason(flown: FlightTwin) -> None:
    vehicle = predictor(flown)
    (stretch,) = vehicle._stretches(vehicle.data(flown.record, ()))
    check = vehicle._verification(stretch)
    rows = {name: check.measured[row] for row, name in enumerate(check.output_names)}
    still = check.measured * np.array([[0.0 if name == "ay" else 1.0] for name in rows])
    idle = tuple(name for name in check.moved if name not in ("ay", "p_dot"))
    (found,) = _unjudged("flight", replace(check, measured=still, moved=idle))
    assert found.severity == "info"
    assert found.message == (
        "flight does not judge ay and p_dot: slow motion varies ay by 0 m/s² only (0.5 needed); the motors do not "
        "explain roll."
    )
    assert _unjudged("flight", replace(check, moved=check.output_names)) == []


def in_wind(flown: FlightTwin, north_m_s: float, east_m_s: float) -> FlightRecord:
    """The same flight through the air, carried over the ground by a wind."""
    (topic,) = flown.record.topics
    names = [channel.name for channel in topic.channels]
    values = topic.values.copy()
    values[names.index("velocity_north")] += north_m_s
    values[names.index("velocity_east")] += east_m_s
    return replace(flown.record, topics=(replace(topic, values=values),))


def test_a_wind_is_of_the_log_though_no_fitted_flight_had_one(flown: FlightTwin, check: Verification) -> None:
    vehicle, calm = predictor(flown), check
    assert not vehicle.windy
    (blown,) = vehicle.predict([in_wind(flown, 3.0, -2.0)], VerifySettings()).found.maneuvers
    assert calm.flight is not None
    assert blown.flight is not None
    assert blown.flight.wind == pytest.approx((flown.wind[0] + 3.0, flown.wind[1] - 2.0), abs=0.3)
    # Gusts have a mean, which counts with a wind.
    assert (blown.flight.errors.force_rms_n or 9.0) < 1.03 * (calm.flight.errors.force_rms_n or 0.0)
    assert blown.scores["ax"].tic == pytest.approx(calm.scores["ax"].tic, abs=0.02)


@pytest.mark.parametrize(
    ("wind", "windy", "taken"),
    [((0.5, 0.5), False, False), ((0.5, 0.5), True, True), ((3.0, -2.0), False, True), ((np.nan, np.nan), True, False)],
)
def test_what_a_bias_may_be_is_no_wind_of_a_log(
    flown: FlightTwin, monkeypatch: pytest.MonkeyPatch, wind: tuple[float, float], windy: bool, taken: bool
) -> None:
    found = (np.array(wind), np.array([0.6, 0.6]))
    monkeypatch.setattr("rotorid.checking.flight.wind_of", lambda *_, **__: found)
    (check,) = replace(predictor(flown), windy=windy).predict([flown.record], VerifySettings()).found.maneuvers
    assert check.flight is not None
    assert check.flight.wind == (wind if taken else None)


def test_a_vehicle_without_drag_is_off_by_it(flown: FlightTwin, check: Verification) -> None:
    (without,) = predictor(flown, {"k_d": 0.0}).predict([flown.record], VerifySettings()).found.maneuvers
    assert check.flight is not None
    assert without.flight is not None
    missed, noise = (one.flight.errors.axes["x"].force_rms_n or 0.0 for one in (without, check) if one.flight)
    speed = float(np.sqrt(np.mean(flown.motors.velocity[0] ** 2)))
    turning = float(flown.motors.outputs.sum(axis=0).mean())
    assert np.sqrt(missed**2 - noise**2) == pytest.approx(flown.truth["k_d"] * turning * speed, rel=0.15)


def test_a_faster_flight_is_beyond_the_identified_range(flown: FlightTwin) -> None:
    slow = replace(predictor(flown), tested=FlightRange((0.0, 2.0), (-1.0, 1.0), (0.0, 1e4), (0.9, 1.1)))
    found = slow.predict([flown.record], VerifySettings())
    (beyond,) = (finding for finding in found.found.findings if finding.kind == "beyond_range")
    assert beyond.numbers["airspeed"] > 20.0
    assert beyond.numbers["motors"] == 0.0
    assert "airspeed" in beyond.message
    assert "rotor speed" not in beyond.message
    _, said = slow.simulations(flown.record, FlySettings())
    assert "beyond_range" in [finding.kind for finding in said]


def test_a_log_is_flown_in_pieces(flown: FlightTwin) -> None:
    (simulation,), findings = predictor(flown).simulations(flown.record, FlySettings(pieces_s=1.0))
    simulated = simulation.outputs_at(flown.truth)
    assert simulation.output_names == ("phi", "theta", "psi", "u", "v", "w", "p", "q", "r")
    assert simulated.shape == simulation.measured.shape
    np.testing.assert_allclose(simulated[:, list(simulation.starts)], simulation.measured[:, list(simulation.starts)])
    missed = np.sqrt(np.mean((simulated - simulation.measured) ** 2, axis=1))
    assert np.all(missed[:2] < 0.5 * simulation.measured[:2].std(axis=1))
    assert "flown_in_pieces" in [finding.kind for finding in findings]


def test_other_numbers_fly_otherwise(flown: FlightTwin) -> None:
    """Also what acts before the equations do: the lag of the motors, here of speeds that have none."""
    (simulation,), _ = predictor(flown).simulations(flown.record, FlySettings())
    truth, heavy = (simulation.outputs_at({**flown.truth, "I_xx": factor * flown.truth["I_xx"]}) for factor in (1, 2))
    assert np.abs(truth[0] - heavy[0]).max() > 0.01


def test_scores_for_comparisons_are_those_of_the_verification(flown: FlightTwin, check: Verification) -> None:
    (trial,) = predictor(flown).trials(flown.record, IdentifySettings())
    (scores,) = trial.score(None, None)
    assert {name: score.tic for name, score in scores.scores.items()} == {
        name: check.scores[name].tic for name in check.moved
    }


def test_without_a_mass_there_are_no_newtons(flown: FlightTwin) -> None:
    (check,) = replace(predictor(flown), scaled=False).predict([flown.record], VerifySettings()).found.maneuvers
    assert check.flight is not None
    assert check.flight.errors.force_rms_n is None
    assert check.flight.outside_percent is not None


def test_motors_of_another_kind_do_not_judge(flown: FlightTwin) -> None:
    found = replace(predictor(flown), kind="output").predict([flown.record], VerifySettings()).found
    assert not found.maneuvers
    (refused,) = (finding for finding in found.findings if finding.kind == "not_verified")
    assert "logs motors as speed" in refused.message


def test_a_log_without_attitude_is_not_flown(flown: FlightTwin) -> None:
    (topic,) = flown.record.topics
    kept = [row for row, channel in enumerate(topic.channels) if channel.name not in ("phi", "theta", "psi")]
    blind = replace(
        flown.record,
        topics=(replace(topic, channels=tuple(topic.channels[row] for row in kept), values=topic.values[kept]),),
    )
    with pytest.raises(InsufficientDataError, match="attitude"):
        predictor(flown).simulations(blind, FlySettings())
    found = predictor(flown).predict([blind], VerifySettings()).found
    (check,) = found.maneuvers
    assert check.flight is not None
    assert check.flight.ahead is None
    # What is not known lies in no range, and is said.
    assert set(check.flight.outside) == {"motors", "load"}
    assert "velocity_from_attitude" in [finding.kind for finding in found.findings]


def test_a_result_that_lacks_its_air_is_refused() -> None:
    with pytest.raises(UsageError, match="inconsistent"):
        known_flight({"parameters": {}, "motors": {}})


def test_bands_are_those_of_their_octaves() -> None:
    assert torque_bands([]) == {}
