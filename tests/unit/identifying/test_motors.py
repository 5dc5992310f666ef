"""physical.motors from a log: what it tells, what it leaves open, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.unit.identifying.motor_logs import ARM_M, THRUST_BY_SPEED, flight, repeated, with_speeds

from rotorid.documents.result import ResultDocument, result_document
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.identifying.identification import identify_motors
from rotorid.io.registry import read
from rotorid.models.toml import from_toml
from rotorid.results.model import IdentifiedModel
from rotorid.settings.motors import MotorSettings, chosen_layout
from rotorid.vehicles.motor_flight import TRUTH


def choices(**more: object) -> MotorSettings:
    return MotorSettings(**{"known": {"m": TRUTH["m"]}, "layout": "quad.x", "arm_m": ARM_M, **more})  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flight(tmp_path_factory.mktemp("motors") / "flight.csv")


@pytest.fixture(scope="module")
def found(log: Path, tmp_path_factory: pytest.TempPathFactory) -> IdentifiedModel:
    other = flight(tmp_path_factory.mktemp("motors") / "unseen.csv", seed=2)
    return identify_motors([read(log)], choices(), verify=[read(other)])


def off(document: ResultDocument, name: str, truth: float) -> float:
    """How many standard deviations a value lies from the truth."""
    one = document.parameters[name]
    assert one.std is not None
    return abs(one.value - truth) / one.std


def kinds(document: ResultDocument) -> set[str]:
    return {finding.kind for finding in document.findings}


@pytest.mark.parametrize("name", ["I_xx", "I_yy", "kappa_per_I_zz", "T_motor", "tau_gyro", "tau_accel"])
def test_the_truth_lies_within_four_deviations(found: IdentifiedModel, name: str) -> None:
    assert off(result_document(found), name, TRUTH[name]) < 4.0


def test_thrust_at_hover_carries_the_weight(found: IdentifiedModel) -> None:
    assert result_document(found).motors is not None
    hover = result_document(found).motors.derived["thrust_hover"]
    assert hover.value == pytest.approx(TRUTH["m"] * 9.80665 / 4.0, abs=4.0 * hover.std)


def test_a_bootstrap_of_motors_agrees_with_their_random_errors(log: Path, found: IdentifiedModel) -> None:
    model = identify_motors([read(log)], choices(bootstrap=12))
    again = model.fit.bootstrap
    assert again is not None
    # Noise alone is drawn anew, and judged by random errors: model errors are no part of its spread.
    assert "bootstrap_disagrees" not in {one.kind for one in model.findings}
    assert (again.runs, again.source) == (12, "outputs")
    assert set(again.parameters) <= set(found.bounds.names)
    # Of 12 runs a standard deviation is known to 21 %: four of these. Stated ones hold systematic errors beside.
    for name, spread in again.parameters.items():
        assert spread.std < 1.85 * (found[name].std or 0.0), name


def test_an_unseen_flight_is_scored(found: IdentifiedModel) -> None:
    (scores,) = result_document(found).verification.records.values()
    assert set(scores) == {"p_dot", "q_dot", "r_dot", "az"}
    assert all(score.tic < 0.25 for score in scores.values())


def test_what_cannot_judge_is_told_and_refuses_nothing(log: Path, tmp_path: Path) -> None:
    calm = flight(tmp_path / "calm.csv", size=0.0)
    broken = tmp_path / "no_motors.csv"
    broken.write_text("time [s],p [rad/s]\n0.0,0.0\n0.1,0.1\n0.2,0.0\n", encoding="utf-8")
    document = result_document(identify_motors([read(log)], choices(), verify=[read(log), read(calm), read(broken)]))
    assert not document.verification.records
    told = [finding.kind for finding in document.findings]
    assert told.count("not_verified") == 2
    assert told.count("seen_data") == 1


def test_thrust_known_from_a_bench_gives_the_mass(log: Path, found: IdentifiedModel) -> None:
    known = {name: result_document(found).parameters[name].value for name in ("c_0", "c_1", "c_2")}
    document = result_document(identify_motors([read(log)], choices(known=known)))
    assert document.motors is not None
    assert document.motors.scale == "c_1"
    assert document.parameters["m"].value == pytest.approx(TRUTH["m"], rel=0.01)


def test_what_is_given_and_not_used_is_said(log: Path) -> None:
    document = result_document(identify_motors([read(log)], choices(known={"m": TRUTH["m"], "I_zz": 0.03})))
    assert "unused_choice" not in kinds(document)
    steady = result_document(
        identify_motors([read(log)], choices(known={"m": TRUTH["m"], "c_0": 0.3}, curve="polynomial"))
    )
    assert steady.parameters["c_0"].status == "fixed"


def test_the_model_about_hover_reads_back(found: IdentifiedModel) -> None:
    structure = from_toml(found.to_toml())
    assert structure.inputs == ("motor_1", "motor_2", "motor_3", "motor_4")
    system = structure.matrices(structure.parameters.values)
    slope = result_document(found).motors.derived["thrust_slope"].value  # type: ignore[union-attr]
    row = structure.states.index("p")
    assert system.F[row, 0] == pytest.approx(-0.2 * slope / result_document(found).parameters["I_xx"].value)


def test_what_stays_open_is_said(found: IdentifiedModel) -> None:
    open_ = [finding.where for finding in result_document(found).findings if finding.kind == "not_identifiable"]
    assert "kappa, I_zz" in open_
    assert "I_zz" not in result_document(found).parameters


def test_a_torque_constant_gives_inertia_of_yaw(log: Path) -> None:
    known = {"m": TRUTH["m"], "kappa": 0.02}
    document = result_document(identify_motors([read(log)], choices(known=known)))
    assert document.parameters["I_zz"].status == "tied"
    assert off(document, "I_zz", 0.02 / TRUTH["kappa_per_I_zz"]) < 4.0


def test_without_mass_everything_is_per_kilogram(log: Path, found: IdentifiedModel) -> None:
    document = result_document(identify_motors([read(log)], choices(known={})))
    assert document.motors is not None
    assert document.motors.scale is None
    expected = result_document(found).parameters["I_xx"].value / TRUTH["m"]
    assert document.parameters["I_xx"].value == pytest.approx(expected, rel=1e-3)
    assert any(finding.where == "m" for finding in document.findings if finding.kind == "not_identifiable")


def test_without_an_arm_inertia_is_per_meter(log: Path, found: IdentifiedModel) -> None:
    document = result_document(identify_motors([read(log)], choices(arm_m=None)))
    expected = result_document(found).parameters["I_xx"].value / ARM_M
    assert document.parameters["I_xx"].value == pytest.approx(expected, rel=1e-3)
    assert any(finding.where == "I_xx, I_yy" for finding in document.findings if finding.kind == "not_identifiable")


def test_gusts_and_a_controller_alone_are_refused(tmp_path: Path) -> None:
    calm = flight(tmp_path / "calm.csv", size=0.0)
    with pytest.raises(InsufficientDataError, match="explain its motion on no axis") as refused:
        identify_motors([read(calm)], choices())
    assert "no_excitation" in {finding.kind for finding in refused.value.findings}


def test_slow_motors_have_wide_intervals(tmp_path: Path, found: IdentifiedModel) -> None:
    slow = result_document(identify_motors([read(flight(tmp_path / "slow.csv", every=20))], choices()))
    assert "interpolated_channel" in kinds(slow)
    assert slow.parameters["T_motor"].std is None or slow.parameters["T_motor"].std > 0.04
    for name in {"I_xx", "I_yy"} & set(slow.parameters):
        # Model errors are of all flights; what motors add that were logged too slowly is no random error either.
        fast = result_document(found).parameters[name].std_random
        std = slow.parameters[name].std
        assert std is not None
        assert fast is not None
        assert std > 5.0 * fast


def test_a_named_curve_that_is_wrong_is_doubted(log: Path, found: IdentifiedModel) -> None:
    assert "assumed_curve" not in kinds(result_document(found))
    assert "assumed_curve" in kinds(result_document(identify_motors([read(log)], choices(curve="linear"))))


def test_copies_of_slow_motors_are_no_samples(tmp_path: Path) -> None:
    document = result_document(identify_motors([read(repeated(tmp_path / "held.csv", every=20))], choices()))
    assert "interpolated_channel" in kinds(document)
    assert document.motors is not None
    assert document.motors.outputs_rate_hz == pytest.approx(10.0)


def test_measured_speeds_tell_thrust_without_a_lag(tmp_path: Path) -> None:
    known = {"m": TRUTH["m"], "kappa": 0.02}
    log = read(with_speeds(tmp_path / "speeds.csv"))
    document = result_document(identify_motors([log], choices(known=known, rotor_diameter_m=0.25)))
    assert document.motors is not None
    assert (document.motors.outputs, document.motors.curve) == ("speed", "quadratic")
    assert "T_motor" not in document.parameters
    assert document.hold == "first"
    assert document.parameters["c_2"].unit == "N s^2/rad^2"
    assert document.parameters["c_2"].value == pytest.approx(THRUST_BY_SPEED, rel=0.01)
    assert document.parameters["I_xx"].value == pytest.approx(TRUTH["I_xx"], rel=0.02)
    assert "implausible_physics" not in kinds(document)
    tiny = result_document(identify_motors([log], choices(known=known, rotor_diameter_m=0.05)))
    assert "impossible_physics" in kinds(tiny)


def test_the_same_choices_give_the_same_answer(log: Path, found: IdentifiedModel) -> None:
    other = flight(log.with_name("unseen_again.csv"), seed=2)
    again = identify_motors([read(log)], choices(), verify=[read(other)])
    assert result_document(again).parameters == result_document(found).parameters


def test_a_wrong_layout_is_told(log: Path) -> None:
    with pytest.raises(UsageError, match=r"4 motors, but hexa\.x has 6 rotors"):
        identify_motors([read(log)], choices(layout="hexa.x"))


def test_a_layout_that_does_not_exist_suggests_one() -> None:
    with pytest.raises(UsageError, match=r"did you mean quad\.x"):
        chosen_layout("quad_x")


def test_a_table_without_layout_asks_for_one(log: Path) -> None:
    with pytest.raises(InsufficientDataError, match="layout"):
        identify_motors([read(log)], choices(layout=None))


@pytest.mark.parametrize(
    ("known", "said"), [({"mass": 1.0}, "no parameter mass"), ({"kappa": 0.02, "I_zz": 0.03}, "both kappa and I_zz")]
)
def test_wrong_knowledge_is_refused(log: Path, known: dict[str, float], said: str) -> None:
    with pytest.raises(ModelError, match=said):
        identify_motors([read(log)], choices(known=known))


def test_wrong_choices_are_refused() -> None:
    with pytest.raises(UsageError, match="did you mean linear"):
        MotorSettings(curve="linea")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="is not positive"):
        MotorSettings(arm_m=-0.1)
