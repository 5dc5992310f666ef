"""What was predicted before flights against what identifications of these flights state, and how far they scatter."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from tests.twins.twin_flights import LATERAL, record_of

from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.documents.result import result_document
from rotorid.excitation.plan import planned
from rotorid.excitation.sweep import pilot_sweep
from rotorid.flying.designs import expected_values
from rotorid.identifying.identification import identify
from rotorid.io.registry import read, write_log
from rotorid.models.library import RATE_AXES, library_model, rate_model
from rotorid.models.state_space import StateSpace
from rotorid.models.structure import LinearStructure
from rotorid.planning.aircraft import aircraft_loop
from rotorid.planning.expected import FitSettings
from rotorid.planning.loop import vehicle_loop
from rotorid.planning.prediction import Prediction, predict
from rotorid.results.model import IdentifiedModel
from rotorid.settings.identifying import IdentifySettings
from rotorid.simulation.hover_flight import Excitation, HoverVehicle, SensorNoise, fly
from rotorid.simulation.multirotor_flight import fly_multirotor
from rotorid.simulation.wind import Wind
from rotorid.typing import Axis, FloatArray
from rotorid.vehicles import catalog, s500

BAND = (2.0 * math.pi * 0.1, 2.0 * math.pi * 8.0)
BAR = 0.25
"""The bar of the issue: predicted against achieved."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """A plan for a vehicle, and how it is identified."""

    name: str
    model: str
    vehicle: HoverVehicle
    truth: Mapping[str, float]
    amplitudes: Mapping[Axis, float]
    count: int
    sweep_s: float
    band_rad_s: tuple[float, float] | None = None
    turbulence_m_s: float = 0.08
    noise: SensorNoise = field(default_factory=SensorNoise)
    held: Mapping[str, float] = field(default_factory=dict)
    flights: int = 100

    @property
    def structure(self) -> LinearStructure:
        structure = rate_model(self.model) if self.model in RATE_AXES else library_model(self.model)
        parameters = structure.parameters
        for name, value in self.held.items():
            parameters = parameters.fix(name, value)
        return replace(structure, parameters=parameters)

    @property
    def plan(self) -> FlightPlan:
        rng, start_s, parts = np.random.default_rng(0), 3.0, []
        for axis, amplitude in self.amplitudes.items():
            for _ in range(self.count):
                values = pilot_sweep(
                    amplitude=amplitude,
                    band_rad_s=BAND,
                    duration_s=self.sweep_s,
                    sample_rate_hz=1000.0,
                    fade_s=0.5,
                    trim_s=0.0,
                    noise_fraction=0.1,
                    rng=rng,
                )
                parts.append(
                    PlannedInput(
                        axis=axis,
                        shape="pilot_sweep",
                        start_s=start_s,
                        values=values,
                        sample_rate_hz=1000.0,
                        amplitude=amplitude,
                        band_rad_s=BAND,
                    )
                )
                start_s = parts[-1].stop_s + 3.0
        return FlightPlan(name=self.name, inputs=tuple(parts), trim_s=5.0)

    def predicted(self) -> Prediction:
        loop = vehicle_loop(self.vehicle, turbulence_m_s=self.turbulence_m_s, noise=self.noise)
        choices = FitSettings(band_rad_s=self.band_rad_s)
        return predict(self.structure, self.truth, loop, self.plan, choices=choices)

    def identified(self, seed: int) -> IdentifiedModel:
        parts = [
            Excitation(maneuver=one.maneuver, values=one.values, sample_rate_hz=one.sample_rate_hz)
            for one in self.plan.inputs
        ]
        rng = np.random.default_rng(seed)
        log = fly(self.vehicle, parts, turbulence_m_s=self.turbulence_m_s, noise=self.noise, rng=rng)
        kept = {name: values for name, values in log.columns.items() if not name.endswith("_setpoint")}
        settings = IdentifySettings(band_rad_s=self.band_rad_s, fix=dict(self.held))
        return identify([record_of(kept, log.sample_rate_hz, log.maneuvers)], self.model, settings=settings)


def uncoupled() -> HoverVehicle:
    """The S500 with rates that rate models describe: no coupling into roll and yaw, and motors that lag."""
    whole, rows = s500.vehicle(), {"p": -4.0, "r": -3.8}
    system, states = whole.system, len(whole.states)
    F, G = np.zeros((states + 2, states + 2)), np.zeros((states + 2, system.G.shape[1]))
    F[:states, :states], G[:states] = system.F, system.G
    for motor, (name, command, gain) in enumerate((("p", 0, TRUTH["L_roll"]), ("r", 2, TRUTH["N_yaw"])), start=states):
        row = whole.states.index(name)
        F[row], G[row] = 0.0, 0.0
        F[row, row], F[row, motor] = rows[name], gain
        F[motor, motor], G[motor, command] = -1.0 / TRUTH["T_motor"], 1.0 / TRUTH["T_motor"]
    G[whole.states.index("v"), 0] = 0.0
    seen = np.zeros((len(system.H0), 2))
    delays = system.input_delays_s.copy()
    delays[[0, 2]] = TRUTH["tau_roll"], TRUTH["tau_yaw"]
    return replace(
        whole,
        name="uncoupled S500",
        system=StateSpace(
            M=np.eye(states + 2),
            F=F,
            G=G,
            H0=np.hstack([system.H0, seen]),
            H1=np.hstack([system.H1, seen]),
            input_delays_s=delays,
            output_delays_s=system.output_delays_s,
        ),
        states=(*whole.states, "motor_roll", "motor_yaw"),
        controller=replace(whole.controller, rate_p=(0.08, 0.07, 0.09), lean_rad_per_m_s=0.1),
    )


TRUTH = {"L_roll": 80.0, "L_p": -4.0, "N_yaw": 31.1, "N_r": -3.8, "T_motor": 0.05, "tau_roll": 0.006, "tau_yaw": 0.01}
COUPLED = {**s500.TRUTH, "T_motor": 0.0}

CASES = (
    Case(
        name="roll, one sweep of 40 s",
        model="rate.roll",
        vehicle=uncoupled(),
        truth=TRUTH,
        amplitudes={"roll": 0.06},
        count=1,
        sweep_s=40.0,
    ),
    Case(
        name="roll, two sweeps of 60 s, a noisy gyroscope",
        model="rate.roll",
        vehicle=uncoupled(),
        truth=TRUTH,
        amplitudes={"roll": 0.06},
        count=2,
        sweep_s=60.0,
        noise=SensorNoise(gyro_rad_s=0.03),
    ),
    Case(
        name="yaw, one sweep of 40 s",
        model="rate.yaw",
        vehicle=uncoupled(),
        truth=TRUTH,
        amplitudes={"yaw": 0.1},
        count=1,
        sweep_s=40.0,
        band_rad_s=(1.0, 50.0),
        # Rotors of no inertia have no reaction to their spin-up, and no fit that keeps one has a bound to compare.
        held={"N_spin": 0.0},
    ),
    Case(
        name="roll, coupled as published",
        model="rate.roll",
        vehicle=s500.vehicle(),
        truth=COUPLED,
        amplitudes={"roll": 0.035},
        count=1,
        sweep_s=40.0,
        band_rad_s=(12.0, 50.0),
    ),
    Case(
        name="yaw, coupled as published",
        model="rate.yaw",
        vehicle=s500.vehicle(),
        truth=COUPLED,
        amplitudes={"yaw": 0.1},
        count=1,
        sweep_s=40.0,
        band_rad_s=(1.0, 50.0),
        # Rotors of no inertia have no reaction to their spin-up, and no fit that keeps one has a bound to compare.
        held={"N_spin": 0.0},
    ),
    Case(
        name="roll and yaw together",
        model="hover.lateral",
        vehicle=s500.vehicle(),
        truth=COUPLED,
        amplitudes={"roll": 0.035, "yaw": 0.1},
        count=2,
        sweep_s=50.0,
        held=LATERAL.held,
        flights=40,
    ),
)


def compared(case: Case, flights: int) -> tuple[Prediction, dict[str, FloatArray], dict[str, FloatArray]]:
    """The prediction, and what each flight gave: estimates and their stated errors."""
    found = case.predicted()
    results = [result_document(case.identified(seed)).parameters for seed in range(flights)]
    kept = [
        {name: (one.value, one.std_random) for name, one in result.items() if one.std_random is not None}
        for result in results
    ]
    names = [one.name for one in found.parameters]
    # What a flight drops that others keep would be compared with another model.
    alike = [one for one in kept if set(one) == set(names)]
    assert len(alike) >= 0.9 * flights
    estimates = {name: np.array([one[name][0] for one in alike]) for name in names}
    return found, estimates, {name: np.array([one[name][1] for one in alike]) for name in names}


@pytest.mark.parametrize(
    "case", [CASES[1], pytest.param(CASES[3], marks=pytest.mark.slow)], ids=lambda case: getattr(case, "name", None)
)
def test_a_few_flights_state_what_was_predicted(case: Case) -> None:
    found, estimates, stated = compared(case, 2)
    for one in found.parameters:
        assert one.std_random == pytest.approx(stated[one.name].mean(), rel=BAR)
        # Where the structure does not fit, the bias was predicted too.
        assert estimates[one.name].mean() == pytest.approx(one.expected, abs=4.0 * one.std_random)


def test_records_windows_and_points_are_those_of_the_identification() -> None:
    case = CASES[0]
    found, flown = case.predicted(), case.identified(0)
    np.testing.assert_allclose(found.response.windows_s, flown.data.response.windows_s)
    np.testing.assert_allclose(found.response.omega_rad_s, flown.data.response.omega_rad_s)
    assert np.count_nonzero(found.used != flown.data.used) <= 2
    used = found.used & flown.data.used
    # Of one flight a coherence scatters by a few hundredths where it is far from one.
    assert np.abs(found.response.coherence - flown.data.response.coherence)[used].mean() < 0.03
    ratio = found.response.random_error[used] / flown.data.response.random_error[used]
    assert np.median(ratio) == pytest.approx(1.0, abs=BAR)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_many_flights_achieve_what_was_predicted(case: Case) -> None:
    found, estimates, stated = compared(case, case.flights)
    for one in found.parameters:
        assert one.std_random == pytest.approx(stated[one.name].mean(), rel=BAR)
        scatter = float(estimates[one.name].std(ddof=1))
        assert estimates[one.name].mean() == pytest.approx(one.expected, abs=0.5 * one.std + scatter)
        if len(found.response.outputs) == 1:
            assert one.scatter == pytest.approx(scatter, rel=BAR)
        else:
            # Of several outputs, what noise leaks scatters too: less than what is stated, more than noise alone.
            chance = 3.0 / math.sqrt(2.0 * case.flights)
            assert (1.0 - BAR) * one.scatter / (1.0 + chance) < scatter
            assert scatter < (1.0 + BAR) * one.std * (1.0 + chance)


CRAFT, WIND = catalog.aircraft("px4_quad"), Wind(north_m_s=1.0, turbulence_m_s=0.3)


def swept_from_outside(duration_s: float) -> FlightPlan:
    """A sweep of the attitude set-point, as PX4 takes it from a companion computer."""
    one = planned(
        "roll",
        "pilot_sweep",
        start_s=4.0,
        amplitude=0.18,
        duration_s=duration_s,
        sample_rate_hz=250.0,
        band_rad_s=(1.0, 50.0),
        entry="attitude_setpoint",
        noise_fraction=0.1,
    )
    return FlightPlan(name="sweep", inputs=(one,), trim_s=4.0)


def of_px4(plan: FlightPlan) -> Prediction:
    structure = rate_model("rate.roll")
    return predict(structure, expected_values(structure, CRAFT), aircraft_loop(CRAFT, wind=WIND), plan)


def through_a_log(plan: FlightPlan, seed: int, folder: Path) -> IdentifiedModel:
    path = folder / f"{seed}.ulg"
    write_log(path, fly_multirotor(CRAFT, plan, wind=WIND, seed=seed), format="ulg")
    return identify([read(path)], "rate.roll")


@pytest.mark.slow
@pytest.mark.parametrize("duration_s", [30.0, 40.0, 60.0, 80.0, 120.0])
def test_sweeps_of_any_length_through_a_log_that_does_not_declare_them(duration_s: float, tmp_path: Path) -> None:
    """The lowest frequencies of a sweep decide how badly a rate model fits, and are those that a log shows."""
    plan = swept_from_outside(duration_s)
    found, flown = of_px4(plan), [through_a_log(plan, seed, tmp_path) for seed in range(5)]
    for each in flown:
        np.testing.assert_allclose(found.response.windows_s, each.data.response.windows_s, rtol=1e-3)
        np.testing.assert_allclose(found.response.omega_rad_s, each.data.response.omega_rad_s, rtol=1e-3)
    for one in found.parameters:
        stated = [result_document(each).parameters[one.name].std_random for each in flown]
        assert one.std_random == pytest.approx(np.mean(np.array(stated, dtype=np.float64)), rel=BAR)
