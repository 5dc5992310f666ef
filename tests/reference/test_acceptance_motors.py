"""Motors, thrust and inertia from the motor outputs of real and simulated flights, against what is known of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest
from tests.reference.motor_flights import (
    ARDUPILOT_SPANS,
    CRAZYFLIE_SPAN,
    IRIS_LEVERS,
    ardupilot_records,
    iris_record,
    iris_speed_m_s,
    levers_of,
    motor_record,
    px4_record,
)

import rotorid
from rotorid.data.record import MotorRecord
from rotorid.errors import InsufficientDataError
from rotorid.fitting.motors.excitation import LEAST_CORRELATION, excitations, excited_axes
from rotorid.fitting.motors.fit import MotorFit, fit_motors
from rotorid.fitting.motors.inertia import InertiaRegression, compare_regressions, inertia_regressions
from rotorid.fitting.motors.problem import MotorProblem
from rotorid.models.autopilots.layouts import layout_of, mixer_of
from rotorid.models.motors import Curve, check_motor_constants, motor_parameters
from rotorid.signal.motors import motor_history
from rotorid.typing import FloatArray
from rotorid.uncertainty.colored import colored_by_part
from rotorid.units import STANDARD_GRAVITY_M_S2

Unpacked = Callable[[str], Path]

TWO_SIDED = 1.96
INERTIA, LAG, THRUST = 0.05, 0.15, 0.03
"""Relative errors that the issue allows in simulated flights."""

K_F = (0.02272, -0.01194, 0.12837)
K_F_SLIPPED = (0.02126557, -0.01117503, 0.12012994)


@dataclass(frozen=True)
class Identified:
    """A fit with the intervals of its values."""

    fit: MotorFit

    @property
    def values(self) -> Mapping[str, float]:
        return self.fit.parameters.values

    @cached_property
    def deviations(self) -> Mapping[str, float]:
        """Of what is free and did not end on a bound."""
        covariance = colored_by_part(self.fit.parts()).corrected
        return dict(zip(self.fit.moving, np.sqrt(np.diag(covariance)), strict=True))

    @cached_property
    def ways(self) -> Mapping[str, InertiaRegression]:
        return {one.axis: one for one in inertia_regressions(self.fit)}

    def thrust(self, outputs: FloatArray) -> FloatArray:
        return thrust(tuple(self.values.get(name, 0.0) for name in ("c_0", "c_1", "c_2")), outputs)


def thrust(coefficients: Sequence[float], outputs: FloatArray) -> FloatArray:
    return np.asarray(np.polynomial.polynomial.polyval(outputs, coefficients))


def identify(
    records: Sequence[MotorRecord], levers: FloatArray, known: Mapping[str, float], curve: Curve
) -> Identified:
    axes = excited_axes(excitations(records, levers))
    parameters = motor_parameters(curve=curve, known=known, axes=axes, heave_damping=records[0].w.size > 0)
    problem = MotorProblem(records=tuple(records), levers=levers, parameters=parameters, axes=("weight", *axes))
    return Identified(fit_motors(problem))


def stored(unpacked: Unpacked, folder: Path, name: str) -> Path:
    return unpacked(name if (folder / name).exists() else f"{name}.xz")


class TestCrazyflie:
    """A real flight: thrust manoeuvres, motors commanded without a loop around their speed."""

    OUTPUTS = np.linspace(0.2, 0.9, 71)

    @pytest.fixture(scope="class")
    @classmethod
    def record(cls, shared_data: Path) -> MotorRecord:
        flight = rotorid.read(shared_data / "crazyflie" / "log10")
        return motor_record(flight, CRAZYFLIE_SPAN, 1000.0, velocity=False)

    @pytest.fixture(scope="class")
    @classmethod
    def levers(cls, shared_data: Path) -> FloatArray:
        return levers_of(layout_of(rotorid.read(shared_data / "crazyflie" / "log10")).scaled(0.028 * np.sqrt(2.0)))

    @pytest.fixture(scope="class")
    @classmethod
    def found(cls, record: MotorRecord, levers: FloatArray) -> Identified:
        # The published model has a lag alone.
        return identify([record], levers, {"m": 0.027, "tau_accel": 0.0}, "polynomial")

    def test_motor_lag(self, found: Identified) -> None:
        assert found.values["T_motor"] == pytest.approx(0.072, abs=0.003)
        assert found.deviations["T_motor"] < 0.003

    def test_thrust_curve(self, found: Identified) -> None:
        np.testing.assert_allclose(found.thrust(self.OUTPUTS), thrust(K_F, self.OUTPUTS), rtol=0.01)

    def test_each_coefficient_within_its_interval(self, found: Identified) -> None:
        for name, published in zip(("c_0", "c_1", "c_2"), K_F, strict=True):
            assert abs(found.values[name] - published) < TWO_SIDED * found.deviations[name], name

    def test_published_coefficients_with_their_slip_of_scale(self, record: MotorRecord, levers: FloatArray) -> None:
        slipped = replace(record, az=record.az * 9.18 / 9.81)
        # No weight: with the slip the vehicle does not carry its own.
        parameters = motor_parameters(known={"m": 0.027, "tau_accel": 0.0}, axes=("az",), heave_damping=False)
        found = Identified(
            fit_motors(MotorProblem(records=(slipped,), levers=levers, parameters=parameters, axes=("az",)))
        )
        np.testing.assert_allclose(found.thrust(self.OUTPUTS), thrust(K_F_SLIPPED, self.OUTPUTS), rtol=0.01)
        for name, published in zip(("c_0", "c_1", "c_2"), K_F_SLIPPED, strict=True):
            assert abs(found.values[name] - published) < TWO_SIDED * found.deviations[name], name

    def test_the_rates_were_not_excited(self, found: Identified) -> None:
        (seen,) = found.fit.excitations
        assert [axis for axis, one in seen.items() if one.correlation >= LEAST_CORRELATION] == ["az"]


class TestPx4:
    """Simulated sweeps of all axes, together."""

    @pytest.fixture(scope="class")
    @classmethod
    def found(cls, unpacked: Unpacked, shared_data: Path) -> Identified:
        names = ("roll", "pitch", "yaw", "thrust")
        paths = [stored(unpacked, shared_data, f"px4_sitl/{name}.ulg") for name in names]
        levers = levers_of(layout_of(rotorid.read(paths[0])).scaled(0.2 * np.sqrt(2.0)))
        return identify([px4_record(path) for path in paths], levers, {"m": 1.0, "kappa": 0.02}, "linear")

    def test_inertia(self, found: Identified) -> None:
        for name, truth in {"I_xx": 0.025, "I_yy": 0.025, "I_zz": 0.030}.items():
            assert found.values[name] == pytest.approx(truth, rel=INERTIA), name

    def test_motor_lag(self, found: Identified) -> None:
        assert found.values["T_motor"] == pytest.approx(0.048, rel=LAG)

    def test_thrust(self, found: Identified) -> None:
        assert found.values["c_1"] == pytest.approx(5.0, rel=THRUST)

    def test_damping(self, found: Identified) -> None:
        """Of rates that are measured with noise: within three standard deviations."""
        for name, truth in {"L_p": -1.0, "M_q": -1.0, "N_r": -0.833}.items():
            assert abs(found.values[name] - truth) < 3.0 * found.deviations[name], name

    def test_both_ways_agree_where_plain_regression_does_not(self, found: Identified) -> None:
        assert set(found.ways) == {"p", "q", "r"}
        for one in found.ways.values():
            assert one.telling
            assert one.agrees
            assert one.biases[1] < -0.5
        assert {finding.kind for finding in compare_regressions(list(found.ways.values()))} == {"noisy_acceleration"}

    def test_physics_allows_it(self, found: Identified) -> None:
        problem = found.fit.problem
        findings = check_motor_constants(found.values, records=problem.records, levers=problem.levers)
        assert [finding.message for finding in findings] == []

    @pytest.fixture(scope="class")
    @classmethod
    def doublets(cls, unpacked: Unpacked, shared_data: Path) -> Identified:
        path = stored(unpacked, shared_data, "px4_sitl/verify.ulg")
        levers = levers_of(layout_of(rotorid.read(path)).scaled(0.2 * np.sqrt(2.0)))
        return identify([px4_record(path)], levers, {"m": 1.0, "kappa": 0.02}, "linear")

    def test_doublets_alone(self, doublets: Identified) -> None:
        assert set(doublets.ways) == {"p", "q"}
        assert doublets.values["I_yy"] == pytest.approx(0.025, rel=INERTIA)
        assert doublets.values["T_motor"] == pytest.approx(0.048, rel=LAG)
        assert doublets.values["c_1"] == pytest.approx(5.0, rel=THRUST)

    @pytest.mark.xfail(
        strict=True,
        raises=AssertionError,
        reason="0.0236 kg m^2, 5.5 % too small: a few doublets weigh fast motion, where gyros pass a filter",
    )
    def test_inertia_of_doublets_alone(self, doublets: Identified) -> None:
        assert doublets.values["I_xx"] == pytest.approx(0.025, rel=INERTIA)


class TestArduPilot:
    """Simulated chirps in wind; the simulated motors have no lag."""

    @pytest.fixture(scope="class")
    @classmethod
    def found(cls, unpacked: Unpacked, shared_data: Path) -> Identified:
        names = ("x_wind_rollpitch.BIN", "x_wind_yawthrust.BIN")
        paths = [stored(unpacked, shared_data, f"ardupilot_sitl/{name}") for name in names]
        levers = levers_of(layout_of(rotorid.read(paths[0])).scaled(0.35))
        records = [record for path in paths for record in ardupilot_records(path)]
        assert len(records) == sum(len(ARDUPILOT_SPANS[name]) for name in names)
        return identify(records, levers, {"m": 3.0, "I_zz": 0.04594}, "linear")

    def test_inertia(self, found: Identified) -> None:
        for name in ("I_xx", "I_yy"):
            assert found.values[name] == pytest.approx(0.02297, rel=INERTIA), name

    def test_yaw(self, found: Identified) -> None:
        """14.18 rad/s² per unit of yaw, which moves each motor by half a unit."""
        per_unit = found.values["kappa_per_I_zz"] * found.values["c_1"] * 4.0 * 0.5
        assert per_unit == pytest.approx(14.18, rel=INERTIA)

    def test_no_motor_lag(self, found: Identified) -> None:
        """Lag and delay together are less than a fifth of a sample."""
        assert found.values["T_motor"] + found.values["tau_gyro"] < 0.001
        assert "T_motor" not in found.deviations
        assert 0.0 < found.deviations["tau_gyro"] < 0.0005

    def test_thrust(self, found: Identified) -> None:
        """27.05 m/s² per unit at a mass of 3 kg, by four motors."""
        assert found.values["c_1"] == pytest.approx(27.05 * 3.0 / 4.0, rel=THRUST)

    def test_both_ways_agree(self, found: Identified) -> None:
        assert set(found.ways) == {"p", "q", "r"}
        for one in found.ways.values():
            assert one.telling
            assert one.agrees

    def test_both_ways_see_that_the_loop_is_faster_than_the_log(self, unpacked: Unpacked, shared_data: Path) -> None:
        """Outputs of 400 Hz, logged at 200 Hz and taken as held: the fast motion is not that of the torque."""
        path = stored(unpacked, shared_data, "ardupilot_sitl/x_wind_rollpitch.BIN")
        levers = levers_of(layout_of(rotorid.read(path)).scaled(0.35))
        found = identify(ardupilot_records(path, held=True), levers, {"m": 3.0}, "linear")
        told = compare_regressions(list(found.ways.values()))
        disagreeing = {finding.where for finding in told if finding.kind == "both_ways_disagree"}
        assert disagreeing == {"I_xx", "I_yy"}


class TestIris:
    """A simulated flight whose motors were stored at 10 Hz and joined by straight lines."""

    LAG_S = 0.5 * (0.0125 + 0.025)
    CURVE = (0.0584, 1.168, 5.84)

    @pytest.fixture(scope="class")
    @classmethod
    def record(cls, shared_data: Path) -> MotorRecord:
        return iris_record(shared_data / "iris_sim" / "quadrotor_model.csv")

    @pytest.fixture(scope="class")
    @classmethod
    def found(cls, record: MotorRecord) -> Identified:
        return identify([record], IRIS_LEVERS, {"m": 1.5, "kappa": 0.06}, "polynomial")

    @pytest.fixture(scope="class")
    @classmethod
    def share(cls, record: MotorRecord, found: Identified) -> float:
        """Identified thrust by that of a rotor at rest, at the median output."""
        median = np.array([np.median(record.outputs)])
        return float((found.thrust(median) / thrust(cls.CURVE, median))[0])

    def test_motor_lag(self, found: Identified) -> None:
        assert found.values["T_motor"] == pytest.approx(self.LAG_S, rel=LAG)

    def test_thrust_at_the_speed_of_the_flight(self, shared_data: Path, share: float) -> None:
        """The simulator's rotors lose a share of their thrust that grows with speed, all of it at 25 m/s."""
        speed_m_s = iris_speed_m_s(shared_data / "iris_sim" / "quadrotor_model.csv")
        assert share == pytest.approx(1.0 - float(np.mean(speed_m_s)) / 25.0, rel=THRUST)

    def test_inertia_of_yaw(self, record: MotorRecord) -> None:
        """With the curve known: the torque of a rotor does not lose what its thrust loses."""
        known = {"m": 1.5, "kappa": 0.06} | dict(zip(("c_0", "c_1", "c_2"), self.CURVE, strict=True))
        found = identify([record], IRIS_LEVERS, known, "polynomial")
        assert found.values["I_zz"] == pytest.approx(0.055225, rel=INERTIA)

    @pytest.mark.xfail(
        strict=True, raises=AssertionError, reason="thrust falls with speed in this flight: 4.7 % below that at rest"
    )
    def test_thrust_at_rest(self, share: float) -> None:
        assert share == pytest.approx(1.0, rel=THRUST)

    @pytest.mark.xfail(
        strict=True,
        raises=InsufficientDataError,
        reason="motors stored at 10 Hz: correlations of 0.75 and 0.67 with roll and pitch, whose loops are faster",
    )
    @pytest.mark.parametrize(("axis", "name"), [("p", "I_xx"), ("q", "I_yy")])
    def test_inertia_of_roll_and_pitch(self, record: MotorRecord, axis: str, name: str) -> None:
        parameters = motor_parameters(known={"m": 1.5}, axes=("az", axis))
        problem = MotorProblem(records=(record,), levers=IRIS_LEVERS, parameters=parameters, axes=("az", axis))
        assert fit_motors(problem).parameters[name].value == pytest.approx(0.029125, rel=INERTIA)


class TestErleBrain:
    """A real flight with motors at 9 Hz and rates at 24 Hz."""

    @pytest.fixture(scope="class")
    @classmethod
    def path(cls, shared_data: Path) -> Path:
        return shared_data / "ardupilot" / "erle_brain3.BIN"

    def test_the_rate_is_said_to_be_too_low(self, path: Path) -> None:
        flight = rotorid.read(path)
        history = motor_history(flight, mixer_of(layout_of(flight), flight.source.format))
        assert "rate_too_low" in {finding.kind for finding in history.findings}

    def test_there_is_no_inertia_and_no_lag(self, path: Path) -> None:
        flight = rotorid.read(path)
        record = motor_record(flight, (41.0, 267.0), 20.0, velocity=False)
        levers = levers_of(layout_of(flight))
        assert {"p", "q", "r"}.isdisjoint(excited_axes(excitations([record], levers)))
        found = identify([record], levers, {"m": 1.0}, "linear")
        assert "T_motor" not in found.fit.moving
        lifted = float(np.mean(found.thrust(record.outputs).sum(axis=0)))
        assert lifted == pytest.approx(STANDARD_GRAVITY_M_S2, rel=0.02)
