"""What equation error promises on flights: the S500 out of its closed-loop sweeps, near enough to start from."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from tests.reference.s500_records import record_of

from rotorid.fitting.equations.equation_error import EquationErrorFit, fit_equation_error, stepwise_equation
from rotorid.fitting.equations.regression import CONSTANT, InBand, InTime
from rotorid.fitting.time.output_error import TimeData
from rotorid.models.library import library_model
from rotorid.models.structure import LinearStructure

BAND = InBand(band_rad_s=(0.6, 20.0))
MANY = 5000
"""Samples of each record that are enough to compare domains: twenty-five seconds."""

CONTROL_WITHIN, SPEED_WITHIN, WITHIN, SIGMAS, DELAY_WITHIN_S = 0.02, 0.04, 0.08, 3.0, 1e-3
"""What the fit of the same flights in the frequency domain has to reach."""
MOTIONS = {
    "longitudinal": (("pitch_sweeps", "thrust_sweeps"), ("q", "u", "w", "theta", "ax", "az")),
    "lateral": (("roll_sweeps", "yaw_sweeps"), ("p", "r", "v", "phi", "ay")),
}


class Flight(NamedTuple):
    """Sweeps of one motion, its model at the library's own start, and the truth."""

    structure: LinearStructure
    records: tuple[TimeData, ...]
    truth: Mapping[str, float]


@pytest.fixture(scope="module", params=MOTIONS)
def flight(request: pytest.FixtureRequest, shared_data: Path) -> Flight:
    folder = shared_data / "s500"
    files, outputs = MOTIONS[request.param]
    truth = json.loads((folder / "truth.json").read_text())[request.param]
    whole = library_model(f"hover.{request.param}").select(outputs=outputs)
    parameters = whole.parameters
    for name in parameters.names:
        # What the simulator has not, and the library's lag.
        parameters = parameters if name in truth else parameters.drop(name)
    structure = whole.condensed(parameters)
    return Flight(
        structure, tuple(record_of(folder / f"{name}.csv", structure.inputs, outputs) for name in files), truth
    )


@pytest.fixture(scope="module")
def found(flight: Flight) -> EquationErrorFit:
    return fit_equation_error(flight.structure, flight.structure.parameters, flight.records, domain=BAND)


def off(flight: Flight, fit: EquationErrorFit) -> dict[str, float]:
    """Relative errors of the derivatives."""
    values = fit.parameters.values
    return {n: abs(values[n] / t - 1.0) for n, t in flight.truth.items() if not n.startswith("tau_")}


def allowed(name: str, truth: float, std: float) -> float:
    """Relative error that a derivative may have."""
    if name.split("_")[1] in ("roll", "pitch", "yaw", "thrust"):
        return CONTROL_WITHIN
    return SPEED_WITHIN if name in ("M_u", "L_v") else max(WITHIN, SIGMAS * std / abs(truth))


def test_every_derivative_is_near_that_of_the_simulator(flight: Flight, found: EquationErrorFit) -> None:
    assert found.left == ()
    bars = {name: allowed(name, truth, found.std[name]) for name, truth in flight.truth.items()}
    assert {name: error for name, error in off(flight, found).items() if error > bars[name]} == {}
    for name in (name for name in flight.truth if name.startswith("tau_")):
        assert abs(found.parameters[name].value - flight.truth[name]) < DELAY_WITHIN_S
    assert "biased_by_noise" not in {finding.kind for finding in found.findings}


def test_over_all_samples_noise_costs_what_it_does_not_in_the_band(flight: Flight) -> None:
    records = tuple(replace(one, inputs=one.inputs[:, :MANY], outputs=one.outputs[:, :MANY]) for one in flight.records)
    band, simple = (
        fit_equation_error(flight.structure, flight.structure.parameters, records, domain=domain)
        for domain in (BAND, InTime(smoothing_s=0.025))
    )
    assert np.median(list(off(flight, simple).values())) > np.median(list(off(flight, band).values()))
    # That noise does it is foreseen from what the highest frequencies show: without it the values are better.
    pulls = {f.where: f.numbers["bias"] for f in simple.findings if f.kind == "biased_by_noise"}
    missed = {name: simple.parameters[name].value - flight.truth[name] for name in pulls}
    assert {"M_u", "L_v"} & set(pulls)
    assert sum(((missed[n] - pulls[n]) / simple.std[n]) ** 2 for n in pulls) < sum(
        (missed[n] / simple.std[n]) ** 2 for n in pulls
    )
    for name in {"M_u", "L_v"} & set(pulls):
        assert abs(missed[name] - pulls[name]) < abs(missed[name])


def test_stepwise_finds_what_moves_the_rate(flight: Flight, found: EquationErrorFit) -> None:
    state, moment = ("q", "M") if "q" in flight.structure.states else ("p", "L")
    steps = stepwise_equation(flight.structure, found.parameters, state, flight.records, domain=BAND)
    estimates = dict(zip(steps.regression.names, steps.regression.estimates.tolist(), strict=True))
    axis = {"M": "pitch", "L": "roll"}[moment]
    assert estimates.pop(f"{axis}_command") == pytest.approx(flight.truth[f"{moment}_{axis}"], rel=CONTROL_WITHIN)
    estimates.pop(CONSTANT)
    for name in (n.removeprefix(f"{moment}_") for n in flight.truth if n.startswith(f"{moment}_")):
        assert name == axis or name in estimates
