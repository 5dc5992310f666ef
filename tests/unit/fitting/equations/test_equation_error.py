"""Equation error of whole structures: where states come from, which equations records answer, what is left over."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.fitting.equations.equation_error import EquationErrorFit, fit_equation_error, stepwise_equation
from rotorid.fitting.equations.regression import CONSTANT, InBand, InTime
from rotorid.fitting.equations.rows import EquationDomain, EquationRows
from rotorid.fitting.frequency.parameter_map import ParameterMap
from rotorid.fitting.time.output_error import TimeData
from rotorid.models.equations import structure_from_equations
from rotorid.models.library import response_model
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.simulation.linear import Hold, simulate_linear
from rotorid.typing import FloatArray

RATE_HZ, DURATION_S = 200.0, 40.0
HIGH_RAD_S = 15.0
BAND = InBand(band_rad_s=(0.6, HIGH_RAD_S))
TRUTH = {"M_q": -3.0, "M_theta": -16.0, "M_pitch": 40.0, "X_u": -0.4, "X_pitch": -7.0, "tau": 0.0137}
STRAIGHT = (HIGH_RAD_S / RATE_HZ) ** 2 / 12.0
"""What transforms of states lose that are taken to go straight between samples; those of the inputs do."""


def structure(outputs: tuple[str, ...], lag: str = "") -> LinearStructure:
    """A sprung pitch axis that pulls the vehicle along, its command behind a lag or not."""
    units = {"M_q": "1/s", "M_theta": "1/s^2", "M_pitch": "rad/s^2", "X_u": "1/s", "X_pitch": "m/s^2", "tau": "s"}
    parameters = [
        Parameter(name=name, value=0.02 if name == "tau" else 1.0, unit=unit, lower=0.0 if name == "tau" else -np.inf)
        for name, unit in units.items()
    ]
    if lag:
        parameters.append(Parameter(name="T_motor", value=0.05, unit="s", lower=0.0))
    acting = "motor" if lag else "pitch_command"
    return structure_from_equations(
        name="sprung pitch",
        inputs=["pitch_command"],
        states=["q", "theta", "u", *(["motor"] if lag else [])],
        equations=[
            f"q' = M_q*q + M_theta*theta + M_pitch*{acting}",
            "theta' = q",
            f"u' = X_u*u - g*theta + X_pitch*{acting}",
            *(["T_motor*motor' = -motor + pitch_command"] if lag else []),
        ],
        outputs=list(outputs),
        delays={"pitch_command": "tau"},
        constants={"g": 9.80665},
        parameters=ParameterSet(parameters),
    )


ALL = ("q", "theta", "u", "ax = u' + g*theta")


def command(seed: int, rate_hz: float) -> FloatArray:
    time_s = np.arange(0.0, DURATION_S, 1.0 / rate_hz)
    rng = np.random.default_rng(seed)
    omega = np.linspace(0.7, 14.0, 12)
    return np.asarray(0.1 * np.sin(np.outer(time_s, omega) + rng.uniform(0.0, 6.0, 12)).sum(axis=1))[None]


def fly(
    model: LinearStructure, *, records: int = 2, rate_hz: float = RATE_HZ, noise: float = 0.0, hold: Hold = "first"
) -> tuple[TimeData, ...]:
    truth = {name: TRUTH[name] for name in model.parameters.names if name in TRUTH}
    system = model.matrices(model.parameters.with_values(truth).values)
    flown = []
    for seed in range(records):
        u = command(seed, rate_hz)
        x0 = np.random.default_rng(seed).normal(size=len(model.states)) * 0.1
        y = simulate_linear(system, u, sample_rate_hz=rate_hz, x0=x0, before=u[:, 0], hold=hold)
        y = y + noise * y.std(axis=1, keepdims=True) * np.random.default_rng(100 + seed).normal(size=y.shape) + 0.01
        flown.append(TimeData(name=f"flight {seed}", inputs=u, outputs=y, sample_rate_hz=rate_hz))
    return tuple(flown)


def worst(fit: EquationErrorFit) -> float:
    """Largest relative error, delays in samples."""
    values = fit.parameters.values
    scale = {name: 1.0 / RATE_HZ if name == "tau" else abs(TRUTH[name]) for name in fit.names}
    return max(abs(values[name] - TRUTH[name]) / scale[name] for name in fit.names)


@pytest.mark.parametrize("outputs", [ALL, ALL[:3], ("theta", "u"), ("q", "theta", ALL[3])], ids=len)
def test_every_parameter_is_found_from_whatever_shows_the_states(outputs: tuple[str, ...]) -> None:
    model = structure(outputs)
    fit = fit_equation_error(model, model.parameters, fly(model), domain=BAND)
    assert set(fit.names) == set(TRUTH)
    assert fit.left == ()
    assert worst(fit) < 30.0 * STRAIGHT
    assert min(equation.r_squared for equation in fit.equations) > 0.999


def test_what_is_left_of_the_error_is_that_of_straight_lines_between_samples() -> None:
    model = structure(ALL)
    errors = [
        worst(fit_equation_error(model, model.parameters, fly(model, rate_hz=rate), domain=BAND))
        for rate in (100.0, 200.0)
    ]
    # Of second order in the step: a quarter, and the smaller end terms.
    assert errors[1] < 0.35 * errors[0]


def test_where_states_come_from() -> None:
    plans = {
        ALL[:3]: {"measured"},
        ("theta", "u"): {"measured", "differentiated"},
        ("q", "u"): {"measured", "integrated"},
        ("q", "theta", ALL[3]): {"measured", "integrated_output"},
    }
    for outputs, origins in plans.items():
        model = structure(outputs)
        rows = EquationRows(ParameterMap(model, model.parameters), fly(model, records=1), BAND, "first")
        assert {source.origin for source in rows.plan.sources} == origins
        assert rows.plan.known.all()


def test_an_accelerometer_is_an_equation_beside_that_of_its_speed() -> None:
    model = structure(ALL)
    fit = fit_equation_error(model, model.parameters, fly(model), domain=BAND)
    assert [equation.name for equation in fit.equations] == ["q'", "u'", "ax"]


def test_a_lag_that_no_sensor_shows_stays_and_is_named() -> None:
    model = structure(ALL, lag="motor")
    fit = fit_equation_error(model, model.parameters, fly(model), domain=BAND)
    assert fit.left == ("T_motor",)
    assert fit.parameters["T_motor"].value == model.parameters["T_motor"].value
    assert [finding.where for finding in fit.findings if finding.kind == "not_in_measured_equations"] == ["T_motor"]
    # It was flown with that value, so the rest is right.
    assert worst(fit) < 30.0 * STRAIGHT


def test_a_state_that_nothing_shows_leaves_its_equations_out() -> None:
    model = structure(("q", "theta"))
    fit = fit_equation_error(model, model.parameters, fly(model), domain=BAND)
    assert fit.left == ("X_u", "X_pitch")
    assert {finding.where for finding in fit.findings if finding.kind == "not_in_measured_equations"} == set(fit.left)
    lone = structure(("u",))
    with pytest.raises(InsufficientDataError, match="output error"):
        fit_equation_error(lone, lone.parameters, fly(lone), domain=BAND)


def test_a_tie_is_kept_across_equations() -> None:
    model = structure(ALL)
    parameters = model.parameters.tie("X_pitch", "-0.175*M_pitch")
    fit = fit_equation_error(model, parameters, fly(model), domain=BAND)
    assert "X_pitch" not in fit.names
    assert fit.parameters["X_pitch"].value == pytest.approx(-0.175 * fit.parameters["M_pitch"].value)
    assert worst(fit) < 30.0 * STRAIGHT


def test_fixed_parameters_and_delays_stay() -> None:
    model = structure(ALL)
    parameters = model.parameters.fix("M_theta", TRUTH["M_theta"]).with_values({"tau": TRUTH["tau"]})
    fit = fit_equation_error(model, parameters, fly(model), domain=BAND, search_delays=False)
    assert fit.left == ("tau",)
    assert fit.parameters["tau"].value == TRUTH["tau"]
    assert worst(fit) < 30.0 * STRAIGHT


def test_a_held_command_acts_half_a_sample_later_than_a_straight_one() -> None:
    model = structure(ALL)
    records = fly(model, hold="zero")
    delays_s = [
        fit_equation_error(model, model.parameters, records, domain=BAND, hold=hold).parameters["tau"].value
        for hold in ("zero", "first")
    ]
    assert delays_s[0] == pytest.approx(TRUTH["tau"], abs=0.02 / RATE_HZ)
    assert delays_s[1] - delays_s[0] == pytest.approx(0.5 / RATE_HZ, abs=0.02 / RATE_HZ)


def test_products_of_parameters_are_found_too() -> None:
    model = response_model("response.second_order_delay", [("phi_setpoint", "phi")])
    truth = {"K_phi": 0.95, "omega_phi": 7.0, "zeta_phi": 0.7, "tau_phi": 0.083}
    system = model.matrices(truth)
    u = command(0, RATE_HZ)
    y = simulate_linear(system, u, sample_rate_hz=RATE_HZ, before=u[:, 0], hold="first")
    record = TimeData(name="twin", inputs=u, outputs=y, sample_rate_hz=RATE_HZ)
    fit = fit_equation_error(model, model.parameters, [record], domain=BAND)
    for name, value in truth.items():
        assert fit.parameters[name].value == pytest.approx(value, rel=1e-2)


def test_parameters_that_cannot_be_told_apart_are_named() -> None:
    model = structure(ALL)
    records = [
        TimeData(
            name="one tone",
            inputs=r.inputs * 0.0,
            outputs=np.tile(np.sin(np.arange(8000) / 50.0), (4, 1)),
            sample_rate_hz=RATE_HZ,
        )
        for r in fly(model, records=1)
    ]
    with pytest.raises(InsufficientDataError, match="M_q"):
        fit_equation_error(model, model.parameters, records, domain=InTime(), search_delays=False)


@pytest.mark.parametrize("domain", [BAND, InTime(smoothing_s=0.025)], ids=["band", "time"])
def test_stepwise_finds_the_terms_of_an_equation(domain: EquationDomain) -> None:
    model = structure(ALL)
    parameters = model.parameters.with_values({"tau": TRUTH["tau"]})
    found = stepwise_equation(model, parameters, "q", fly(model, noise=0.001), domain=domain)
    assert {"q", "theta", "pitch_command", CONSTANT} <= set(found.regression.names)
    assert found.steps[-1].r_squared > 0.99
    # Gravity is known and stands on the left.
    along = stepwise_equation(model, parameters, "ax", fly(model, noise=0.001), domain=domain)
    estimates = dict(zip(along.regression.names, along.regression.estimates.tolist(), strict=True))
    assert estimates["pitch_command"] == pytest.approx(TRUTH["X_pitch"], rel=0.02)
    assert abs(estimates.get("theta", 0.0)) < 0.2


def test_wrong_use_is_refused() -> None:
    model = structure(ALL)
    records = fly(model, records=1)
    with pytest.raises(UsageError, match="theta"):
        stepwise_equation(model, model.parameters, "theta", records, domain=BAND)
    with pytest.raises(ModelError, match="pitch_command"):
        stepwise_equation(model, model.parameters, "q", records, candidates=["pitch_comand"], domain=BAND)
