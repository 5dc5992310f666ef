"""How much faster equations of flight are integrated than by ``solve_ivp`` and by NumPy, and flights in a second.

A quadrotor of 13 states and four rotors with lag, drag, inflow and gyroscopic moments flies for 60 s on motor outputs
that change 250 times a second. The peer's right-hand side is written in NumPy, as one writes it, and ``solve_ivp`` is
started anew at each change: cheaper and by orders more exact than one call over all of them. It flies at the loosest
tolerance with which its error is not above ours, and is then far more exact. A second peer takes ours' steps by Runge
and Kutta in NumPy, at ours' error. Errors are against the same equations in steps sixteen times as short.
Process time is compared. Run ``python -m benchmarks.flight``.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
from scipy.integrate import solve_ivp

from rotorid.models import library_layout
from rotorid.simulation import (
    STATES,
    Aircraft,
    Autopilot,
    Guidance,
    Multirotor,
    RateLoop,
    Rotors,
    Sortie,
    Wind,
    columns,
    fly_batch,
)
from rotorid.simulation.flight_kernels import glide
from rotorid.typing import FloatArray

DURATION_S, RATE_HZ, REPEATS = 60.0, 250.0, 9
PEER_S = 6.0
"""The peer flies a tenth of it, and its time is multiplied: it costs the same at every change of the inputs."""
TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11)
RATIO_BAR, BATCH_BAR = 500.0, 5000.0
FLIGHTS, BATCHES = 20, 5


def vehicle() -> Multirotor:
    """Its rotors are level with the center of gravity, so that it flies for a minute with nobody at the controls."""
    rotors = Rotors(
        layout=library_layout("quad.x").scaled(0.25),
        thrust=(0.0, 0.5, 9.0),
        torque_per_thrust_m=0.02,
        lag_up_s=0.04,
        lag_down_s=0.05,
        induced_drag_n_s_m=0.08,
        inflow_n_s_m=0.1,
        inertia_kg_m2=2e-5,
        full_speed_rad_s=900.0,
    )
    return Multirotor(name="quadrotor", mass_kg=1.2, inertia_kg_m2=np.diag([0.012, 0.013, 0.02]), rotors=rotors)


def outputs() -> FloatArray:
    """Outputs to the motors, shape ``(ticks, 4)``: hover and a random walk of steps around it."""
    ticks = round(DURATION_S * RATE_HZ)
    steps = np.repeat(np.random.default_rng(0).choice([-0.01, 0.01], (ticks // 10, 4)), 10, axis=0)
    return np.asarray(vehicle().hover_shares + steps)


def ours(inputs: FloatArray, *, pieces: int = 1) -> FloatArray:
    """States at the ticks, in steps of a tick or of a part of it."""
    held = np.repeat(inputs, pieces, axis=0)
    calm = np.zeros((len(held), 3))
    states = glide(vehicle().hovering(), held, calm, 1.0, vehicle().body(), 1.0 / RATE_HZ / pieces)
    return np.asarray(states[::pieces])


def right_hand_side() -> Callable[[float, FloatArray, FloatArray], FloatArray]:
    """The equations as one writes them in NumPy."""
    craft = vehicle()
    rotors, inertia = craft.rotors, craft.inertia_kg_m2
    inverse, hubs = np.linalg.inv(inertia), craft.hubs_m
    spins = rotors.layout.spins
    momentum = rotors.inertia_kg_m2 * rotors.full_speed_rad_s * spins
    gravity = np.array([0.0, 0.0, 9.80665])
    down_s = rotors.lag_down_s or rotors.lag_up_s

    def slope(_: float, state: FloatArray, output: FloatArray) -> FloatArray:
        w, x, y, z = state[6:10]
        rates, speeds = state[10:13], state[STATES:]
        turn = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        velocity = turn.T @ state[3:6] + np.cross(rates, hubs)
        gap = output - speeds
        changing = np.where(gap > 0.0, gap / rotors.lag_up_s, gap / down_s)
        lift = rotors.thrust[1] * speeds + rotors.thrust[2] * speeds**2
        force = -rotors.induced_drag_n_s_m * speeds[:, None] * velocity
        force[:, 2] = -lift - rotors.inflow_n_s_m * speeds * velocity[:, 2]
        moment = np.cross(hubs, force).sum(axis=0)
        moment[2] += spins @ (rotors.torque_per_thrust_m * lift) + momentum @ changing
        own = inertia @ rates + np.array([0.0, 0.0, -momentum @ speeds])
        p, q, r = rates
        motor_speed = 0.5 * np.array(
            [-x * p - y * q - z * r, w * p + y * r - z * q, w * q + z * p - x * r, w * r + x * q - y * p]
        )
        return np.concatenate(
            [
                state[3:6],
                turn @ force.sum(axis=0) / craft.mass_kg + gravity,
                motor_speed,
                inverse @ (moment - np.cross(rates, own)),
                changing,
            ]
        )

    return slope


def theirs(inputs: FloatArray, tolerance: float) -> FloatArray:
    """States at the ticks by the peer, which begins anew at each."""
    slope = right_hand_side()
    states = [vehicle().hovering()]
    for output in inputs:
        found = solve_ivp(
            slope, (0.0, 1.0 / RATE_HZ), states[-1], args=(output,), rtol=tolerance, atol=1e-3 * tolerance
        )
        states.append(found.y[:, -1])
    return np.stack(states)


def numpy_steps(inputs: FloatArray) -> FloatArray:
    """States at the ticks by Runge and Kutta of order four, a step a tick, as one writes it in NumPy."""
    slope, h = right_hand_side(), 1.0 / RATE_HZ
    states = [vehicle().hovering()]
    for output in inputs:
        now = states[-1]
        one = slope(0.0, now, output)
        two = slope(0.0, now + 0.5 * h * one, output)
        three = slope(0.0, now + 0.5 * h * two, output)
        four = slope(0.0, now + h * three, output)
        later = now + h / 6.0 * (one + 2.0 * (two + three) + four)
        later[6:10] /= np.linalg.norm(later[6:10])
        states.append(later)
    return np.stack(states)


def run() -> dict[str, float]:
    """Process times of 60 s, errors of the rates in rad/s over the first seconds, and the peer's tolerance."""
    inputs = outputs()
    ours(inputs[:2])
    timed = _median(lambda: ours(inputs), REPEATS)
    short = inputs[: round(PEER_S * RATE_HZ)]
    exact = ours(short, pieces=16)
    own_error = _error(ours(short), exact)
    began = time.process_time()
    steps = numpy_steps(short)
    spent = (time.process_time() - began) * DURATION_S / PEER_S
    result = {"rotorid_s": timed, "rotorid_error": own_error, "numpy_s": spent, "numpy_error": _error(steps, exact)}
    for tolerance in TOLERANCES:
        began = time.process_time()
        states = theirs(short, tolerance)
        spent = (time.process_time() - began) * DURATION_S / PEER_S
        error = _error(states, exact)
        result |= {"solve_ivp_s": spent, "solve_ivp_error": error, "tolerance": tolerance}
        if error <= own_error:
            break
    return result


def batch(*, workers: int = 1) -> dict[str, float]:
    """Simulated seconds per second of process time: equations alone, whole flights with noise and turbulence."""
    inputs = outputs()
    alone = DURATION_S / _median(lambda: ours(inputs), REPEATS)
    gains = RateLoop(proportional=(0.1, 0.1, 0.2), integral=(0.1, 0.1, 0.1), derivative=(0.002, 0.002, 0.0))
    holding = Guidance(hold_velocity=True, velocity_p_1_s=1.0, hold_height=True, climb_p=0.15, climb_i=0.1)
    autopilot = Autopilot(kind="simple", rate_hz=RATE_HZ, rates=gains, angle_1_s=(4.0, 4.0, 2.0), guidance=holding)
    aircraft = Aircraft(vehicle=vehicle(), autopilot=autopilot)

    def flights(count: int) -> Iterator[Sortie]:
        for _ in range(count):
            yield Sortie(aircraft=aircraft, duration_s=DURATION_S, wind=Wind(north_m_s=3.0, turbulence_m_s=0.5))

    def fly(count: int) -> None:
        for one in fly_batch(flights(count), columns("p", "roll_command"), workers=workers, settle_s=0.0):
            assert np.abs(one.result["p"]).max() < 1.0

    fly(1)
    whole = _median(lambda: fly(FLIGHTS), BATCHES)
    return {"equations alone": alone, "whole flights": FLIGHTS * DURATION_S / whole}


def _error(states: FloatArray, exact: FloatArray) -> float:
    return float(np.abs(states - exact)[:, 10:13].max())


def _median(job: Callable[[], object], repeats: int) -> float:
    times = []
    for _ in range(repeats):
        began = time.process_time()
        job()
        times.append(time.process_time() - began)
    return float(np.median(times))


if __name__ == "__main__":
    found = run()
    print(f"60 s in {found['rotorid_s']:.4f} s with an error of {found['rotorid_error']:.1e} rad/s")
    print(
        f"solve_ivp at {found['tolerance']:.0e}: {found['solve_ivp_s']:.1f} s, {found['solve_ivp_error']:.1e} rad/s: "
        f"{found['solve_ivp_s'] / found['rotorid_s']:.0f} | {RATIO_BAR:.0f}"
    )
    print(
        f"Runge and Kutta in NumPy, steps as ours: {found['numpy_s']:.1f} s, {found['numpy_error']:.1e} rad/s: "
        f"{found['numpy_s'] / found['rotorid_s']:.0f}"
    )
    for what, rate in batch().items():
        print(f"simulated seconds per core-second, {what}: {rate:.0f} | {BATCH_BAR:.0f}")
