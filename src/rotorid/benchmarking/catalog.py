"""Public benchmarks: where their data are, under which license, how they are split, and what others have published.

The data are not shipped: a user downloads them. Hashes are those of unpacked files, so that a table of errors says of
which flights it is. A published row that was had on other flights is named as such.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from rotorid.data import synonyms
from rotorid.errors import unknown_name

Kind = Literal["loads", "steps"]
"""What is predicted: force and moment of each sample, or states over the next half second."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Metric:
    """One column of a table of errors.

    Parameters
    ----------
    name
        In ``bench.json``.
    words
        On paper and on the terminal.
    unit
        Of the value.
    scale
        From the value to its number on paper.
    shown
        Unit on paper.
    """

    name: str
    words: str
    unit: str
    scale: float = 1.0
    shown: str = ""


STEPS = 50
"""Steps over which states are predicted."""

LOADS: tuple[Metric, ...] = (
    Metric(name="force", words="force", unit="N", shown="N"),
    Metric(name="force_xy", words="force xy", unit="N", shown="N"),
    Metric(name="force_z", words="force z", unit="N", shown="N"),
    Metric(name="moment", words="moment", unit="N m", scale=1e3, shown="mN m"),
    Metric(name="moment_xy", words="moment xy", unit="N m", scale=1e3, shown="mN m"),
    Metric(name="moment_z", words="moment z", unit="N m", scale=1e3, shown="mN m"),
)
"""Root mean squares of the length of the error vector, over all samples."""

_UNITS = {"position": "m", "displacement": "m", "velocity": "m/s", "attitude": "rad", "rates": "rad/s"}

RATIOS: tuple[Metric, ...] = tuple(Metric(name=name, words=name, unit="1") for name in _UNITS)
"""Mean errors summed over 1 to 50 steps, over those of a state that is kept."""

SUMS: tuple[Metric, ...] = tuple(
    Metric(name=f"{name}_sum", words=f"{name}, sum", unit=unit, shown=unit) for name, unit in _UNITS.items()
)
"""The same sums in units, as nonlinearbenchmark.org collects them."""

METRICS: Mapping[Kind, tuple[Metric, ...]] = MappingProxyType({"loads": LOADS, "steps": (*RATIOS, *SUMS)})
"""All metrics of a kind."""

SHOWN: Mapping[Kind, tuple[Metric, ...]] = MappingProxyType(
    {"loads": tuple(metric for metric in LOADS if "_" not in metric.name), "steps": RATIOS}
)
"""Metrics that a terminal shows."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Published:
    """Errors that others have published.

    Parameters
    ----------
    model
        Whose they are.
    source
        Where they stand, and on which flights they were had.
    values
        Metric to value.
    """

    model: str
    source: str
    values: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class Benchmark:
    """A public benchmark.

    Parameters
    ----------
    title
        In words.
    pattern
        Of the names of its files, with the name of the flight as first group.
    address
        Where a user downloads the files.
    license
        Of the data, as their authors state it.
    citation
        Of the benchmark.
    hashes
        Flight to the SHA-256 of its unpacked file, of those that are known.
    test
        How the names of the flights begin that the authors keep for the test; empty where they have no split.
    unfair
        What makes rows less comparable than they look.
    """

    name: str
    title: str
    kind: Kind
    pattern: str
    address: str
    license: str
    citation: str
    hashes: Mapping[str, str]
    test: str = ""
    published: tuple[Published, ...] = ()
    unfair: tuple[str, ...] = ()


_NEUROBEM = Benchmark(
    name="neurobem",
    title="NeuroBEM: force and moment of a racing quadrotor",
    kind="loads",
    pattern=r"(?:neurobem_|bemnn)?(\d{14}seg\d+)\.mat",
    address="github.com/RCL-NUS/NeuroMHE at 64e184c0, SecVII-A (source code)/Check_RMSE/"
    "MATLAB_code_for_mass_verification/bemnn*.mat (data of rpg.ifi.uzh.ch/neuro_bem)",
    license="none stated",
    citation="Bauersfeld et al., NeuroBEM: Hybrid Aerodynamic Quadrotor Model, Robotics: Science and Systems 2021",
    hashes=MappingProxyType(
        {
            "20210218171908seg2": "9a150d9d82f76c4657af8cf777cefb53774e12cdc17659c161b7f919ac8c44e9",
            "20210223104803seg2": "9eb3e52576ac41462141e9072ace3cfad3d30c47347f9663e61b4d3f44f23704",
            "20210223114138seg3": "59ba0bc0b93b380928162098b4ee24a1687e210bd7a8661783dded61c2293491",
        }
    ),
    unfair=(
        "NeuroBEM's network was trained on other flights of the set, far more than a fit has here.",
        "A differentiator knows velocities and rates of the last 10 ms. Models with past states as inputs can learn "
        "that, so compare them with its row.",
    ),
)

_BUSETTO = "Busetto et al., Control Engineering Practice 172 (2026) 106871"

_IDSIA = Benchmark(
    name="idsia",
    title="IDSIA: a nano quadrotor over half a second",
    kind="steps",
    pattern=r"(?:idsia_)?((?:square|random\d?|melon|multisine|chirp)_\d{8}_run\d+)\.(?:parquet|csv)",
    address="github.com/idsia-robotics/nanodrone-sysid-benchmark, data",
    license="none stated",
    citation=f"{_BUSETTO}, arXiv:2512.14450",
    hashes=MappingProxyType(
        {
            "multisine_20251017_run3": "9dbc3aa2fd54c578ab4ef58a44d3e339909758873af1f6aff601aff2ff501fb6",
            "multisine_20251017_run4": "18fae690107fe7838268aaa4af018fe41844aec85f2ee9f8048de1da37ad18a6",
            "random1_20251017_run4": "436921f82cee0451c29dadfd240e9a578216d0dece2f7b376359db59ca7ab10b",
            "random2_20251017_run2": "2e35dea39aa367a034e446600e73e9fc591fa22de4a26bcbdfe94b93a3ac4572",
            "square_20251017_run1": "a089ce109bd04213d04c4ab54e55f19456b783bd26792a0fc0f3967d6fb6c838",
            "square_20251017_run3": "288f61c42e5d4a4e189c66aecc3e5c989784a43bb0bac0eb8d9e5b68035f0412",
        }
    ),
    test="melon",
    published=(
        Published(
            model="best published, of each quantity",
            source=f"{_BUSETTO}; on its own test runs (melon)",
            values=MappingProxyType({"position": 0.13, "velocity": 0.27, "attitude": 0.62, "rates": 1.0}),
        ),
    ),
    unfair=(
        "Published rows are the best of several models, each quantity of another one.",
        "The authors' program joins runs before it compares, so that some windows cross their ends. Here none does.",
        "Wind, skew and center of gravity of a test run are found from that run, for models of rotorid alone.",
        "The logged position moves 10 to 15 % more or less than the integral of the logged velocity. Displacement "
        "compares with the integral, position with the log.",
    ),
)

_NANOBENCH = Benchmark(
    name="nanobench",
    title="NanoBench: a Crazyflie 2.1 over half a second",
    kind="steps",
    pattern=r"(?:nanobench_)?([A-C]\d+b?_\w+_rep\d+)\.csv",
    address="github.com/syediu/nanobench-iros2026, datasets/dataset",
    license="BSD-3-Clause",
    citation="Ullah and Baca, NanoBench, arXiv:2603.09908",
    hashes=MappingProxyType(
        {
            "B2_circle_fast_rep2": "0f3c20f91b466a4050f223120d46d332c65c88ff3870b430d832385abb7c08ae",
            "B3_figure8_fast_rep2": "19572a96f0b2a054a21d20b67797e16cc1f90e287286fa0fade30cea40de2bf4",
            "B6_linear_ramp_rep1": "a4d1281854d937c94680ed8b49e176a1ac612c994c01d88964dff6689e73199a",
            "B8_star_fast_rep1": "a2134e0d4e814deefb916f7034cddbcf5b5033d326545063378a383e0f2d85e9",
        }
    ),
    unfair=(
        "There is no published row: the authors' repository has no table of these errors.",
        "Motors are known by their commands, so the speeds in a window include a lag that was fitted on other flights.",
    ),
)

BENCHMARKS: Mapping[str, Benchmark] = MappingProxyType({found.name: found for found in (_NEUROBEM, _IDSIA, _NANOBENCH)})
"""By name."""


def benchmark_named(name: str) -> Benchmark:
    """The benchmark of a name.

    Raises
    ------
    UsageError
        There is none.

    Examples
    --------
    >>> benchmark_named("idsia").license
    'none stated'
    """
    if name not in BENCHMARKS:
        raise unknown_name("benchmark", name, BENCHMARKS, synonyms=synonyms.BENCHMARKS)
    return BENCHMARKS[name]
