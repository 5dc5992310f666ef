"""Long windows on the rig: what they add is no error of its structure."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from tests.twins.twin_flights import RIG, RIG_AMPLITUDE_V, RIG_BAND, RIG_HZ, RIG_ROLL, RIG_S, record_of, sweep

from rotorid.data.record import FlightRecord, Maneuver
from rotorid.fits.frequency.fit import FrequencyFit, fit_with_bounds, pose
from rotorid.flights.flights import Flight
from rotorid.flights.measure import measure
from rotorid.models.library import library_model
from rotorid.settings.identifying import IdentifySettings
from rotorid.simulation.linear_loop import LinearLoop, fly_linear
from rotorid.typing import FloatArray

WINDOWS: dict[str, tuple[float, ...]] = {"of the paper": (71.0, 60.0, 40.0), "by default": ()}


def rig(*, lag_s: float = 0.0, damping: float = 0.0, gust: float = 0.0) -> LinearLoop:
    """The rig, with motors that lag, an air that damps, or gusts of torque."""
    system = RIG.system
    M, F, G = (np.array(matrix) for matrix in (system.M, system.F, system.G))
    F[1, 1] = -damping * M[1, 1]
    states, inputs = G.shape
    if lag_s:
        nothing, one = np.zeros((states, inputs)), np.eye(inputs)
        F = np.block([[F, G], [nothing.T, -one]])
        M = np.block([[M, nothing], [nothing.T, lag_s * one]])
        G = np.vstack([nothing, one])
    wide = [np.hstack([matrix, np.zeros((len(matrix), len(M) - states))]) for matrix in (system.H0, system.H1)]
    return replace(
        RIG,
        system=replace(system, M=M, F=F, G=G, H0=wide[0], H1=wide[1]),
        gust_input=np.eye(len(M))[:, [1]],
        gust_std=(gust,),
    )


@cache
def flown(seed: int, lag_s: float = 0.0, damping: float = 0.0, gust: float = 0.0) -> FlightRecord:
    rng = np.random.default_rng(seed)
    up, down = (sweep(RIG_AMPLITUDE_V, rng, RIG_BAND, RIG_S) for _ in range(2))
    loop = rig(lag_s=lag_s, damping=damping, gust=gust)
    columns = fly_linear(loop, np.stack([up, down[::-1]]), sample_rate_hz=RIG_HZ, rng=rng).columns
    whole = Maneuver(axis="roll", kind="sweep", start_s=0.0, stop_s=RIG_S, band_rad_s=RIG_BAND, origin="declared")
    return record_of(columns, RIG_HZ, [whole])


class Identified(NamedTuple):
    """A fit with the errors of its parameters."""

    fit: FrequencyFit
    error: FloatArray

    @property
    def misses(self) -> bool:
        """Whether the structure was found wrong."""
        return any(finding.kind == "structure_error" for finding in self.fit.findings)


def identified(record: FlightRecord, windows_s: tuple[float, ...]) -> Identified:
    settings = IdentifySettings(
        fix=RIG_ROLL.held,
        outputs=RIG_ROLL.outputs,
        instruments=("motor_3_excitation", "motor_4_excitation"),
        windows_s=windows_s,
    )
    whole = library_model("rig.roll").select(outputs=RIG_ROLL.outputs, inputs=RIG_ROLL.inputs)
    flights = [Flight(record, maneuver) for maneuver in record.declared]
    measured = measure(flights, inputs=whole.inputs, outputs=whole.outputs, settings=settings)
    found = fit_with_bounds(pose(whole, measured, settings), measured, settings)
    return Identified(
        found, np.array([found.parameters[name].value - RIG_ROLL.truth[name] for name in found.bounds.names])
    )


@pytest.mark.parametrize("windows", WINDOWS)
def test_the_exact_rig_has_no_model_error(windows: str) -> None:
    """Without a model what windows add is 10 to 19 % in the paper's windows: ± 6 % for a gain that is off by 0.8 %."""
    found = identified(flown(0), WINDOWS[windows])
    assert found.fit.problem.data.processing
    assert not found.misses
    assert max(found.fit.bounds.model_error.sizes.values()) < 0.01  # type: ignore[union-attr]
    assert np.all(np.abs(found.error) < 3.0 * found.fit.bounds.std)
    share = found.fit.bounds.std / np.array([RIG_ROLL.truth[name] for name in found.fit.bounds.names])
    assert share[0] < 0.007
    assert share[1:].max() < 0.025


@pytest.mark.parametrize("windows", WINDOWS)
@pytest.mark.parametrize("missing", [{"lag_s": 0.15}, {"damping": 0.1}], ids=str)
def test_what_the_structure_lacks_is_found(windows: str, missing: dict[str, float]) -> None:
    """A lag of 0.15 s and a damping of 0.1 1/s move the delays by more than two of their deviations."""
    found = identified(flown(0, **missing), WINDOWS[windows])
    assert np.abs(found.error / found.fit.bounds.std).max() > 1.7
    assert found.misses
    message = next(one.message for one in found.fit.findings if one.kind == "structure_error")
    assert "Dynamics are missing" in message


FLIGHTS = 20
FEW_AVERAGES = pytest.mark.xfail(
    strict=True,
    raises=AssertionError,
    reason="three windows in 120 s show the size of strong gusts to some 50 %: of 50 flights without the lag "
    "76 % are found, where 2 % of the exact ones are called wrong",
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("windows", "air"),
    [(name, air) for name in WINDOWS for air in ({}, {"gust": 0.01}, {"gust": 0.05})],
)
def test_intervals_are_sharp_and_hold(windows: str, air: dict[str, float]) -> None:
    every = [identified(flown(seed, **air), WINDOWS[windows]) for seed in range(2000, 2000 + FLIGHTS)]
    ratio = np.array([one.error / one.fit.bounds.std for one in every])
    assert np.mean(np.abs(ratio) <= 1.96) >= 0.9
    assert np.sqrt(np.mean(ratio**2)) <= 1.2
    assert sum(one.misses for one in every) <= 1


@pytest.mark.slow
@pytest.mark.parametrize("windows", WINDOWS)
@pytest.mark.parametrize("missing", [{"lag_s": 0.15}, {"damping": 0.1}], ids=str)
def test_a_wrong_structure_is_found_where_it_matters(windows: str, missing: dict[str, float]) -> None:
    every = [identified(flown(seed, **missing), WINDOWS[windows]) for seed in range(2000, 2000 + FLIGHTS)]
    moved = [one.misses for one in every if np.abs(one.error / one.fit.bounds.std).max() > 2.0]
    assert np.mean(moved) >= 0.8


@pytest.mark.slow
@pytest.mark.parametrize("windows", [pytest.param("of the paper", marks=FEW_AVERAGES), "by default"])
def test_a_missing_lag_is_found_in_gusts(windows: str) -> None:
    every = [identified(flown(seed, lag_s=0.15, gust=0.05), WINDOWS[windows]) for seed in range(2000, 2000 + FLIGHTS)]
    found = np.mean([one.misses for one in every])
    if found < 0.5:
        pytest.fail("beyond what is known")
    assert found >= 0.8
