"""Four flights of a Bebop 2 by its authors: what their fit states beside how the flights' own estimates scatter.

The fit of all four states a standard deviation for each of 36 parameters of four forms, and the flights fitted alone
have a scatter *S*. Clocks are judged apart: one that is late moves all four flights alike, and no scatter shows it.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.fits.scatter import disagreements, with_scatter
from rotorid.fits.time.fit import fit_in_time
from rotorid.flights.segments import time_records
from rotorid.flights.selection import select_records
from rotorid.models.library import response_model
from rotorid.settings.identifying import IdentifySettings
from rotorid.uncertainty.cramer_rao import bounds_of_parts
from rotorid.uncertainty.time_error import with_time_error

NAMES = ("120935", "121028", "121250", "122633")
PAIRS = tuple((f"{name}_setpoint", name) for name in ("phi", "theta", "velocity_down"))
FORMS = ("first_order", "first_order_delay", "second_order", "second_order_delay")

LEAST, MOST = 0.7, 2.5
WITHIN = 30
"""Of the 36, how many are to be stated within 2.5 times their scatter."""


class Stated(NamedTuple):
    """Standard deviations of a parameter over its scatter: as stated, without clocks, and of random errors alone."""

    whole: float
    without_clocks: float
    random: float


def stated(form: str, logs: list[FlightRecord]) -> dict[str, Stated]:
    structure, settings = response_model(f"response.{form}", PAIRS), IdentifySettings()
    flights = select_records(structure, logs, settings).selection.fitted
    fit = fit_in_time(structure, time_records(structure, flights, settings), settings, method="output_error")
    parts, names = fit.problem.parts(fit.solution.theta), fit.bounds.names
    held = [name for name, on_bound in zip(names, fit.solution.at_bound, strict=True) if on_bound]
    random = with_scatter(bounds_of_parts(parts, names), disagreements(fit.alone))
    still = with_time_error(random, parts, alone=fit.alone, held=held)
    found = {}
    for name, *stds in zip(names, fit.bounds.std, still.std, fit.bounds.random_std, strict=True):
        scatter = float(np.std([log.values[name] for log in fit.alone], ddof=1))
        with np.errstate(divide="ignore"):
            found[f"{name} of {form}"] = Stated(*(np.array(stds) / scatter).tolist())
    return found


@pytest.fixture(scope="module")
def parameters(shared_data: Path) -> dict[str, Stated]:
    """By the filtered records, as the paper fits them."""
    folder = shared_data / "bebop"
    logs = [rotorid.read(folder / "ident" / f"{name}.mat", mapping=folder / "map.toml") for name in NAMES]
    found: dict[str, Stated] = {}
    for form in FORMS:
        found |= stated(form, logs)
    for name, one in found.items():
        print(f"{name:40s} {one.whole:6.2f} {one.without_clocks:6.2f} {one.random:6.2f}")
    return found


@pytest.mark.slow
def test_no_interval_is_smaller_than_the_scatter(parameters: dict[str, Stated]) -> None:
    assert len(parameters) == 36
    assert min(one.whole for one in parameters.values()) >= LEAST


@pytest.mark.slow
@pytest.mark.xfail(
    strict=True,
    raises=AssertionError,
    reason="27 of 36, and 29 without clocks: two delays are zero in all four flights and do not scatter; of five "
    "others random errors alone are 1.1 to 3.7 times the scatter, which is small by chance; of two, clocks at 20 Hz "
    "move all four flights alike",
)
def test_intervals_are_as_wide_as_the_scatter(parameters: dict[str, Stated]) -> None:
    within = {name for name, one in parameters.items() if one.whole <= MOST}
    if len(within) < 27:
        pytest.fail(f"beyond what is known: {set(parameters) - within}")
    assert len(within) >= WITHIN, set(parameters) - within


@pytest.mark.slow
def test_without_clocks_all_but_few_are(parameters: dict[str, Stated]) -> None:
    outside = {name for name, one in parameters.items() if not one.without_clocks <= MOST}
    assert len(outside) <= 7, outside
    # Four flights that scatter less than random errors alone agree by chance; delays at zero do not scatter.
    assert all(parameters[name].random > 1.0 for name in outside), outside
