"""Guards of safety and of statistics, each with the tests that fail without it.

A guard that no test misses can be lost in any change. Each row takes one out of a copy of the sources; at least one of
its tests has to fail there, and all of them pass on the sources as they are.

``python -m tests.mutations`` tries all rows, ``python -m tests.mutations NAME …`` those whose names begin so, and
``--list`` prints the names. :mod:`tests.api.test_mutations` keeps the rows applicable.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ROOT / "src"
_ENDED_BY_FAILURES = 1
"""What pytest returns where tests ran and some failed: an error of the collection is no answer."""


class Mutation(NamedTuple):
    """A guard that is taken out.

    Attributes
    ----------
    name
        Command and guard.
    file
        Below ``src/rotorid``.
    old, new
        Text that stands there once, and what takes its place.
    tests
        Files, or single tests, below ``tests/unit``.
    """

    name: str
    file: str
    old: str
    new: str
    tests: str

    @property
    def paths(self) -> list[str]:
        """The tests, as pytest takes them."""
        return [f"tests/unit/{one}" for one in self.tests.split()]


def _guards(file: str, tests: str, **rows: tuple[str, str]) -> Iterator[Mutation]:
    """Mutations of one file that the same tests miss: name, with ``__`` for a point, to the old and the new text."""
    for name, (old, new) in rows.items():
        yield Mutation(name.replace("__", "."), file, old, new, tests)


TABLE = (
    *_guards(
        "tuning/proposal.py",
        "tuning/test_proposal_guards.py",
        tune__throttle__search=(
            "k_low, k_high = k_low / wishes.gain_range[0], k_high / wishes.gain_range[1]",
            "k_low, k_high = k_low * 1.0, k_high * 1.0",
        ),
        tune__moving_d__search=("for scores in (found, *moved) if", "for scores in (found,) if"),
        tune__phase_margin__wish=(
            "phase_margin_rad: float = float(np.radians(45.0))",
            "phase_margin_rad: float = float(np.radians(1.0))",
        ),
        tune__phase_margin__bound=("levels.append((phase_margin_rad - np.pi, 1.0))", "levels.append((-np.pi, 1.0))"),
        tune__phase_margin__exact=("        < wishes.phase_margin_rad,", "        < 0.0,"),
        tune__gain_margin=("gain_margin: float = 2.0", "gain_margin: float = 1.0"),
        tune__quantile=("\nQUANTILE = 0.05", "\nQUANTILE = 0.45"),
    ),
    *_guards(
        "tuning/proposal.py",
        "tuning/test_proposal.py::test_a_shape_that_leaves_no_room_between_its_least_and_largest_gain_is_refused",
        tune__room=("\n_ROOM = 1.3", "\n_ROOM = 1.0"),
    ),
    *_guards(
        "proposing/new_gains.py",
        "proposing/test_judging_guards.py",
        tune__throttle__wishes=(
            "thrust.flown_range if thrust is not None else (1.0, 1.0),\n        ranges",
            "(1.0, 1.0),\n        ranges",
        ),
    ),
    *_guards(
        "proposing/judging.py",
        "proposing/test_judging_guards.py",
        tune__throttle__judged=("made, gain_range=gain_range)", "made)"),
        tune__moving_d__judged=(
            'for name, one in (ends or {"": gains}).items()',
            'for name, one in {"": gains}.items()',
        ),
    ),
    *_guards(
        "tuning/judging.py",
        "tuning/test_judging.py",
        tune__throttle__situations=("for factor in (low, high)}", "for factor in (low,)}"),
        judge__safe_quantile=("SAFE_QUANTILE = 0.95", "SAFE_QUANTILE = 0.5"),
        judge__uncertain=("\nUNCERTAIN = 0.1", "\nUNCERTAIN = 10.0"),
        judge__noisiest=("QUIET, NOISIEST = 0.01, 0.1", "QUIET, NOISIEST = 0.01, 1.0"),
        judge__quiet=("QUIET, NOISIEST = 0.01, 0.1", "QUIET, NOISIEST = 0.09, 0.1"),
        judge__unstable=("np.where(found.stable > 0.0, found.sensitivity_peak, np.inf)", "found.sensitivity_peak"),
        judge__whole_loop=('("rate", figures.rate), ("whole", figures.whole)', '("rate", figures.rate),'),
        judge__reach=("elif crossover > plant.reach_rad_s:", "elif crossover > np.inf:"),
    ),
    *_guards(
        "tuning/plant.py",
        "tuning/test_plant.py",
        tune__doubt__outside=("_OUTSIDE_PER_E_FOLD = 0.15", "_OUTSIDE_PER_E_FOLD = 0.0"),
        tune__doubt__floor=("\nFLOOR = 0.02", "\nFLOOR = 0.002"),
        tune__doubt__noise=("noise = 0.5 * np.real(measured.covariance)", "noise = 0.0 * np.real(measured.covariance)"),
        tune__doubt__neighbors=("\n_INDEPENDENT = 0.1", "\n_INDEPENDENT = 0.0"),
        tune__doubt__reach=("\nBEYOND_RATIO = 6.0", "\nBEYOND_RATIO = 60.0"),
        tune__doubt__known_from=("\nKNOWN_FROM = 1.5", "\nKNOWN_FROM = 0.01"),
        tune__doubt__largest_misfit=("_LARGEST_MISFIT = 0.02, 0.5", "_LARGEST_MISFIT = 0.02, 0.02"),
    ),
    *_guards(
        "data/trust.py",
        "tuning/test_judging.py",
        judge__refused_peak=("REFUSED_PEAK, REFUSED_QUANTILE = 2.4, 0.9", "REFUSED_PEAK, REFUSED_QUANTILE = 2.8, 0.9"),
        judge__refused_quantile=(
            "REFUSED_PEAK, REFUSED_QUANTILE = 2.4, 0.9",
            "REFUSED_PEAK, REFUSED_QUANTILE = 2.4, 0.5",
        ),
        judge__safe_peak=(
            "SAFE_PEAK, SAFE_PHASE_MARGIN_DEG = 2.0, 40.0",
            "SAFE_PEAK, SAFE_PHASE_MARGIN_DEG = 2.3, 40.0",
        ),
        judge__command_noise=("\nCOMMAND_NOISE = 2.0", "\nCOMMAND_NOISE = 20.0"),
    ),
    *_guards(
        "data/trust.py",
        "tuning/test_proposal_guards.py",
        judge__safe_phase_margin=("SAFE_PHASE_MARGIN_DEG = 2.0, 40.0", "SAFE_PHASE_MARGIN_DEG = 2.0, 1.0"),
        judge__robustness=("\nROBUSTNESS = 1.7", "\nROBUSTNESS = 2.3"),
    ),
    *_guards(
        "tuning/kinds.py",
        "tuning/test_kinds.py",
        outer__room=("angle_room=1.5,", "angle_room=0.1,"),
        outer__rate_room=("angle_room: float = 3.0", "angle_room: float = 0.1"),
        outer__lowest=("lowest_rad_s=0.03", "lowest_rad_s=0.5"),
        outer__disturbance=("disturbance_rad_s=0.3", "disturbance_rad_s=3.0"),
        outer__integrals=("integrals=np.geomspace(0.05, 2.0, 18)", "integrals=np.geomspace(0.3, 12.0, 18)"),
        outer__yaw_derivative=("derivatives=np.zeros(1)", "derivatives=_DERIVATIVES"),
    ),
    *_guards(
        "proposing/filter_curve.py",
        "proposing/test_filter_curve_points.py",
        filters__most_cost=("MOST_COST_DEG = 12.0", "MOST_COST_DEG = 120.0"),
        filters__quieter=("_QUIETER = 0.97", "_QUIETER = 1.97"),
        filters__least_saved=("_LEAST_SAVED = 10.0", "_LEAST_SAVED = 0.0"),
        filters__as_stiff=("_AS_STIFF = 1.02", "_AS_STIFF = 2.0"),
        filters__undominated=("point.attitude < 0.995 * other.attitude", "point.attitude < 9.0 * other.attitude"),
        filters__limits=(
            "    if not all(found.proposal.keeps_limits for found in agreed.values()):\n        return None\n",
            "",
        ),
    ),
    *_guards(
        "proposing/new_gains.py",
        "proposing/test_filter_curve_points.py",
        filters__ends=("ends=tuple(at_ends(known.controller, parts).values()),", "ends=(),"),
    ),
    *_guards(
        "verification/tracking.py",
        "verification/test_tracking_guards.py",
        track__instrument=("w = _explained(z, s, first)", "w = z"),
        track__clip=("\n_CLIP = 3.0", "\n_CLIP = 1e9"),
        track__rough_air=("_ROUGHER, _CALM_AGAIN = 2.0, 1.3", "_ROUGHER, _CALM_AGAIN = 1e9, 1e9"),
        track__calm_again=("_ROUGHER, _CALM_AGAIN = 2.0, 1.3", "_ROUGHER, _CALM_AGAIN = 2.0, 2.0"),
        track__band=("BAND_HZ = (0.5, 6.0)", "BAND_HZ = (0.1, 1.2)"),
        track__threshold=("THRESHOLD = math.log(2.0 * 3600.0 / 0.5)", "THRESHOLD = 0.96"),
        track__least_level=("\nLEAST_LEVEL = 0.15", "\nLEAST_LEVEL = 0.0"),
        track__shape_share=("\n_SHAPE_SHARE = 0.02", "\n_SHAPE_SHARE = 0.0"),
    ),
    *_guards(
        "data/trust.py",
        "verification/test_tracking_guards.py",
        track__reference=("\nREFERENCE_S = 60.0", "\nREFERENCE_S = 30.0"),
        track__step_share=("\nSTEP_SHARE = 0.13", "\nSTEP_SHARE = 0.013"),
    ),
    *_guards(
        "fleets/populations.py",
        "fleets/test_analysis.py",
        fleet__normal_range__between=(
            "found.between[0] ** 2 + found.within[0] ** 2 + mean_std**2",
            "found.within[0] ** 2 + mean_std**2",
        ),
        fleet__normal_range__within=(
            "found.between[0] ** 2 + found.within[0] ** 2 + mean_std**2",
            "found.between[0] ** 2 + mean_std**2",
        ),
    ),
    *_guards(
        "fleets/changes.py",
        "fleets/test_analysis.py",
        fleet__odd__number=("min(1.0, y.size * chance(", "min(1.0, 1.0 * chance("),
    ),
    *_guards(
        "uncertainty/differences.py",
        "fleets/test_analysis.py",
        fleet__false_share=("FALSE_SHARE = 0.05", "FALSE_SHARE = 0.5"),
    ),
    *_guards(
        "tuning/loops.py",
        "loops/test_rate_loops_margins.py",
        review__interval=("np.quantile(values, (0.025, 0.5, 0.975))", "np.quantile(values, (0.405, 0.5, 0.595))"),
        review__std=("std=float(np.std(values)), lower", "std=0.2 * float(np.std(values)), lower"),
    ),
    *_guards(
        "loops/rate_loops.py",
        "loops/test_rate_loops_margins.py",
        review__shown=(
            "        numbers[name] = quantity\n",
            "        numbers[name] = replace(quantity, std=0.2 * quantity.std)\n",
        ),
    ),
    *_guards(
        "spectral/margins.py",
        "spectral/test_margins_deviations.py",
        review__peak=(
            "peak = Estimated(value=height, std=height * curve.std(top.weights))",
            "peak = Estimated(value=height, std=0.2 * height * curve.std(top.weights))",
        ),
        review__phase_margin=(
            "phase_margin_rad=Estimated(value=margin, std=curve.std(phase))",
            "phase_margin_rad=Estimated(value=margin, std=0.0)",
        ),
    ),
    *_guards(
        "uncertainty/colored.py",
        "uncertainty/test_colored.py",
        uncertainty__no_process=("\n_AS_SURPRISING = 1.5", "\n_AS_SURPRISING = 1e9"),
        uncertainty__given_back=("\n_AS_SURPRISING = 1.5", "\n_AS_SURPRISING = 0.9"),
    ),
    *_guards(
        "uncertainty/model_error.py",
        "uncertainty/test_model_error.py",
        uncertainty__floor=("LARGEST_MODEL_ERROR = 0.005, 0.3", "LARGEST_MODEL_ERROR = 0.0005, 0.3"),
        uncertainty__cap=("\n_LARGEST_SHARE = 3.0", "\n_LARGEST_SHARE = 30.0"),
        uncertainty__largest=("LARGEST_MODEL_ERROR = 0.005, 0.3", "LARGEST_MODEL_ERROR = 0.005, 3.0"),
        uncertainty__usual=("\nUSUAL_MODEL_ERROR = 0.003", "\nUSUAL_MODEL_ERROR = 0.0003"),
        uncertainty__correlations=("\n_OVERSTATED = 0.2", "\n_OVERSTATED = 0.0"),
    ),
    *_guards(
        "simulation/stitched_kernels.py",
        "simulation/test_stitched.py",
        stitch__sway=(
            "force[1] -= GRAVITY_M_S2 * math.cos(theta_0) * math.sin(phi_0)",
            "force[1] -= GRAVITY_M_S2 * math.sin(phi_0)",
        ),
        stitch__heave=(
            "force[2] -= GRAVITY_M_S2 * math.cos(theta_0) * math.cos(phi_0)",
            "force[2] -= GRAVITY_M_S2 * math.cos(theta_0)",
        ),
        stitch__delay__flown=("when = step - _between(tables.delay_s, k, share, i) / step_s", "when = step"),
    ),
    *_guards(
        "flying/stitching.py",
        "flying/test_stitching.py::test_tables_have_the_lags_and_delays_of_the_results",
        stitch__delay__table=('table.get(f"tau_{axis}", 0.0)', "0.0"),
        stitch__lag__table=('table.get("T_motor", 0.0)', "0.0"),
    ),
    *_guards(
        "io/px4/status.py",
        "io/test_flags.py",
        flags__px4__begin=("if time_s[0] < begin_s + _REGULAR_S else time_s", "if time_s[0] < np.inf else time_s"),
        flags__px4__unlogged=("unlogged=_unlogged(arrays, span_s[0])", "unlogged=()"),
    ),
    *_guards(
        "io/betaflight/status.py",
        "io/test_flags.py",
        flags__betaflight__unlogged=(
            "before_first(flight.slow_time_s, float(flight.time_s[0])) for flight in flights_with_flags",
            "() for flight in flights_with_flags",
        ),
    ),
    *_guards(
        "io/ardupilot/status.py",
        "io/test_flags.py",
        flags__ardupilot__unlogged=("        unlogged = _take_offs_lost(events)", "        unlogged = ()"),
    ),
    *_guards(
        "data/trust.py",
        "data/test_trust.py",
        trust__direct_coherence=("\nDIRECT_COHERENCE = 0.6", "\nDIRECT_COHERENCE = 0.2"),
        trust__joint_coherence=("\nJOINT_COHERENCE = 0.2", "\nJOINT_COHERENCE = 0.0"),
        trust__random_error=("\nLARGEST_RANDOM_ERROR = 0.3", "\nLARGEST_RANDOM_ERROR = 0.45"),
        trust__structure_error=("\nMEANINGLESS_STRUCTURE_ERROR = 0.1", "\nMEANINGLESS_STRUCTURE_ERROR = 1.0"),
        trust__least_width=("\nLEAST_WIDTH = 2.0", "\nLEAST_WIDTH = 1.0"),
        trust__cramer_rao=("\nCRAMER_RAO_GUIDELINE_PERCENT = 20.0", "\nCRAMER_RAO_GUIDELINE_PERCENT = 200.0"),
        trust__insensitivity=("\nINSENSITIVITY_GUIDELINE_PERCENT = 10.0", "\nINSENSITIVITY_GUIDELINE_PERCENT = 100.0"),
        trust__fitted_share=("\nFITTED_SHARE = 0.7", "\nFITTED_SHARE = 0.0"),
        trust__certain_sign=("\nCERTAIN_SIGN = 2.0", "\nCERTAIN_SIGN = 0.0"),
        trust__rich_kinds=(
            'RICH_KINDS = ("sweep", "random_binary", "multisine")',
            'RICH_KINDS = ("sweep", "random_binary", "multisine", "doublet")',
        ),
    ),
)


def kills(mutation: Mutation, tests: Sequence[str] | None = None) -> bool:
    """Whether one of its tests fails without the guard.

    Parameters
    ----------
    mutation
        What is taken out.
    tests
        Others than its own.
    """
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "src"
        shutil.copytree(SOURCES, copy)
        path = copy / "rotorid" / mutation.file
        path.write_text(mutated(mutation), encoding="utf-8")
        ran = subprocess.run(
            [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-n0", *(tests or mutation.paths)],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(copy), "OPENBLAS_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
            check=False,
        )
    if ran.returncode not in (0, _ENDED_BY_FAILURES):
        raise RuntimeError(f"{mutation.name}: the tests did not run\n{ran.stdout[-2000:]}")
    return ran.returncode == _ENDED_BY_FAILURES


def mutated(mutation: Mutation) -> str:
    """The file without its guard.

    Raises
    ------
    ValueError
        The text of the guard does not stand there exactly once.
    """
    text = (SOURCES / "rotorid" / mutation.file).read_text(encoding="utf-8")
    if text.count(mutation.old) != 1:
        raise ValueError(
            f"{mutation.name}: {mutation.old!r} stands {text.count(mutation.old)} times in {mutation.file}"
        )
    return text.replace(mutation.old, mutation.new)


def main(names: Sequence[str]) -> int:
    """Print each guard with whether its tests miss it; the number of those that are not missed."""
    if "--list" in names:
        print(*(mutation.name for mutation in TABLE), sep="\n")
        return 0
    survivors = 0
    for mutation in TABLE:
        if names and not mutation.name.startswith(tuple(names)):
            continue
        found = kills(mutation)
        survivors += not found
        print(f"{'killed' if found else 'SURVIVES':9} {mutation.name}", flush=True)
    return survivors


if __name__ == "__main__":
    sys.exit(min(main(sys.argv[1:]), 1))
