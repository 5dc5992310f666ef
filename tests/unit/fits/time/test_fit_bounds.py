"""What a fit in time states: of values that responses or nothing bounds, of records that scatter, of clocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.checking.response_flight import flight

from rotorid.data.record import Maneuver
from rotorid.errors import InsufficientDataError
from rotorid.fits.frequency.refusals import faster_than_sampled
from rotorid.fits.scatter import disagreements
from rotorid.fits.time.fit import TimeFit, TimeMethod, fit_in_time
from rotorid.fits.time.frequency_check import with_distance
from rotorid.fits.time.refusals import require_bounds
from rotorid.flights.flights import Flight
from rotorid.flights.segments import time_records
from rotorid.identifying.identification import identify
from rotorid.models.library import response_model
from rotorid.models.state_space import StateSpace
from rotorid.models.structure import LinearStructure
from rotorid.results.summary import Compared
from rotorid.settings.identifying import IdentifySettings
from rotorid.uncertainty.time_error import by_records

SECOND = "response.second_order_delay"
WHOLE = Maneuver(axis="roll", start_s=3.0, stop_s=32.9, kind="other")
LAGS = {"K_phi": 0.99, "omega_phi": 21.7, "zeta_phi": 2.0, "tau_phi": 0.03}
"""Two lags of 180 and 12 ms: the second one is shorter than the samples of a log at 20 Hz."""


@pytest.mark.parametrize("seed", [4, 6, 8, 11])
def test_where_responses_run_away_the_errors_in_time_are_its_own(seed: int) -> None:
    found = identify([flight(seed=seed, samples=520, noise=0.003, truth=LAGS, rate_hz=20.0)], SECOND)
    for name, one in found.parameters.items():
        assert one.std is not None
        assert abs(one.value - LAGS[name]) < 2.0 * one.std
        assert one.std < one.value
    assert "not_identifiable" not in {finding.kind for finding in found.findings}


@pytest.mark.parametrize("method", ["output_error", "prediction_error"])
def test_a_second_lag_that_is_none_is_refused(method: str) -> None:
    first = {"K_phi": 0.95, "T_phi": 0.25, "tau_phi": 0.06}
    log = flight(noise=0.002, form="response.first_order_delay", truth=first)
    with pytest.raises(InsufficientDataError, match="above the sample rate of 50 Hz") as refused:
        identify([log], SECOND, method=method)
    assert [finding.kind for finding in refused.value.findings] == ["impossible_physics"]
    assert "one order less" in str(refused.value)
    assert identify([log], "response.first_order_delay", method=method).parameters["T_phi"].value == pytest.approx(
        0.25, abs=0.01
    )


def test_the_output_that_is_of_lower_order_is_named() -> None:
    # phi has two slow lags; velocity_down has one, and a second one that no sample shows.
    system = StateSpace(
        M=np.eye(4),
        F=np.diag([-3.0, -4.0, -2.0, -5000.0]),
        G=np.ones((4, 1)),
        H0=np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0]]),
        H1=np.zeros((2, 4)),
        input_delays_s=np.zeros(1),
        output_delays_s=np.zeros(2),
    )
    (finding,) = faster_than_sampled("model", system, 25.0, ("phi", "velocity_down"))
    assert finding.message.startswith("The model of velocity_down has a pole at 5e+03 rad/s")
    assert finding.where == "model: velocity_down"
    (whole,) = faster_than_sampled("model", system, 25.0)
    assert whole.where == "model"
    assert not list(faster_than_sampled("model", system, 5000.0, ("phi", "velocity_down")))


def test_a_zero_and_a_pole_that_cancel_are_warned_of() -> None:
    log = flight(seed=3, noise=0.003, form="response.first_order", truth={"K_phi": 0.95, "T_phi": 0.25})
    found = identify([log], "response.second_order_zero", method="output_error")
    uncertain = {finding.where for finding in found.findings if finding.kind == "uncertain_parameter"}
    assert uncertain == {"omega_phi", "zeta_phi", "T_zero_phi"}
    gain = found.parameters["K_phi"]
    assert gain.std is not None
    assert abs(gain.value - 0.95) < 2.0 * gain.std < 0.1


@pytest.fixture(scope="module")
def fitted() -> TimeFit:
    """Of a second-order response."""
    structure = response_model(SECOND, [("phi_setpoint", "phi")])
    records = time_records(structure, [Flight(flight(), WHOLE)], IdentifySettings())
    return fit_in_time(structure, records, IdentifySettings(), method="output_error")


def with_deviation(fitted: TimeFit, name: str, times: float) -> TimeFit:
    """The same, with a parameter that is many times less certain than it is large, and than it would be alone."""
    bounds, row = fitted.bounds, fitted.bounds.names.index(name)
    std = times * abs(fitted.parameters[name].value)
    covariance, cramer_rao = bounds.covariance.copy(), bounds.cramer_rao.copy()
    covariance[row, row] = std**2
    cramer_rao[row] = 100.0 * bounds.insensitivity[row]
    return replace(fitted, bounds=replace(bounds, covariance=covariance, cramer_rao=cramer_rao))


def require(fitted: TimeFit, couplings: Sequence[str] = ()) -> None:
    require_bounds(fitted.parameters, fitted.bounds, couplings)


def test_a_value_that_others_take_over_is_refused(fitted: TimeFit) -> None:
    require(fitted)
    require(with_deviation(fitted, "zeta_phi", 9.0))
    require(with_deviation(fitted, "zeta_phi", 11.0), couplings=["zeta_phi"])
    with pytest.raises(InsufficientDataError, match="not enough data for zeta_phi") as refused:
        require(with_deviation(fitted, "zeta_phi", 11.0))
    (finding,) = refused.value.findings
    assert (finding.kind, finding.where) == ("not_identifiable", "zeta_phi")


def test_a_small_value_that_is_known_by_itself_is_not_without_bound(fitted: TimeFit) -> None:
    wide = with_deviation(fitted, "zeta_phi", 11.0)
    require(replace(wide, bounds=replace(wide.bounds, cramer_rao=2.0 * wide.bounds.insensitivity)))


FIRST = response_model("response.first_order_delay", [("phi_setpoint", "phi")])
LAGGED = {"K_phi": 0.95, "T_phi": 0.25, "tau_phi": 0.06}


def fit_of(gains: Sequence[float], structure: LinearStructure = FIRST) -> TimeFit:
    """Flights of a first order with delay, one for each gain."""
    flights = [
        Flight(
            flight(seed=seed, noise=0.002, form="response.first_order_delay", truth={**LAGGED, "K_phi": gain}), WHOLE
        )
        for seed, gain in enumerate(gains)
    ]
    records = time_records(structure, flights, IdentifySettings())
    return fit_in_time(structure, records, IdentifySettings(), method="output_error")


def test_flights_of_one_vehicle_agree_and_their_delay_is_known_to_two_clocks() -> None:
    found = fit_of([0.95, 0.95, 0.95])
    assert [log.record for log in found.alone] == [f"flight{seed}.csv at 3.0 s" for seed in range(3)]
    assert found.findings == ()
    stds = found.bounds.stds
    for name, truth in LAGGED.items():
        assert abs(found.parameters[name].value - truth) < 3.0 * stds[name]
    clocks_s = 0.15 * 2.0**0.5 / 50.0
    assert clocks_s < stds["tau_phi"] < 1.2 * clocks_s
    assert stds["K_phi"] < 0.01


def test_flights_of_two_vehicles_disagree_and_the_interval_holds_both() -> None:
    found = fit_of([0.85, 1.05])
    assert {finding.where for finding in found.findings if finding.kind == "logs_disagree"} == {"K_phi"}
    assert 0.08 < found.bounds.stds["K_phi"] < 0.3


def test_records_that_disagree_count_once() -> None:
    """Their scatter, or Student's factor with the deviation of their mean: the larger, not both."""
    found = fit_of([0.85, 0.95, 1.05])
    (disagreement,) = disagreements(found.alone)
    row = found.bounds.names.index("K_phi")
    by_scatter = found.bounds.random[row, row] + disagreement.scatter**2
    by_mean = by_records(found.bounds, found.alone)[row]
    assert by_mean > 0.5 * by_scatter
    assert found.bounds.stds["K_phi"] == pytest.approx(max(by_scatter, by_mean) ** 0.5, rel=0.01)


def test_a_structure_without_the_delay_has_a_model_error() -> None:
    found = fit_of([0.95], response_model("response.first_order", [("phi_setpoint", "phi")]))
    assert found.bounds.stds["T_phi"] > 2.0 * found.bounds.random_stds["T_phi"]


def test_equations_state_a_model_error_records_and_clocks_too() -> None:
    logs = [
        Flight(flight(seed=seed, noise=0.002, form="response.first_order_delay", truth=LAGGED), WHOLE)
        for seed in (0, 1)
    ]
    records = time_records(FIRST, logs, IdentifySettings())
    found = fit_in_time(FIRST, records, IdentifySettings(band_rad_s=(1.0, 12.0)), method="equation_error")
    assert (found.bounds.model_std >= 0.0).all()
    assert found.bounds.stds["tau_phi"] > 0.15 * 2.0**0.5 / 50.0
    assert [log.record for log in found.alone] == ["flight0.csv at 3.0 s", "flight1.csv at 3.0 s"]


def test_an_interval_reaches_to_responses_that_contradict_it() -> None:
    fitted = fit_of([0.95])
    value, std = fitted.parameters["T_phi"].value, fitted.bounds.stds["T_phi"]
    far, near = (with_distance(fitted, {"T_phi": Compared(value=value + off, std=std)}) for off in (10.0 * std, std))
    assert [finding.kind for finding in far.findings] == ["methods_disagree"]
    assert 1.96 * far.bounds.stds["T_phi"] > 10.0 * std
    assert (near.findings, near.bounds.stds) == ((), fitted.bounds.stds)


def test_a_delay_on_its_bound_is_known_to_two_clocks() -> None:
    """Outputs that come earlier than their inputs leave the delay at zero."""
    late = {"K_phi": 0.95, "omega_phi": 3.0, "zeta_phi": 0.9, "tau_phi": 0.0}
    log = flight(noise=0.002, truth=late)
    records = time_records(response_model(SECOND, [("phi_setpoint", "phi")]), [Flight(log, WHOLE)], IdentifySettings())
    early = tuple(replace(r, inputs=r.inputs[:, :-3], outputs=r.outputs[:, 3:]) for r in records.data)
    found = fit_in_time(
        response_model(SECOND, [("phi_setpoint", "phi")]),
        records._replace(data=early),
        IdentifySettings(),
        method="output_error",
    )
    assert found.parameters["tau_phi"].value == 0.0
    model = dict(zip(found.bounds.names, found.bounds.model_std.tolist(), strict=True))
    assert model["tau_phi"] == pytest.approx(0.15 * 2.0**0.5 / 50.0, rel=0.01)
    assert min(model.values()) > 0.0


@pytest.mark.parametrize("method", ["output_error", "prediction_error", "equation_error"])
def test_no_gain_is_better_than_the_scales_of_two_sensors(method: TimeMethod) -> None:
    log = flight(noise=2e-4, form="response.first_order_delay", truth=LAGGED)
    records = time_records(FIRST, [Flight(log, WHOLE)], IdentifySettings())
    found = fit_in_time(FIRST, records, IdentifySettings(), method=method)
    model = dict(zip(found.bounds.names, found.bounds.model_std.tolist(), strict=True))
    assert model["K_phi"] > 0.99 * 0.0025 * 2.0**0.5 * abs(found.parameters["K_phi"].value)
