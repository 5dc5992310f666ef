"""Results of several speeds as one model, with the values and the covariance of the exact linearization."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.flying.test_vehicle_from_results import result

import rotorid
from rotorid.documents.base import to_json
from rotorid.documents.stitched import stitched_document
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flying.stitching import Stitched, stitch
from rotorid.io.registry import read, write_log
from rotorid.models.library import library_model
from rotorid.report.stitched import render_stitched
from rotorid.results.model import IdentifiedModel, parameter_estimates
from rotorid.results.summary import Range
from rotorid.simulation import fly_multirotor, hover_derivatives_of, trimmed
from rotorid.simulation.multirotor_flight import piloted
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.vehicles import aircraft

CRAFT = aircraft("forward_quad")
SPEEDS = (0.0, 4.0, 8.0)
LONGITUDINAL, LATERAL = "hover.longitudinal", "hover.lateral"


def identified(
    name: str, speed_m_s: float, *, dropped: tuple[str, ...] = (), std: float = 0.01, chance: float = 1.0
) -> IdentifiedModel:
    """A result whose values are exact, each with a deviation of a share of its value, and part of that by chance."""
    vehicle, autopilot = CRAFT.vehicle, CRAFT.autopilot
    truth = hover_derivatives_of(vehicle, autopilot, airspeed_m_s=speed_m_s)
    truth |= {"T_motor": vehicle.rotors.lag_up_s} | dict.fromkeys(
        ("tau_roll", "tau_pitch", "tau_yaw", "tau_thrust"), 0.005
    )
    trim = trimmed(vehicle, speed_m_s)
    demands = autopilot.linearization.demands(trim.shares)
    means = np.linalg.lstsq(autopilot.mixer_for(vehicle), demands, rcond=None)[0]
    structure = library_model(name)
    values = {one: truth[one] for one in structure.parameters.names if one not in dropped}
    constants = {
        "U0": float(trim.velocity_m_s[0]),
        "W0": float(trim.velocity_m_s[2]),
        "theta0": float(trim.angles_rad[1]),
    }
    parameters = structure.parameters.with_values(values)
    for one in dropped:
        parameters = parameters.drop(one)
    structure = replace(structure.with_constants(constants), parameters=parameters)
    free = parameters.free
    spread = std * np.array([max(abs(parameters[one].value), 0.01) for one in free])
    bounds = Bounds(
        names=free,
        cramer_rao=spread,
        insensitivity=spread,
        covariance=np.diag(spread**2),
        random=np.diag((chance * spread) ** 2),
        colored=1.0,
    )
    covered = {
        f"{axis}_command": Range(unit="1", lowest=0.0, highest=1.0, rms=1.0, mean=float(mean))
        for axis, mean in zip(("roll", "pitch", "yaw", "thrust"), means, strict=True)
    }
    return replace(
        result(name, {"L_p": -1.0}),
        structure=structure,
        bounds=bounds,
        parameters=parameter_estimates(parameters, bounds),
        covered=covered,
    )


def both(*speeds_m_s: float) -> dict[str, IdentifiedModel]:
    return {f"{name}-{speed:g}": identified(name, speed) for name in (LONGITUDINAL, LATERAL) for speed in speeds_m_s}


@pytest.fixture(scope="module")
def stitched() -> Stitched:
    return stitch(both(*SPEEDS))


def test_values_and_deviations_are_those_of_the_results_and_straight_between(stitched: Stitched) -> None:
    curve = stitched.curves[LONGITUDINAL]["M_pitch"]
    points = [identified(LONGITUDINAL, speed) for speed in SPEEDS]
    value, std = curve.at(curve.speed_m_s)
    np.testing.assert_allclose(value, [point["M_pitch"].value for point in points])
    np.testing.assert_allclose(std, [point["M_pitch"].std for point in points])
    middle, spread = curve.at(np.array([curve.speed_m_s[:2].mean()]))
    assert middle[0] == pytest.approx(value[:2].mean())
    assert spread[0] == pytest.approx(0.5 * np.hypot(*std[:2]))


def test_what_no_chance_made_is_as_wide_between_two_results() -> None:
    """Half of the variance is that of model errors, which every result has alike."""
    models = {f"{speed:g}": identified(LONGITUDINAL, speed, chance=np.sqrt(0.5)) for speed in SPEEDS[:2]}
    found = stitch(models)
    curve = found.curves[LONGITUDINAL]["M_pitch"]
    _, (first, middle, last) = curve.at(np.linspace(*curve.speed_m_s, 3))
    expected = np.sqrt(0.5 * (first**2 + last**2) / 4.0 + 0.5 * ((first + last) / 2.0) ** 2)
    assert middle == pytest.approx(expected)
    # Draws have the same band, at each result and between.
    rng = np.random.default_rng(2)
    drawn = np.array([found.stitched_model(rng).derivatives[:, 4, 7] for _ in range(800)])
    spread = [drawn[:, 0].std(), drawn.mean(axis=1).std(), drawn[:, 1].std()]
    # Four deviations of a standard deviation over so many draws.
    np.testing.assert_allclose(spread, [first, middle, last], rtol=4.0 / np.sqrt(2.0 * 800))


def test_draws_have_the_covariance(stitched: Stitched) -> None:
    rng = np.random.default_rng(1)
    drawn = [stitched.stitched_model(rng).derivatives[1, 4, 7] for _ in range(400)]
    m_pitch = identified(LONGITUDINAL, 4.0)["M_pitch"]
    assert m_pitch.std is not None
    # A standard deviation over 400 draws is known to 3.5 %.
    assert np.std(drawn) == pytest.approx(m_pitch.std, rel=0.15)
    assert np.mean(drawn) == pytest.approx(m_pitch.value, abs=3.0 * m_pitch.std / 20.0)


def test_a_parameter_that_was_dropped_somewhere_has_no_band_there() -> None:
    models = {
        "hover": identified(LONGITUDINAL, 0.0, dropped=("M_thrust",)),
        "four": identified(LONGITUDINAL, 4.0),
        "eight": identified(LONGITUDINAL, 8.0),
    }
    found = stitch(models)
    curve = found.curves[LONGITUDINAL]["M_thrust"]
    value, std = curve.at(np.array([0.0, 1.0, 6.0]))
    assert value[0] == 0.0
    assert np.isnan(std).tolist() == [True, True, False]
    assert [(one.kind, one.where) for one in found.findings] == [("dropped_at_speed", "M_thrust")]
    text = to_json(stitched_document(found))
    assert "NaN" not in text


def test_results_that_cannot_be_stitched() -> None:
    with pytest.raises(UsageError, match=r"hover\.longitudinal has only one speed, 0\.00 m/s"):
        stitch({"hover": identified(LONGITUDINAL, 0.0)})
    with pytest.raises(UsageError, match=r"are both hover\.longitudinal at"):
        stitch({"one": identified(LONGITUDINAL, 4.0), "two": identified(LONGITUDINAL, 4.0)})
    with pytest.raises(UsageError, match=r"is a result of rate\.roll"):
        stitch({"one": result("rate.roll", {"L_p": -1.0})})
    with pytest.raises(UsageError, match="no result was given"):
        stitch({})


def test_a_flight_needs_both_halves_and_what_the_simulation_takes(tmp_path: Path) -> None:
    path = tmp_path / "still.ulg"
    write_log(path, fly_multirotor(piloted(CRAFT), duration_s=8.0), format="ulg")
    record = read(path)
    half = {name: model for name, model in both(0.0, 4.0).items() if model.name == LATERAL}
    with pytest.raises(UsageError, match=r"hover\.lateral alone"):
        stitch(half, [record])
    silent = replace(record, parameters={})
    with pytest.raises(InsufficientDataError) as caught:
        stitch(both(0.0, 4.0), [silent])
    assert [finding.kind for finding in caught.value.findings] == ["no_controller"]


def test_exact_models_fly_through_the_speeds_as_the_vehicle_does(tmp_path: Path, stitched: Stitched) -> None:
    """The nonlinear vehicle under sticks from 0 to 8 m/s, from its log: Theil coefficients up to 0.1."""
    from rotorid.flying.simulation import everyday_plan

    craft = piloted(CRAFT)
    plan = everyday_plan(craft, duration_s=40.0, level=0.5, seed=3)
    path = tmp_path / "through.ulg"
    write_log(path, fly_multirotor(craft, plan, speed_m_s=(0.0, 8.0), seed=2), format="ulg")
    found = stitch(both(*SPEEDS), [read(path)])
    (flown,) = found.flights
    assert flown.setpoints["pitch_command"] == "theta_setpoint"
    assert flown.measured["u"].max() > 7.0
    scores = {name: one.tic for name, one in flown.scores.items()}
    assert all(tic <= 0.1 for tic in scores.values()), scores
    assert not [finding for finding in found.findings if finding.severity == "warning"]
    page = render_stitched(found, stitched_document(found), title="through the speeds")
    assert "through.ulg" in page
    # The spread by the covariance grows from nothing at the start.
    assert flown.spread["u"][0] == 0.0 < flown.spread["u"][-1]


def test_tables_have_the_lags_and_delays_of_the_results(stitched: Stitched) -> None:
    model = stitched.stitched_model()
    np.testing.assert_allclose(model.delay_s, 0.005)
    np.testing.assert_allclose(model.lag_s, CRAFT.vehicle.rotors.lag_up_s)


def test_a_stitched_model_shows_its_parameters_over_speed_and_is_saved(stitched: Stitched, tmp_path: Path) -> None:
    words = repr(stitched)
    assert f"from {len(stitched.points)} results" in words.splitlines()[0]
    assert "M_pitch" in words
    rotorid.save(stitched, tmp_path)
    assert repr(rotorid.load_document(tmp_path)) == words
