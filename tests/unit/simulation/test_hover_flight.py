"""The closed-loop flight: what it logs, what it refuses, and that it repeats itself."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Maneuver
from rotorid.errors import ModelError, UsageError
from rotorid.excitation.switching import doublet
from rotorid.simulation.hover_flight import SILENT, Excitation, Flight, SensorNoise, fly
from rotorid.typing import Axis
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.vehicles import s500

VEHICLE = s500.vehicle()


def one_doublet(axis: Axis = "roll", *, amplitude: float = 0.05, start_s: float = 1.0) -> Excitation:
    values = doublet(amplitude=amplitude, pulse_s=0.3, sample_rate_hz=1000.0, trim_s=0.1)
    maneuver = Maneuver(axis=axis, kind="doublet", start_s=start_s, stop_s=start_s + values.size / 1000.0)
    return Excitation(maneuver=maneuver, values=values, sample_rate_hz=1000.0)


def quiet(plan: tuple[Excitation, ...], *, sample_rate_hz: float = 200.0) -> Flight:
    rng = np.random.default_rng(0)
    return fly(VEHICLE, plan, sample_rate_hz=sample_rate_hz, turbulence_m_s=0.0, noise=SILENT, rng=rng)


def test_columns_are_of_the_vocabulary() -> None:
    flight = fly(VEHICLE, (one_doublet(),), rng=np.random.default_rng(0))
    assert set(flight.columns) <= set(STANDARD_UNITS)
    assert {values.shape for values in flight.columns.values()} == {flight.time_s.shape}
    assert not any(values.flags.writeable for values in flight.columns.values())


def test_calm_hover_stays_at_trim() -> None:
    columns = quiet(()).columns
    trim = {"az": -STANDARD_GRAVITY_M_S2, "thrust_command": VEHICLE.hover_thrust}
    for name, values in columns.items():
        assert set(values.tolist()) == {trim.get(name, 0.0)}, name


def test_same_seed_same_bits_and_another_seed_another_flight() -> None:
    one, two, three = (fly(VEHICLE, (one_doublet(),), rng=np.random.default_rng(seed)) for seed in (4, 4, 5))
    for name, values in one.columns.items():
        np.testing.assert_array_equal(values, two.columns[name])
    assert np.any(one.columns["p"] != three.columns["p"])


def test_log_rate_only_picks_samples() -> None:
    fast, slow = quiet((one_doublet(),), sample_rate_hz=1000.0), quiet((one_doublet(),), sample_rate_hz=125.0)
    for name, values in slow.columns.items():
        np.testing.assert_array_equal(values, fast.columns[name][::8])


def test_linear_in_its_test_inputs() -> None:
    one, two = quiet((one_doublet(),)), quiet((one_doublet("pitch", start_s=1.2),))
    both = quiet((one_doublet(), one_doublet("pitch", start_s=1.2)))
    samples = one.time_s.size
    for name in ("p", "q", "u", "v", "ax", "ay", "roll_command", "pitch_command"):
        total = one.columns[name] + two.columns[name][:samples]
        np.testing.assert_allclose(both.columns[name][:samples], total, atol=1e-12)


def test_command_is_the_controller_plus_the_excitation() -> None:
    columns = quiet((one_doublet(),), sample_rate_hz=1000.0).columns
    gains = VEHICLE.controller
    p_setpoint = gains.angle_p[0] * (columns["phi_setpoint"] - columns["phi"])
    error = p_setpoint - columns["p"]
    before = np.concatenate([[0.0], np.cumsum(error)[:-1]]) / 1000.0
    expected = gains.rate_p[0] * error + gains.rate_i[0] * before + columns["roll_excitation"]
    np.testing.assert_allclose(columns["roll_command"], expected, atol=1e-12)


def test_first_motion_comes_after_the_delay() -> None:
    flight = quiet((one_doublet(start_s=1.0),), sample_rate_hz=1000.0)
    moving = flight.time_s[np.flatnonzero(np.abs(flight.columns["p"]) > 1e-12)[0]]
    # The step begins 0.1 s into the maneuver and ramps over the step before; the state needs one step to show it.
    assert moving == pytest.approx(1.1 + s500.TRUTH["tau_roll"], abs=1.5e-3)


def test_noise_has_its_size_and_gusts_move_the_vehicle() -> None:
    sensors = SensorNoise(gyro_rad_s=0.02, attitude_rad=0.0, velocity_m_s=0.0, accelerometer_m_s2=0.3)
    still = replace(VEHICLE, controller=replace(VEHICLE.controller, rate_p=(0.0,) * 3, rate_i=(0.0,) * 3))
    flight = fly(still, (), turbulence_m_s=0.0, noise=sensors, rng=np.random.default_rng(0))
    # Without feedback the noise has nothing to move, and the log shows it alone: 1000 samples, 4 sigma.
    spread = 4.0 / math.sqrt(2.0 * flight.time_s.size)
    for name, sigma in {"p": 0.02, "q": 0.02, "r": 0.02, "ax": 0.3, "ay": 0.3, "az": 0.3}.items():
        assert flight.columns[name].std() == pytest.approx(sigma, rel=spread), name
    gusty = fly(VEHICLE, (), turbulence_m_s=0.1, noise=SILENT, rng=np.random.default_rng(0))
    assert gusty.columns["q"].std() > 0.0


def test_gust_acts_like_the_opposite_speed() -> None:
    f = VEHICLE.system.F
    velocity = [s500.STATES.index(name) for name in ("u", "v", "w")]
    np.testing.assert_array_equal(VEHICLE.gust_input, -f[:, velocity])


def test_maneuvers_are_logged_in_order() -> None:
    flight = quiet((one_doublet("yaw", start_s=3.0), one_doublet("roll", start_s=1.0)))
    assert [maneuver.axis for maneuver in flight.maneuvers] == ["roll", "yaw"]
    assert flight.time_s[-1] == pytest.approx(flight.maneuvers[-1].stop_s + 5.0, abs=1.5 / 200.0)


@pytest.mark.parametrize("rate", [0.0, -200.0, 300.0, 2000.0])
def test_rates_that_do_not_divide_are_refused(rate: float) -> None:
    with pytest.raises(UsageError, match="whole number"):
        quiet((), sample_rate_hz=rate)


def test_flight_beyond_the_limits_is_refused() -> None:
    with pytest.raises(UsageError, match="roll_command"):
        quiet((one_doublet(amplitude=1.5),))
    with pytest.raises(UsageError, match="thrust_command"):
        quiet((one_doublet("thrust", amplitude=0.6),))


def test_input_without_delay_is_refused() -> None:
    system = replace(VEHICLE.system, input_delays_s=np.array([0.04, 0.04, 0.0, 0.04]))
    with pytest.raises(UsageError, match="one step"):
        fly(replace(VEHICLE, system=system), (), rng=np.random.default_rng(0))


def test_vehicle_of_another_shape_is_refused() -> None:
    with pytest.raises(ModelError, match="4 inputs"):
        replace(VEHICLE, states=VEHICLE.states[1:])
    with pytest.raises(ModelError, match="states w"):
        replace(VEHICLE, states=tuple("heave" if name == "w" else name for name in VEHICLE.states))
    with pytest.raises(ModelError, match="delays at its outputs"):
        replace(VEHICLE, system=replace(VEHICLE.system, output_delays_s=np.full(12, 0.01)))
