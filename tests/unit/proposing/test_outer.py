"""Outer loops: their controllers by both generations of names, their plants, and the cascade as a whole."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.models.autopilots import axis_controller
from rotorid.models.autopilots.outer import RENAMED, as_logged, outer_controller, outer_parameters
from rotorid.models.controller import RateController
from rotorid.proposing import check
from rotorid.proposing.axis import KnownAxis
from rotorid.proposing.axis_tuning import AxisTuning, axis_tuning
from rotorid.proposing.check import Foretold
from rotorid.proposing.flown_gains import LoggedLoop
from rotorid.proposing.judging import JudgedGains, judge_gains
from rotorid.proposing.new_gains import axis_gains, wishes_of
from rotorid.proposing.outer import (
    Drag,
    InnerLoop,
    LoggedOuter,
    OuterMaterial,
    attitude_response,
    flown_outer,
    known_outer,
    velocity_plant,
)
from rotorid.proposing.settings import TuneSettings
from rotorid.tuning.firmware import rounded, written
from rotorid.tuning.gain_files import read_gains
from rotorid.tuning.loops import ControllerParts, Gains, frequency_grid, quantities
from rotorid.tuning.plant import uncertain_plant
from rotorid.tuning.proposal import propose
from rotorid.typing import ComplexArray, FloatArray, LoopName

INNER = {"MC_ROLLRATE_P": 0.12, "MC_ROLLRATE_I": 0.3, "MC_ROLLRATE_D": 0.002, "MC_ROLL_P": 6.5}
PX4 = {
    **INNER,
    "IMU_DGYRO_CUTOFF": 30.0,
    "IMU_GYRO_RATEMAX": 400.0,
    "MPC_XY_VEL_P_ACC": 1.8,
    "MPC_XY_VEL_I_ACC": 0.4,
    "MPC_XY_VEL_D_ACC": 0.2,
    "MPC_XY_P": 0.95,
    "MPC_VELD_LP": 5.0,
    "EKF2_PREDICT_US": 10000.0,
}
OLD = {"PSC_VELXY_P": 2.0, "PSC_VELXY_I": 1.0, "PSC_VELXY_D": 0.5, "PSC_VELXY_FLTE": 5.0, "PSC_VELXY_FLTD": 5.0}
OLD |= {"PSC_POSXY_P": 1.0, "PSC_VELXY_IMAX": 1000.0, "SCHED_LOOP_RATE": 400.0}
DRAG = Drag(0.3, 0.0, 0.3, "a test")


def vehicle(w: FloatArray) -> ComplexArray:
    return np.asarray(113.1 / ((0.048j * w + 1.0) * (1j * w + 1.0)) * np.exp(-0.008j * w))


def record(parameters: dict[str, float]) -> FlightRecord:
    return FlightRecord(
        source=Source(name="a.ulg", format="ULog", sha256="", firmware="PX4 1.16.0"), topics=(), parameters=parameters
    )


class KnownLoop(LoggedLoop):
    """A loop without filters in front of it."""

    def parts(self, omega_rad_s: FloatArray, *, then: FlightRecord | None = None, noise: FloatArray | None = None):  # type: ignore[no-untyped-def]
        ones = np.ones(omega_rad_s.size, dtype=np.complex128)
        own = self.controller if then is None else self.with_parameters(then)
        return ControllerParts(controller=own.controller, omega_rad_s=omega_rad_s, filters=ones, logged=ones)

    def with_parameters(self, record: FlightRecord):  # type: ignore[no-untyped-def]
        return axis_controller(record.parameters, "roll", firmware="PX4 1.16.0")


def roll(parameters: dict[str, float] = PX4, *, draws: int = 40) -> KnownAxis:
    controller = axis_controller(parameters, "roll", firmware="PX4 1.16.0")
    assert controller is not None
    flown = KnownLoop(axis="roll", controller=controller, record=record(parameters), source="", known=None)  # type: ignore[arg-type]
    omega = frequency_grid(controller.controller)
    plant = uncertain_plant(vehicle, None, band_rad_s=(1.0, 100.0), draws=draws)
    parts = flown.parts(omega)
    return KnownAxis(
        flown=flown, plant=plant, omega_rad_s=omega, flown_parts=parts, then=None, controller=controller, parts=parts
    )


def material(known: KnownAxis, gains: Gains | None = None) -> OuterMaterial:
    return OuterMaterial(
        given=(),
        logs=(known.flown.record,),
        inner={"roll": InnerLoop(known, gains or known.gains)},
        draws=known.plant.draws,
        seed=0,
    )


@pytest.fixture
def drag(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rotorid.proposing.outer.drag_of", lambda *_: DRAG)


def test_px4_differentiates_the_measured_velocity_and_adds_its_integral_late() -> None:
    found = outer_controller(PX4, "velocity")
    assert found is not None
    own, w = found.controller, np.array([0.5, 3.0])
    z, alpha = np.exp(1j * w * 0.01), 0.01 / (0.01 + 0.5 / (np.pi * 5.0))
    low = alpha / (1.0 - (1.0 - alpha) / z)
    by_velocity = 1.8 + 0.4 * 0.01 / z / (1.0 - 1.0 / z) + 0.2 * (1.0 - 1.0 / z) / 0.01 * low
    held = np.exp(-1j * w * 0.005)
    np.testing.assert_allclose(own.rate_loop.response(w), by_velocity * held, rtol=1e-12)
    by_setpoint = 1.8 + 0.4 * 0.01 / z / (1.0 - 1.0 / z)
    np.testing.assert_allclose(own.setpoint_response(w), by_setpoint, rtol=1e-12)


def test_ardupilot_filters_the_error_and_uses_its_integral_at_once() -> None:
    found = outer_controller(OLD, "velocity")
    assert found is not None
    w = np.array([0.5, 3.0])
    z, alpha = np.exp(1j * w * 0.0025), 0.0025 / (0.0025 + 0.5 / (np.pi * 5.0))
    low = alpha / (1.0 - (1.0 - alpha) / z)
    made = low * (2.0 + 0.0025 / (1.0 - 1.0 / z) + 0.5 * (1.0 - 1.0 / z) / 0.0025 * low)
    np.testing.assert_allclose(found.controller.rate_loop.response(w), made, rtol=1e-12)
    np.testing.assert_allclose(found.controller.setpoint_response(w), made, rtol=1e-12)


def test_both_generations_of_names_are_one_controller_and_files_have_the_name_of_the_log() -> None:
    new = {RENAMED.get(name, (name, 1.0))[0]: value * RENAMED.get(name, (name, 1.0))[1] for name, value in OLD.items()}
    assert new["PSC_NE_VEL_IMAX"] == 10.0
    before, after = outer_controller(OLD, "velocity"), outer_controller(new, "velocity")
    assert before is not None
    assert after is not None
    assert before.controller == after.controller
    gains = Gains(P=2.5, I=1.2, D=0.4, A=1.1)
    assert written(after, rounded(after, gains)) == pytest.approx(
        {"PSC_NE_VEL_P": 2.5, "PSC_NE_VEL_I": 1.2, "PSC_NE_VEL_D": 0.4, "PSC_NE_POS_P": 1.1}
    )
    assert set(written(before, gains)) == {"PSC_VELXY_P", "PSC_VELXY_I", "PSC_VELXY_D", "PSC_POSXY_P"}


@pytest.mark.parametrize(("old", "value", "new", "then"), [
    ("PSC_VELXY_P", 2.0, "PSC_NE_VEL_P", 2.0), ("PSC_ACCZ_P", 0.5, "PSC_D_ACC_P", 0.05),
    ("PSC_ACCZ_FLTE", 20.0, "PSC_D_ACC_FLTE", 20.0), ("PSC_ACCZ_IMAX", 800.0, "PSC_D_ACC_IMAX", 0.8),
    ("PSC_POSZ_P", 1.0, "PSC_D_POS_P", 1.0),
])  # fmt: skip
def test_a_file_of_one_generation_is_read_in_the_units_of_the_other(
    old: str, value: float, new: str, then: float
) -> None:
    assert as_logged({old: value}, {new: 1.0}) == pytest.approx({new: then})
    assert as_logged({new: then}, {old: 1.0}) == pytest.approx({old: value})
    assert as_logged({old: value}, {old: 1.0}) == {old: value}
    with pytest.raises(UsageError, match="one gain with two values"):
        as_logged({old: value, new: 2.0 * then}, {new: 1.0})


def test_a_velocity_plant_is_the_attitude_loop_over_drag() -> None:
    known = roll()
    inner = InnerLoop(known, known.gains)
    plant, w = velocity_plant(inner, DRAG, seed=0), np.array([0.1, 1.0, 5.0])
    closed = attitude_response(inner, w, drawn=False)[0]
    assert abs(closed[0] - 1.0) < 0.02
    np.testing.assert_allclose(plant.response(w), closed / (1j * w + 0.3), rtol=1e-6)
    # Each draw of the attitude loop is one of the velocity loop, and no plant is known better than its floor.
    spread = np.std(np.log(np.abs(plant.drawn(w) / plant.response(w))), axis=0)
    assert np.all((spread > 0.01) & (spread < 0.06))
    assert plant.draws == known.plant.draws


def test_drag_counts_from_calm_air_to_the_wind_that_was_flown() -> None:
    drawn = Drag(0.5, 0.0, 0.2, "").drawn(np.random.default_rng(0), 500)
    assert drawn.min() < 0.22
    assert drawn.max() > 0.48


def test_ardupilots_shaping_lags_inside_the_velocity_loop() -> None:
    known = roll({**PX4, "ATC_INPUT_TC": 0.15})
    plain, w = roll(), np.array([1.0, 2.0])
    shaped = attitude_response(InnerLoop(known, known.gains), w, drawn=False)[0]
    unshaped = attitude_response(InnerLoop(plain, plain.gains), w, drawn=False)[0]
    ahead = (1.0 + 1j * w / known.gains.A) / (1.0 + 0.15j * w)
    np.testing.assert_allclose(shaped, unshaped * ahead, rtol=1e-6)


@pytest.mark.usefixtures("drag")
def test_new_inner_gains_change_the_outer_loop() -> None:
    known = roll()
    soft = replace(known.gains, A=2.0)
    stiff, _ = known_outer("velocity", material(known), material(known))
    loose, findings = known_outer("velocity", material(known), material(known, soft))
    assert [finding.kind for finding in findings] == ["controller_unchecked", "plant_of_choice"]
    own = Gains.of(stiff.controller.controller)
    found = [propose("velocity", one.plant, one.controller.controller, parts=one.parts) for one in (stiff, loose)]
    before, after = (float(np.median(one.flown.whole.sensitivity_peak)) for one in found)
    # With an attitude loop that is three times slower, PX4's defaults have no reserve left.
    assert before < 1.65 < 1.75 < after
    assert found[1].proposed.gains.A < own.A
    assert loose.flown_plant is not None
    np.testing.assert_allclose(
        loose.flown_plant.response(loose.omega_rad_s), stiff.plant.response(stiff.omega_rad_s), rtol=1e-9
    )


@pytest.mark.usefixtures("drag")
def test_the_draws_of_roll_and_pitch_count() -> None:
    known = roll()
    both = {
        "roll": InnerLoop(known, known.gains),
        "pitch": InnerLoop(known, replace(known.gains, A=2.0)),
    }
    new = replace(material(known), inner=both)
    found, _ = known_outer("velocity", new, new)
    slow, quick = (velocity_plant(both[axis], DRAG, seed=0) for axis in ("pitch", "roll"))
    w = np.array([0.5, 3.0])
    np.testing.assert_allclose(found.plant.drawn(w)[0::2], slow.drawn(w)[0::2], rtol=1e-6)
    np.testing.assert_allclose(found.plant.drawn(w)[1::2], quick.drawn(w)[1::2], rtol=2e-3)


@pytest.mark.usefixtures("drag")
def test_a_proposal_keeps_the_limits_and_its_range() -> None:
    known, _ = known_outer("velocity", material(roll()), material(roll()))
    found = propose("velocity", known.plant, known.controller.controller, parts=known.parts)
    assert found.changed
    assert found.better < 0.8
    for scores in (found.proposed.rate, found.proposed.whole):
        assert np.quantile(scores.sensitivity_peak, 0.9) <= 1.7 + 1e-9
        assert scores.stable.all()
    assert found.proposed.gains.P <= 2.0 * found.flown.gains.P


def tuned(inner: KnownAxis) -> AxisTuning:
    """The velocity loop of a flight, with what would change now."""
    known, _ = known_outer("velocity", material(inner), material(inner))
    return axis_tuning(
        "velocity", known, axis_gains("velocity", known, wishes_of(known.controller, TuneSettings())), {}
    )


@pytest.mark.usefixtures("drag")
@pytest.mark.parametrize(("angle", "verdict"), [(6.5, "as_foretold"), (2.5, "worse")])
def test_a_second_flight_is_compared_with_the_predicted_velocity_loop(angle: float, verdict: str) -> None:
    first = tuned(roll())
    new = {name: after for name, (_, after) in first.parameters.items()}
    assert first.changed
    # Somebody softened the attitude loop meanwhile, on which the velocity loop is built.
    second = tuned(roll({**PX4, **new, "MC_ROLL_P": angle}))
    before = Foretold(
        flown={name: flown for name, (flown, _) in first.parameters.items()},
        proposed=new,
        rate=quantities(first.proposal.proposed.rate),
        whole=quantities(first.proposal.proposed.whole),
    )
    found = check._checked("velocity", before, second, {})
    assert (found.gains, found.verdict) == ("proposed", verdict)
    if verdict == "as_foretold":
        assert "computed from the attitude loop of this flight" in found.sentence
    old = check._checked("velocity", before, first, {})
    assert (old.gains, old.verdict) == ("flown", "other_gains")


@pytest.mark.usefixtures("drag")
@pytest.mark.parametrize(
    ("line", "verdict"),
    [("MPC_XY_P,1.0", "fly"), ("MPC_XY_P,1.0\nMPC_XY_VEL_P_ACC,30", ""), ("MPC_XY_VEL_I_ACC,30", "do_not_fly")],
)
def test_a_file_of_outer_gains_is_judged(line: str, verdict: str) -> None:
    inner = roll()
    gains = read_gains(line, name="x.params")

    def outer(loop, _values):  # type: ignore[no-untyped-def]
        return known_outer(loop, material(inner), material(inner))[0]

    if not verdict:
        with pytest.raises(UsageError, match="out of range"):
            judge_gains(gains, {"roll": inner}, {}, outer=outer)
        return
    found = judge_gains(gains, {"roll": inner}, {}, outer=outer)
    assert list(found.axes) == ["velocity"]
    assert found.verdict == verdict


@pytest.mark.usefixtures("drag")
def test_outer_gains_by_hand_are_those_of_the_file() -> None:
    inner = roll()

    def judge(text: str, name: str) -> JudgedGains:
        def outer(loop: LoopName, _values: Mapping[str, float]) -> KnownAxis:
            return known_outer(loop, material(inner), material(inner))[0]

        return judge_gains(read_gains(text, name=name), {"roll": inner}, {}, outer=outer)

    by_hand = judge("velocity: P=2.5 A=1.1", "line.txt")
    by_name = judge("MPC_XY_VEL_P_ACC,2.5\nMPC_XY_P,1.1", "x.params")
    assert list(by_hand.axes) == list(by_name.axes) == ["velocity"]
    assert by_hand.axes["velocity"].judged.gains == by_name.axes["velocity"].judged.gains
    assert (by_hand.axes["velocity"].judged.gains.P, by_hand.axes["velocity"].judged.gains.A) == (2.5, 1.1)


@pytest.mark.parametrize(
    ("line", "words"),
    [("climb: P=3", "the log contains no gains of climb"), ("velocity: P=nan", "P in line 1 of line.txt is nan")],
)
def test_outer_gains_by_hand_need_a_loop_and_a_number(line: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        judge_gains(read_gains(line, name="line.txt"), {"roll": roll()}, {})


def test_gains_by_hand_use_the_names_of_the_log_and_its_letters() -> None:
    logged = {"PSC_D_VEL_P": 5.0, "PSC_D_POS_P": 1.0}
    with pytest.raises(UsageError, match=r"D of climb cannot be set by hand.*P, A of climb"):
        judge_gains(read_gains("climb: D=1", name="line.txt"), {}, {}, asked=("climb",), logged=logged)
    (line,) = (read_gains("P=3 A=1", name="line.txt").of("climb").by_hand.items(),)
    assert dict(line) == {"climb": {"P": 3.0, "A": 1.0}}


@pytest.mark.usefixtures("drag")
@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("MPC_XY_VEL_P_AC,30", "no parameter MPC_XY_VEL_P_AC"),
        ("MPC_XY_P,-1", "MPC_XY_P = -1 is out of range"),
    ],
)
@pytest.mark.parametrize("with_inner", [True, False])
def test_what_is_no_gain_of_an_outer_loop_is_refused_with_and_without_inner_loops(
    line: str, words: str, with_inner: bool
) -> None:
    inner = roll()
    outer = known_outer("velocity", material(inner), material(inner))[0]
    with pytest.raises(UsageError, match=words):
        judge_gains(
            read_gains(line, name="x.params"),
            {"roll": inner} if with_inner else {},
            {},
            outer=lambda _loop, _values: outer,
            asked=("velocity",),
            logged=outer.flown.record.parameters,
        )


def test_gains_that_are_not_logged_are_named() -> None:
    with pytest.raises(InsufficientDataError, match=r"a\.ulg contains no gains of velocity"):
        flown_outer("velocity", (record(INNER),))
    one = outer_controller(PX4, "velocity")
    assert one is not None
    flown = LoggedOuter(axis="velocity", controller=one, record=record(PX4))
    with pytest.raises(UsageError, match="parameters give no velocity controller"):
        flown.with_parameters(record(INNER))


def test_position_is_tuned_with_velocity() -> None:
    assert TuneSettings(axes=("roll", "position", "velocity")).axes == ("roll", "velocity")  # type: ignore[arg-type]
    assert TuneSettings(axes=("roll", "velocity")).outer == ("velocity",)
    controller = outer_controller(PX4, "velocity")
    assert controller is not None
    assert (outer_parameters(controller) or {})["A"].name == "MPC_XY_P"
    assert isinstance(controller.controller, RateController)
