"""Inertia by acceleration on torque, and by torque on acceleration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import MotorRecord
from rotorid.errors import UsageError
from rotorid.fitting.motors.fit import MotorFit, fit_motors
from rotorid.fitting.motors.inertia import InertiaRegression, compare_regressions, inertia_regressions
from rotorid.fitting.motors.problem import MotorProblem
from rotorid.models.motors import motor_parameters
from rotorid.vehicles.motor_flight import TRUTH, flights, levers

LEVERS = levers()


@pytest.fixture(scope="module")
def flown() -> MotorRecord:
    return flights(1, seed=11, duration_s=15.0)[0]


def fitted(record: MotorRecord, **known: float) -> MotorFit:
    parameters = motor_parameters(known={"m": TRUTH["m"], **known})
    return fit_motors(MotorProblem(records=(record,), levers=LEVERS, parameters=parameters))


@pytest.fixture(scope="module")
def fit(flown: MotorRecord) -> MotorFit:
    return fitted(flown)


def test_plain_ways_differ_by_the_squared_correlation(fit: MotorFit) -> None:
    for one in inertia_regressions(fit):
        assert 0.0 < one.explained < {"p": 0.9, "q": 0.9, "r": 0.2}[one.axis]
        assert one.plain[1] == pytest.approx(one.explained * one.plain[0])


def test_corrected_ways_hold_the_truth_and_agree(fit: MotorFit) -> None:
    truth = {"I_xx": TRUTH["I_xx"], "I_yy": TRUTH["I_yy"], "I_zz/kappa": 1.0 / TRUTH["kappa_per_I_zz"]}
    found = inertia_regressions(fit)
    assert [one.parameter for one in found] == list(truth)
    for one in found:
        assert one.agrees
        assert one.telling
        for value in one.corrected:
            # Uncertain thrust, lag and delay are not in the deviations: five percent for all of them in 15 s.
            assert value == pytest.approx(truth[one.parameter], rel=0.05 + 3.0 * one.deviations[1] / value)


def test_the_direct_answer_is_that_of_the_fit(fit: MotorFit) -> None:
    for one in inertia_regressions(fit)[:2]:
        assert one.corrected[0] == pytest.approx(fit.parameters[one.parameter].value, rel=2.0 * 0.02)


def test_noise_of_the_outputs_is_seen() -> None:
    """Outputs logged with noise: the direct way takes the noise for torque, what their past foretells is free of it."""
    (record,) = flights(1, seed=12, duration_s=20.0)
    noise = 0.02 * np.random.default_rng(0).standard_normal(record.outputs.shape)
    truth = {name: TRUTH[name] for name in ("c_0", "c_1", "c_2", "T_motor", "tau_gyro", "tau_accel")}
    one = inertia_regressions(fitted(replace(record, outputs=record.outputs + noise), **truth))[0]
    assert one.corrected[0] > 1.1 * TRUTH["I_xx"]
    assert one.corrected[1] == pytest.approx(TRUTH["I_xx"], abs=3.0 * one.deviations[1])
    assert not one.agrees
    assert "both_ways_disagree" in {finding.kind for finding in compare_regressions([one])}


def test_an_injected_excitation_is_an_instrument(flown: MotorRecord, fit: MotorFit) -> None:
    torque = LEVERS[0] @ flown.outputs
    one = inertia_regressions(fit, excitations=[torque])[0]
    assert one.agrees
    assert one.deviations[1] == pytest.approx(one.deviations[0], rel=0.2)


def test_a_known_inertia_of_yaw_is_stated_as_such(flown: MotorRecord) -> None:
    one = inertia_regressions(fitted(flown, kappa=0.02))[2]
    assert (one.parameter, one.unit) == ("I_zz", "kg m^2")
    assert one.corrected[0] == pytest.approx(0.02 / TRUTH["kappa_per_I_zz"], rel=0.1)


def test_an_axis_that_torque_does_not_turn_has_no_inertia(flown: MotorRecord) -> None:
    still = fitted(flown, kappa_per_I_zz=0.0)
    assert "r" in still.problem.filters[0]
    assert [one.axis for one in inertia_regressions(still)] == ["p", "q"]


def test_excitations_belong_to_records(fit: MotorFit) -> None:
    with pytest.raises(UsageError, match="2 excitations for 1 record"):
        inertia_regressions(fit, excitations=[None, None])
    with pytest.raises(UsageError, match="an excitation of 7 samples for flight 0; expected 3000"):
        inertia_regressions(fit, excitations=[np.zeros(7)])


def test_findings_name_size_and_sense_of_the_bias() -> None:
    one = InertiaRegression(
        axis="p",
        parameter="I_xx",
        unit="kg m^2",
        plain=(0.0102, 0.0088),
        corrected=(0.01, 0.0101),
        deviations=(0.0001, 0.0002),
    )
    (finding,) = compare_regressions([one])
    assert (finding.kind, finding.severity, finding.where) == ("noisy_acceleration", "info", "I_xx")
    assert "I_xx 2 % too large from acceleration on torque and 12 % too small from torque" in finding.message
    assert finding.numbers["bias_reverse"] == pytest.approx(-0.12)
