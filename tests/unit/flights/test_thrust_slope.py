"""The slope of thrust over a sweep: how curved thrust is, how the mean command went, and what a fit makes of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, TimeHistory, Topic
from rotorid.data.response import FrequencyResponse
from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.flights.thrust_slope import curvature, with_slope_changes
from rotorid.models.library import rate_model
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import bounds
from rotorid.units import STANDARD_GRAVITY_M_S2

RATE_HZ, DURATION_S, HOVER = 100.0, 60.0, 0.5
TIME_S = np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)


def chirp(low: float, high: float) -> FloatArray:
    phase = low * DURATION_S / np.log(high / low) * ((high / low) ** (TIME_S / DURATION_S) - 1.0)
    return np.asarray(np.sin(phase))


def heave_log(exponent: float, *, noise: float = 0.0, load_factor: float = 1.0) -> FlightRecord:
    """Thrust by a power of the command, swept about hover or a turn; the specific force holds the mean."""
    command = HOVER + 0.05 * chirp(1.0, 30.0)
    rng = np.random.default_rng(3)
    az = -load_factor * STANDARD_GRAVITY_M_S2 * (command / HOVER) ** exponent + noise * rng.standard_normal(TIME_S.size)
    values = {"thrust_command": command, "az": az, "thrust_excitation": command - HOVER}
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS.get(name, "1")) for name in values)
    topic = Topic(name="all", time_s=TIME_S, channels=channels, values=np.stack(list(values.values())))
    return FlightRecord(source=Source(name="heave.csv", format="CSV", sha256="0"), topics=(topic,))


@pytest.mark.parametrize(("exponent", "factor"), [(1.0, 0.0), (1.3, 0.6), (2.0, 1.0)])
def test_heave_tells_how_curved_thrust_is(exponent: float, factor: float) -> None:
    assert curvature([heave_log(exponent)]) == pytest.approx(factor, abs=0.03)


def test_a_turn_shows_the_same_curve_as_hover() -> None:
    assert curvature([heave_log(1.3, load_factor=1.5)]) == pytest.approx(0.6, abs=0.03)


def test_without_an_answer_of_heave_nothing_is_known() -> None:
    assert curvature([heave_log(2.0, noise=50.0)]) == 0.6
    assert curvature([]) == 0.6


def measured(slope_changes: FloatArray | None, *, slope: FloatArray) -> FrequencyResponse:
    """The exact response of a rate with a lag, whose gain went with a slope over frequency."""
    omega = np.geomspace(2.0, 60.0, 60)
    s = 1j * omega
    values = np.exp(slope) * 250.0 * np.exp(-0.01 * s) / ((s + 0.5) * (1.0 + 0.02 * s))
    ones = np.ones((1, 1, omega.size))
    return FrequencyResponse(
        omega_rad_s=omega,
        values=values[None, None],
        coherence=0.999 * ones,
        random_error=0.002 * ones,
        covariance=np.diag((0.002 * np.abs(values)) ** 2)[None, None],
        inputs=("roll_command",),
        outputs=("p",),
        estimate="direct",
        slope_changes=slope_changes,
    )


def lag_and_deviation(response: FrequencyResponse) -> tuple[float, float]:
    model = rate_model("rate.roll")
    used = np.ones(response.values.shape, dtype=np.bool_)
    problem = FrequencyProblem(structure=model, parameters=model.parameters, data=response, used=used)
    solution = fit_frequency(problem)
    row = problem.parameters.free.index("T_motor")
    return float(solution.theta[row]), float(bounds(problem, solution).std[row])


def test_a_lag_that_a_changing_slope_has_bent_is_inside_its_deviation() -> None:
    slope = -0.02 * np.log(np.geomspace(2.0, 60.0, 60) / 10.0)
    blind, sure = lag_and_deviation(measured(None, slope=slope))
    lag, std = lag_and_deviation(measured(slope[None], slope=slope))
    assert lag == blind
    assert abs(lag - 0.02) > 2.0 * sure  # what nothing in the residuals shows
    assert abs(lag - 0.02) < 1.5 * std


def test_a_response_knows_the_slope_only_of_commands_beside_a_thrust() -> None:
    command = HOVER * (1.0 - 0.1 * TIME_S / DURATION_S)
    channels = tuple(Channel(name=name, unit="1") for name in ("roll_command", "thrust_command"))
    record = TimeHistory(values=[chirp(2.0, 60.0), command], channels=channels, sample_rate_hz=RATE_HZ, start_s=0.0)
    bent = curvature([heave_log(2.0)])
    plain = measured(None, slope=np.zeros(60))
    known = with_slope_changes(plain, [record], bent).slope_changes
    assert known is not None
    assert np.all(np.diff(known[0]) < 0.0)
    assert np.ptp(known[0]) == pytest.approx(0.085, abs=0.015)
    assert (
        with_slope_changes(plain, [replace(record, channels=(channels[0], replace(channels[1], name="x")))], bent)
        is plain
    )
    setpoints = replace(plain, inputs=("phi_setpoint",))
    asked = replace(record, channels=(replace(channels[0], name="phi_setpoint"), channels[1]))
    assert not np.any(with_slope_changes(setpoints, [asked], bent).slope_changes)


def test_slope_changes_have_the_shape_of_inputs_and_frequencies() -> None:
    with pytest.raises(ValueError, match="slope_changes"):
        measured(np.zeros((1, 3)), slope=np.zeros(60))
