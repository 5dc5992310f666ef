"""Whatever flies in a stable loop is never taken for the inverse of its controller."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from rotorid.fitting.inverse_controller import inverse_controller
from rotorid.models.controller import RateController
from rotorid.models.library import RATE_AXES, rate_model
from rotorid.models.state_space import StateSpace
from rotorid.typing import ComplexArray, FloatArray
from rotorid.vehicles import s500

WIDE = np.geomspace(0.3, 600.0, 500)
LARGEST_SENSITIVITY = 2.5


def powers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(np.log10(low), np.log10(high)).map(lambda exponent: float(10.0**exponent))


CONTROLLERS = st.builds(
    RateController,
    proportional_s=st.just(1.0),
    integral=st.floats(0.0, 8.0),
    derivative_s2=st.floats(0.0, 0.04),
    angle_1_s=st.one_of(st.just(0.0), st.floats(1.0, 8.0)),
    derivative_of_error=st.booleans(),
    derivative_cutoff_hz=st.floats(15.0, 80.0),
    error_cutoff_hz=st.one_of(st.just(0.0), st.floats(2.5, 20.0)),
)


@st.composite
def vehicles(draw: st.DrawFn) -> tuple[str, dict[str, float]]:
    """A rate model with values that multirotors have."""
    name = draw(st.sampled_from(sorted(RATE_AXES)))
    axis = RATE_AXES[name]
    sign = -1.0 if name == "rate.vertical" else 1.0
    gain, lag_s = draw(powers(3.0, 1000.0)), draw(st.one_of(st.just(0.0), powers(0.005, 0.15)))
    # Angular momentum of a rotor over twice its torque; without a lag rotors take no time to spin up.
    lead_s = draw(st.one_of(st.just(0.0), powers(0.05, 0.3))) if lag_s else 0.0
    return name, {
        axis.gain: sign * gain,
        axis.damping: -draw(powers(0.1, 20.0)),
        "T_motor": lag_s,
        axis.delay: draw(powers(0.002, 0.05)),
        **({"N_spin": gain * lead_s} if name == "rate.yaw" else {}),
    }


def response(name: str, values: dict[str, float], omega_rad_s: FloatArray) -> ComplexArray:
    """Rate, or acceleration upward, over command."""
    sign = -1.0 if name == "rate.vertical" else 1.0
    return sign * rate_model(name).response(values, omega_rad_s)[0, 0]


def scaled(controller: RateController, factor: float) -> RateController:
    return replace(
        controller,
        proportional_s=factor * controller.proportional_s,
        integral=factor * controller.integral,
        derivative_s2=factor * controller.derivative_s2,
    )


def flies(loop: ComplexArray) -> bool:
    """Whether the loop crosses one once, before −180°, and with a usual margin everywhere."""
    phase = np.unwrap(np.angle(loop))
    # An integrating loop with an integrator and an angle loop starts between −90° and −360°.
    phase -= 2.0 * np.pi * np.ceil(phase[0] / (2.0 * np.pi))
    crossings = np.flatnonzero(np.diff(np.abs(loop) > 1.0))
    return (
        crossings.size == 1
        and bool(phase[crossings[0]] > -np.pi)
        and float(np.abs(1.0 + loop).min()) > 1.0 / LARGEST_SENSITIVITY
    )


@given(
    vehicle=vehicles().filter(lambda item: item[0] != "rate.vertical"),
    controller=CONTROLLERS,
    crossover_rad_s=powers(2.0, 60.0),
    low_rad_s=powers(0.5, 30.0),
    ratio=st.floats(2.1, 12.0),
)
@settings(max_examples=60, deadline=None)
def test_a_vehicle_in_its_own_loop_is_never_its_controller(
    vehicle: tuple[str, dict[str, float]],
    controller: RateController,
    crossover_rad_s: float,
    low_rad_s: float,
    ratio: float,
) -> None:
    loop = response(*vehicle, WIDE) * controller.response(WIDE)
    at_crossover = float(np.interp(crossover_rad_s, WIDE, np.abs(loop)))
    assume(flies(loop / at_crossover))
    omega = np.geomspace(low_rad_s, low_rad_s * ratio, 30)
    flown = scaled(controller, 1.0 / at_crossover)
    result = inverse_controller(
        omega, response(*vehicle, omega), np.ones(omega.size), controllers=(flown, flown.rate_loop)
    )
    assert not result.inverse.any()
    assert min(band.cost for band in result.bands) > 100.0


@given(vehicle=vehicles(), low_rad_s=powers(0.5, 20.0), ratio=st.floats(4.1, 12.0))
@settings(max_examples=60, deadline=None)
def test_no_rate_model_has_the_shape_of_an_inverse_controller(
    vehicle: tuple[str, dict[str, float]], low_rad_s: float, ratio: float
) -> None:
    omega = np.geomspace(low_rad_s, low_rad_s * ratio, 30)
    result = inverse_controller(omega, response(*vehicle, omega), np.ones(omega.size))
    assert not result.inverse.any()


def test_the_unstable_hover_of_a_real_vehicle_has_not_either() -> None:
    omega = np.geomspace(1.5, 40.0, 80)
    models: tuple[tuple[StateSpace, int, int, float], ...] = (
        (s500.longitudinal(), 0, 0, 1.0),
        (s500.longitudinal(), 5, 1, -1.0),
        (s500.lateral(), 0, 0, 1.0),
        (s500.lateral(), 1, 1, 1.0),
    )
    for model, output, column, sign in models:
        values = sign * model.response(omega)[output, column]
        assert not inverse_controller(omega, values, np.ones(omega.size)).inverse.any()
