"""The Bebop 2 paper's table: identified on one record, scored on the other three, with fits of the package's own.

Conventions are the paper's: commands are held from one sample to the next, the vehicle rests before the first sample,
the initial state of every record is estimated and no shift of an output. The best record to identify on is chosen by
the scores that are then reported, as the paper does, which is optimistic; the mean over all four records stands beside
it. The paper scored first-order models on records that their hand-averaged parameters had seen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.fitting.black_box.fit import fit_black_box
from rotorid.fitting.time.output_error import TimeData, TimeProblem, fit_output_error
from rotorid.models.library import response_model
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.typing import FloatArray
from rotorid.verification.fixed_parameters import CrossValidation, FixedParameterScores, cross_validate, score_frozen

NAMES = ("120935", "121028", "121250", "122633")
PAIRS = tuple((f"{name}_setpoint", name) for name in ("phi", "theta", "velocity_down"))
STEP_S = 0.050
"""The mean step of the stamps within every record; single ones stray by a millisecond."""

DELAY = "response.second_order_delay"

# Fit percent of the best record to identify on; in brackets the paper's own.
GREY = {
    "response.first_order": 74.5,  # 73.4
    "response.first_order_delay": 79.5,  # 76.7
    "response.second_order": 82.4,  # 82.9
    DELAY: 83.0,  # 76.0
}
BLACK = {3: 83.5, 4: 82.4}  # 83.5, 82.3

Identified = tuple[LinearStructure, ParameterSet]
Fit = Callable[[Sequence[TimeData]], Identified]


@cache
def record(folder: Path, name: str, output: str) -> TimeData:
    """One axis of one record, on a uniform clock."""
    log = rotorid.read(folder / f"{name}.mat", mapping=folder.parent / "map.toml")
    rows = {channel: topic.values[row] for channel in log.channel_names for topic, row in log.holding(channel)}
    return TimeData(
        name=name,
        inputs=rows[f"{output}_setpoint"][None],
        outputs=rows[output][None],
        sample_rate_hz=1.0 / STEP_S,
        before=np.zeros(1),
    )


def grey(model: str, output: str) -> Fit:
    structure = response_model(model, [(f"{output}_setpoint", output)])

    def fit(records: Sequence[TimeData]) -> Identified:
        problem = TimeProblem(
            structure=structure,
            parameters=structure.parameters,
            records=tuple(records),
            hold="zero",
            unknowns=("initial_state",),
        )
        return structure, fit_output_error(problem).parameters

    return fit


def black(order: int, output: str) -> Fit:
    def fit(records: Sequence[TimeData]) -> Identified:
        found = fit_black_box(
            records, order, inputs=[f"{output}_setpoint"], outputs=[output], unknowns=("initial_state",)
        )
        return found.structure, found.parameters

    return fit


def score(model: Identified, one: TimeData) -> list[FixedParameterScores]:
    structure, parameters = model
    return [score_frozen(structure, parameters.values, one, hold="zero", unknowns=("initial_state",))]


def validated(folder: Path, fit: Callable[[str], Fit]) -> list[CrossValidation[Identified]]:
    """Every axis by itself: a command of one does not move another."""
    return [
        cross_validate([record(folder, name, y) for name in NAMES], names=NAMES, kind="each", fit=fit(y), score=score)
        for _, y in PAIRS
    ]


def means(axes: Sequence[CrossValidation[Identified]]) -> FloatArray:
    """Mean of the three axes for each record to identify on, shape ``(4,)``."""
    return np.asarray(np.mean([one.fold_means for one in axes], axis=0))


def report(what: str, found: FloatArray) -> None:
    print(f"{what}: {found.round(1)}, best {found.max():.1f}, mean over all records {found.mean():.1f} %")


@pytest.fixture(scope="module")
def filtered(shared_data: Path) -> Path:
    return shared_data / "bebop" / "ident"


@pytest.fixture(scope="module")
def unfiltered(shared_data: Path) -> list[CrossValidation[Identified]]:
    return validated(shared_data / "bebop" / "unfiltered", lambda y: grey(DELAY, y))


@pytest.mark.slow
@pytest.mark.parametrize(("model", "bar"), GREY.items())
def test_table_of_grey_boxes(model: str, bar: float, filtered: Path) -> None:
    found = means(validated(filtered, lambda y: grey(model, y)))
    report(model, found)
    assert found.max() >= bar


@pytest.mark.slow
@pytest.mark.parametrize(("order", "bar"), BLACK.items())
def test_table_of_black_boxes(order: int, bar: float, filtered: Path) -> None:
    found = means(validated(filtered, lambda y: black(order, y)))
    report(f"black box of order {order}", found)
    assert found.max() >= bar


@pytest.mark.slow
def test_unfiltered_outputs_are_simulated_as_well(unfiltered: list[CrossValidation[Identified]]) -> None:
    found = means(unfiltered)
    report(f"{DELAY}, unfiltered", found)
    assert found.max() >= 83.0


@pytest.mark.slow
def test_unfiltered_outputs_show_the_delay_of_every_axis(unfiltered: list[CrossValidation[Identified]]) -> None:
    delays_s = np.array(
        [
            [parameters.values[f"tau_{y}"] for _, parameters in (fold.model for fold in one.folds if fold.model)]
            for (_, y), one in zip(PAIRS, unfiltered, strict=True)
        ]
    )
    print("delays in ms by axis and record:", (1e3 * delays_s).round(1).tolist(), "mean", 1e3 * delays_s.mean())
    assert delays_s.mean() == pytest.approx(0.070, abs=0.020)
    assert np.abs(delays_s - 0.070).max() <= 0.020


@pytest.mark.slow
def test_a_zero_phase_filter_on_the_outputs_alone_leaves_no_delay(filtered: Path) -> None:
    """It answers before it is asked: some 50 ms of delay are hidden, and angles are left with less than none."""
    for y in ("phi", "theta"):
        for name in NAMES:
            assert grey(DELAY, y)([record(filtered, name, y)])[1].values[f"tau_{y}"] == 0.0


@pytest.mark.slow
def test_a_held_command_is_late_by_half_a_step(
    shared_data: Path, unfiltered: list[CrossValidation[Identified]]
) -> None:
    """A simulation that goes straight from command to command calls the hold a delay."""
    fold = unfiltered[0].folds[0]
    assert fold.model is not None
    structure, held = fold.model
    one = record(shared_data / "bebop" / "unfiltered", NAMES[0], "phi")
    problem = TimeProblem(
        structure=structure, parameters=held, records=(one,), hold="first", unknowns=("initial_state",)
    )
    straight = fit_output_error(replace(problem, noise=np.zeros((0, 0)))).parameters
    assert straight.values["tau_phi"] - held.values["tau_phi"] == pytest.approx(STEP_S / 2.0, abs=5e-3)
