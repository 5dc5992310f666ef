"""The pictures of the study of searches."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.search_problems import PROBLEMS
from benchmarks.searches import OWN, POPULATIONS, Run, points
from rotorid.fitting import FrequencyProblem
from rotorid.plot import INPUT, MEASURED, MODEL, PAPER_STYLE, SECONDARY, SERIES, matplotlib_or_remedy
from rotorid.search import Share, search
from rotorid.typing import FloatArray

LOOKS: dict[str, tuple[str, str, str]] = {
    "evolution": (MODEL, "-", "o"),
    "cma": (SERIES[3], "--", "D"),
    "genetic": (SERIES[4], "-.", "s"),
    "kmeans": (INPUT, "-", "^"),
    "sobol": (MEASURED, "-", "v"),
    "random": (SECONDARY, "--", "P"),
    "central": (SERIES[5], ":", "X"),
}
"""Color, dashes and marker of each search."""

COLUMNS = 4
DOTS_PER_INCH = 110


def draw(runs: Sequence[Run], problems: Sequence[str], folder: Path) -> None:
    """All pictures of the page, as far as the problems were run."""
    folder.mkdir(parents=True, exist_ok=True)
    _saved(_grid(runs, problems, "spent", "costs and residuals"), folder / "searches.png")
    _saved(_grid(runs, problems, "milliseconds", "process time [ms]"), folder / "searches-time.png")
    _saved(_before(runs, problems), folder / "searches-before.png")
    if "late" in problems:
        _saved(_failure(), folder / "searches-failure.png")


def _saved(canvas: Any, file: Path) -> None:
    canvas.savefig(file, format="png", dpi=DOTS_PER_INCH)


def _cells(count: int, height_in: float) -> tuple[Any, list[Any]]:
    mpl = matplotlib_or_remedy()
    rows = -(-count // COLUMNS)
    with mpl.rc_context(PAPER_STYLE):
        canvas = mpl.figure.Figure(figsize=(12.5, height_in * rows), layout="constrained")
        cells = canvas.subplots(rows, min(COLUMNS, count), sharey=True, squeeze=False).ravel().tolist()
    for cell in cells[count:]:
        cell.set_visible(False)
    for cell in cells[:count]:
        cell.set_xscale("log")
        cell.set_ylim(-0.03, 1.03)
    for cell in cells[:: min(COLUMNS, count)]:
        cell.set_ylabel("share of seeds that succeed")
    return canvas, cells


def _grid(runs: Sequence[Run], problems: Sequence[str], across: str, label: str) -> Any:
    """Success of all searches, one panel for each problem."""
    canvas, cells = _cells(len(problems), 3.3)
    for cell, problem in zip(cells, problems, strict=False):
        for name, look in LOOKS.items():
            found = points(runs, problem, name)
            _curve(cell, [getattr(one, across) for one in found], [one.after for one in found], name, look)
        for own in points(runs, problem, OWN):
            _star(cell, getattr(own, across), own.after)
        cell.set_title(PROBLEMS[problem].title, fontsize=9.5)
        cell.set_xlabel(label)
        _ticks(cell, (3, 10, 30, 100, 300, 1000))
    return _with_legend(canvas, cells[0])


def _curve(
    cell: Any, across: list[float], shares: list[Share], name: str, look: tuple[str, str, str], *, band: bool = True
) -> None:
    color, dashes, marker = look
    wide = name == "evolution"
    if band:
        # More costs may leave fewer local searches: the line follows the budgets, the band the axis.
        order = np.argsort(across, kind="stable")
        low, high = np.array([(one.low, one.high) for one in shares])[order].T
        cell.fill_between(np.array(across)[order], low, high, color=color, alpha=0.08, linewidth=0.0)
    cell.plot(
        across,
        [one.value for one in shares],
        color=color,
        linestyle=dashes,
        marker=marker,
        markersize=5.0 if wide else 4.0,
        linewidth=2.2 if wide else 1.4,
        label=name,
        zorder=3 if wide else 2,
        clip_on=False,
    )


def _ticks(cell: Any, values: tuple[int, ...]) -> None:
    low, high = cell.get_xlim()
    kept = [value for value in values if low <= value <= high]
    cell.set_xticks(kept, [str(value) for value in kept])
    cell.minorticks_off()


def _star(cell: Any, across: float, share: Share) -> None:
    reach = [[share.value - share.low], [share.high - share.value]]
    cell.errorbar(
        [across],
        [share.value],
        yerr=reach,
        color="#24292f",
        marker="*",
        markersize=10.0,
        linestyle="none",
        linewidth=1.2,
        capsize=2.5,
        label=OWN,
        zorder=4,
        clip_on=False,
    )


def _with_legend(canvas: Any, cell: Any) -> Any:
    handles, labels = cell.get_legend_handles_labels()
    canvas.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False, fontsize=10.0)
    return canvas


def _before(runs: Sequence[Run], problems: Sequence[str]) -> Any:
    """Populations before and after their local searches, at the same costs of the search itself."""
    canvas, cells = _cells(len(problems), 3.0)
    for cell, problem in zip(cells, problems, strict=False):
        for name in POPULATIONS:
            color, _, marker = LOOKS[name]
            found = points(runs, problem, name)
            budgets = [float(one.budget) for one in found]
            _curve(cell, budgets, [one.after for one in found], f"{name}, at the end", (color, "-", marker), band=False)
            plain = (color, ":", marker)
            _curve(cell, budgets, [one.before for one in found], f"{name}, before", plain, band=True)
        cell.set_title(PROBLEMS[problem].title, fontsize=9.5)
        cell.set_xlabel("costs, without local searches")
        _ticks(cell, (30, 100, 300, 1000))
    return _with_legend(canvas, cells[0])


def _failure() -> Any:
    """Data with a delay, the lowest minimum, and two others where searches end."""
    posed = PROBLEMS["late"].pose(0)
    problem = posed.problem
    assert isinstance(problem, FrequencyProblem)
    basins = search("sobol").run(problem, budget=3000, seed=0).basins
    delays_s = [float(basin.theta[-1]) for basin in basins]
    # The lowest, the lowest with another delay, and the lowest whose phase turns once more.
    chosen = [
        basins[0],
        next(basin for basin, delay in zip(basins, delays_s, strict=True) if delay > 1.5 * delays_s[0]),
        next(basin for basin, delay in zip(basins, delays_s, strict=True) if delay > 0.1),
    ]
    mpl = matplotlib_or_remedy()
    dense = np.geomspace(1.0, 40.0, 600)
    with mpl.rc_context(PAPER_STYLE):
        canvas = mpl.figure.Figure(figsize=(9.0, 3.4), layout="constrained")
        left, right = canvas.subplots(1, 2)
    omega, measured = problem.data.omega_rad_s, problem.data.values[0, 0]
    left.plot(omega, _decibels(measured), "o", color="#24292f", markersize=3.5, label="measured", zorder=4)
    right.plot(omega, np.angle(measured, deg=True), "o", color="#24292f", markersize=3.5, zorder=4)
    looks = ((MODEL, "-"), (MEASURED, "--"), (SECONDARY, "-."))
    for basin, (color, dashes) in zip(chosen, looks, strict=True):
        model = problem.structure.response(problem.parameters.unpack(basin.theta).values, dense)[0, 0]
        label = f"cost {basin.cost:.0f}, delay {1e3 * basin.theta[-1]:.0f} ms"
        left.plot(dense, _decibels(model), color=color, linestyle=dashes, linewidth=1.8, label=label)
        phase = np.angle(model, deg=True)
        phase[1:][np.abs(np.diff(phase)) > 180.0] = np.nan
        right.plot(dense, phase, color=color, linestyle=dashes, linewidth=1.8)
    left.set_ylabel("magnitude [dB]")
    right.set_ylabel("phase [°]")
    for cell in (left, right):
        cell.set_xscale("log")
        cell.set_xlabel("frequency [rad/s]")
    return _with_legend(canvas, left)


def _decibels(values: Any) -> FloatArray:
    return np.asarray(20.0 * np.log10(np.abs(values)))
