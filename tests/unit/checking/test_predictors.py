"""One door to unseen flights: every verb asks the predictor of a model, and all get the same answer."""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from tests.unit.checking.large_motion import large_motion
from tests.unit.checking.response_flight import flight as roll_flight
from tests.unit.identifying.motor_logs import ARM_M, flight, with_speeds

import rotorid
from rotorid.checking.candidate import candidate_model
from rotorid.checking.linear import LinearPredictor
from rotorid.checking.motors import MotorPredictor, identified_motors
from rotorid.checking.nonlinear import NonlinearPredictor
from rotorid.checking.predictors import predictor_of
from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord
from rotorid.flying import fly_log
from rotorid.identifying import compare, identify, identify_motors, verify
from rotorid.results.model import IdentifiedModel
from rotorid.settings import FlySettings, IdentifySettings, MotorSettings, VerifySettings
from rotorid.vehicles.motor_flight import TRUTH

CHOICES = MotorSettings(known={"m": TRUTH["m"]}, layout="quad.x", arm_m=ARM_M, method="accelerations")
VERBS = ("identifying/verification.py", "identifying/comparison.py", "identifying/cross_validation.py")


@pytest.fixture(scope="module")
def motor_log(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int], FlightRecord]:
    folder = tmp_path_factory.mktemp("motors")
    return lambda seed: rotorid.read(flight(folder / f"flight{seed}.csv", seed=seed))


@pytest.fixture(scope="module")
def motors(motor_log: Callable[[int], FlightRecord]) -> IdentifiedModel:
    return identify_motors([motor_log(1)], CHOICES, verify=[motor_log(2)])


@pytest.fixture(scope="module")
def drag() -> IdentifiedModel:
    return identify([large_motion(seed=1)], "drag.linear", verify=[large_motion(seed=2)])


@pytest.fixture(scope="module")
def response() -> IdentifiedModel:
    return identify([roll_flight(seed=1, samples=800)], "response.second_order_delay")


def test_each_kind_of_model_has_its_predictor(
    motors: IdentifiedModel, drag: IdentifiedModel, response: IdentifiedModel
) -> None:
    kinds = [type(predictor_of(candidate_model(model))) for model in (motors, drag, response)]
    assert kinds == [MotorPredictor, NonlinearPredictor, LinearPredictor]


def test_identify_and_verify_say_the_same_of_an_unseen_flight(
    motors: IdentifiedModel, drag: IdentifiedModel, motor_log: Callable[[int], FlightRecord]
) -> None:
    for model, log in ((motors, motor_log(2)), (drag, large_motion(seed=2))):
        (within,) = model.verifications.maneuvers
        (after,) = verify(model, [log]).found.maneuvers
        assert after.scores == within.scores
        assert after.maneuver == within.maneuver
        assert after.input_names == within.input_names


def test_identify_and_verify_refuse_a_log_in_one_sentence(
    motors: IdentifiedModel, motor_log: Callable[[int], FlightRecord], tmp_path: Path
) -> None:
    speeds = rotorid.read(with_speeds(tmp_path / "speeds.csv"))
    within = identify_motors([motor_log(1)], CHOICES, verify=[speeds])
    after = verify(motors, [speeds, motor_log(2)])
    first, second = (_not_verified(one.findings) for one in (within, after))
    assert first == second
    assert "speeds.csv logs motors as speed" in first[0]


def test_a_log_with_its_rotors_in_other_places_judges_nothing(
    motors: IdentifiedModel, motor_log: Callable[[int], FlightRecord]
) -> None:
    vehicle = identified_motors(motors)
    assert vehicle is not None
    wider = replace(vehicle, choices=replace(CHOICES, arm_m=2.0 * ARM_M))
    with pytest.raises(rotorid.InsufficientDataError, match=r"rotor positions of flight2\.csv differ"):
        wider.data(motor_log(2), ())
    assert vehicle.data(motor_log(2), ()).layout is vehicle.layout


def test_a_log_that_does_not_say_its_rotors_judges_no_fit_beside_it(
    motors: IdentifiedModel, motor_log: Callable[[int], FlightRecord]
) -> None:
    vehicle = identified_motors(motors)
    assert vehicle is not None
    beside = replace(vehicle, choices=replace(CHOICES, layout=None, arm_m=None))
    with pytest.raises(rotorid.InsufficientDataError, match="--layout"):
        beside.data(motor_log(2), ())


def _not_verified(findings: Sequence[Finding]) -> list[str]:
    return [one.message for one in findings if one.kind == "not_verified"]


def test_a_comparison_and_a_simulation_fly_what_a_verification_does(drag: IdentifiedModel) -> None:
    log = large_motion(seed=2)
    (checked,) = verify(drag, [log]).found.maneuvers
    (compared,) = compare([drag, drag], [log]).maneuvers
    (flown,) = fly_log(drag, [log]).stretches
    assert compared.maneuver == flown.maneuver == checked.maneuver
    (scored,) = compared.scores["drag.linear (1)"]
    for name, score in checked.scores.items():
        assert scored.scores[name].rms == score.rms
        assert flown.scores[name].rms == pytest.approx(score.rms, rel=1e-9)


def test_what_a_log_lacks_is_an_error_of_every_question(
    motors: IdentifiedModel, drag: IdentifiedModel, response: IdentifiedModel
) -> None:
    empty = replace(roll_flight(seed=2), topics=())
    for model in (motors, drag, response):
        predictor = predictor_of(candidate_model(model))
        predicted = predictor.predict([empty], VerifySettings())
        assert [one.kind for one in predicted.found.findings] == ["not_verified"]
        assert predicted.flights == ()
        with pytest.raises(rotorid.InsufficientDataError):
            predictor.trials(empty, IdentifySettings())
        with pytest.raises(rotorid.InsufficientDataError):
            predictor.simulations(empty, FlySettings())


@pytest.mark.parametrize("name", VERBS)
def test_no_verb_asks_what_kind_a_model_is(name: str) -> None:
    tree = ast.parse((Path(rotorid.__file__).parent / name).read_text(encoding="utf-8"))
    asked = {one.attr for one in ast.walk(tree) if isinstance(one, ast.Attribute)} & {"motors", "nonlinear"}
    assert not asked
