"""A quadrotor with everything that the simulator knows, and autopilots that hold it; numbers of a 1.2 kg frame."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from rotorid.autopilots.thrust import Linearization
from rotorid.models.rotors import RotorLayout, library_layout
from rotorid.simulation.autopilot import Autopilot, Guidance, RateLoop
from rotorid.simulation.multirotor import Multirotor, Rotors
from rotorid.typing import FloatArray

HOLDING = Guidance(
    velocity_p_1_s=1.0,
    velocity_i_1_s2=0.3,
    position_p_1_s=0.3,
    climb_p=0.15,
    climb_i=0.1,
    height_p_1_s=0.5,
    hold_velocity=True,
    hold_height=True,
    tilt_compensation=True,
)


def layout() -> RotorLayout:
    """A cross of 0.25 m, its rotors 3 cm above the center."""
    flat = library_layout("quad.x").scaled(0.25)
    return replace(flat, positions=flat.positions + np.array([0.0, 0.0, -0.03]))


def rotors(**changes: object) -> Rotors:
    """Rotors with both lags, a bent thrust curve, drag, inflow and angular momentum."""
    given: dict[str, object] = {
        "layout": layout(),
        "thrust": (0.0, 0.5, 9.0),
        "torque_per_thrust_m": 0.02,
        "lag_up_s": 0.04,
        "induced_drag_n_s_m": 0.08,
        "inflow_n_s_m": 0.1,
        "inertia_kg_m2": 2e-5,
        "full_speed_rad_s": 900.0,
    }
    return Rotors(**(given | changes))  # type: ignore[arg-type]


def vehicle(**changes: object) -> Multirotor:
    """The quadrotor; its center of gravity is off the center."""
    given: dict[str, object] = {
        "name": "craft",
        "mass_kg": 1.2,
        "inertia_kg_m2": (0.012, 0.013, 0.02),
        "rotors": rotors(),
        "center_of_gravity_m": (0.004, -0.003, 0.01),
    }
    return Multirotor(**(given | changes))  # type: ignore[arg-type]


def autopilot(kind: Literal["px4", "ardupilot", "simple"] = "px4", **changes: object) -> Autopilot:
    """A cascade in one manner or the other, with every filter that it has."""
    its = kind == "ardupilot"
    gains = RateLoop(
        proportional=(0.12, 0.13, 0.25),
        integral=(0.15, 0.15, 0.1),
        derivative=(0.003, 0.003, 0.0),
        feedforward=(0.0, 0.0, 0.02),
        derivative_of_error=its,
        derivative_cutoff_hz=(20.0, 20.0, 0.0),
        error_cutoff_hz=(0.0, 0.0, 5.0 if its else 0.0),
        target_cutoff_hz=(20.0, 20.0, 20.0) if its else (0.0, 0.0, 0.0),
        command_cutoff_hz=(0.0, 0.0, 10.0),
    )
    given: dict[str, object] = {
        "kind": kind,
        "rate_hz": 400.0,
        "rates": gains,
        "angle_1_s": (4.5, 4.5, 2.0),
        "guidance": HOLDING,
        "gyro_cutoff_hz": 40.0,
        "delay_s": (0.005, 0.005, 0.005, 0.01),
        "linearization": Linearization(expo=0.65, low=0.1, high=0.95),
    }
    return Autopilot(**(given | changes))  # type: ignore[arg-type]


def outputs_for(autopilot: Autopilot, vehicle: Multirotor, commands: FloatArray) -> FloatArray:
    """Outputs to the motors that commands ask for, where no limit is reached."""
    return autopilot.linearization.outputs(autopilot.mixer_for(vehicle) @ commands)


def idle(**changes: object) -> Autopilot:
    """An autopilot that does nothing but pass commands on: outputs are what is injected over hover."""
    nothing = (0.0, 0.0, 0.0)
    given: dict[str, object] = {
        "kind": "simple",
        "rate_hz": 250.0,
        "rates": RateLoop(proportional=nothing),
        "angle_1_s": nothing,
    }
    return Autopilot(**(given | changes))  # type: ignore[arg-type]
