"""Choices of ``identify``: which models, and how they are fitted."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from rotorid.data.base import Immutable
from rotorid.errors import UsageError
from rotorid.settings.measuring import MeasureSettings, SensorFilters
from rotorid.settings.models import models_known
from rotorid.settings.option import Option, Written, as_names, require_workers
from rotorid.settings.parsing import (
    CONSTANTS,
    FIXED,
    KNOWN,
    LISTED,
    NAMES,
    PAIRS,
    PATHS,
    TIES,
    WEIGHTS,
    WORDS,
)

if TYPE_CHECKING:
    from rotorid.settings.motors import ChosenCurve

WeightsChoice: TypeAlias = Literal["auto", "cifer", "covariance"]
SpeedDamping: TypeAlias = Literal["joint", "two_step", "two_step_force"]

FIRST_RESPONSES = {"X_u": ("u_dot", "theta"), "Y_v": ("v_dot", "phi")}
"""Speed damping to the response that shows it in a first step of its own."""
MethodChoice: TypeAlias = Literal[
    "auto", "frequency", "output_error", "prediction_error", "equation_error", "accelerations"
]
HoldChoice: TypeAlias = Literal["auto", "zero", "first"]

EVALUATIONS = 2000
"""Budget of a search unless another is asked for."""

NOISE_RUNS = 20
"""Runs with artificial noise unless another number is asked for."""

_FEWEST_RUNS = 2
_MOST_NOISE_PERCENT = 1000.0


def require_search(search: str | None, evaluations: int | None, starts: str, runs: int | None = None) -> None:
    """Raise for searches that do not exist, and for options that need a search.

    Parameters
    ----------
    search
        A name of :func:`rotorid.search.catalog.searches` with its options.
    evaluations
        Its budget, where one was asked for.
    starts
        The design of starts, ``default`` for none.
    runs
        How often it is repeated, where that was asked for.

    Raises
    ------
    UsageError
        There is no such search, or the options contradict each other.
    """
    if search is None:
        if evaluations is not None:
            raise UsageError("--evaluations needs a search", remedy="add --search NAME")
        if runs is not None:
            raise UsageError(
                "--runs needs a search or noise", remedy="add --search NAME, such as genetic:15x50, or --add-noise 5"
            )
        return
    _require_enough(runs)
    if starts != "default":
        raise UsageError("--search and --starts exclude each other", remedy="use one of them")
    if evaluations is not None and evaluations < 1:
        raise UsageError(f"--evaluations {evaluations} is too few", needed="1 or more")
    from rotorid.search.catalog import search as known

    known(search)


def _require_enough(runs: int | None) -> None:
    if runs is not None and runs < _FEWEST_RUNS:
        raise UsageError(f"--runs {runs} is too few", needed="2 or more, and some hundred for a table")


def require_runs(runs: int | None) -> None:
    """Raise for a bootstrap of less than two runs.

    Raises
    ------
    UsageError
        There are fewer.
    """
    if runs is not None and runs < _FEWEST_RUNS:
        raise UsageError(f"--bootstrap {runs} is too few", needed="2 or more, and some hundred for intervals")


_STARTS = re.compile(r"default|central|(sobol|random):[1-9]\d*")


@dataclass(frozen=True, kw_only=True)
class IdentifySettings(MeasureSettings):
    """Choices of one run of ``identify``.

    Parameters
    ----------
    band_rad_s, windows_s, input_windows_s, composition, taper, overlap
        As in :class:`MeasureSettings`.
    coherence, estimate, instruments, segments, shifts, seed
        As in :class:`MeasureSettings`.
    fix
        Parameters held at given values.
    known
        Value and standard deviation of what no log shows, such as an inertia or the speed of the rotors, from which
        more follows; see :mod:`rotorid.models.derived`.
    ties
        Parameters that follow others: name to an expression such as ``-L_p``.
    correct_filters
        Take known filters of the autopilot off the outputs, so that the model is that of the vehicle alone.
    filters
        Filters that channels have passed besides, by channel; they are taken off too.
    correct_sensors
        Estimate scale, bias, misalignment and place of rate gyros and accelerometer by the kinematics, and take them
        out before anything is measured.
    free
        Parameters to free again that the model holds.
    constants
        Constants of the model, such as the trim ``theta0``, in place of what the record shows.
    outputs
        Outputs to fit; by default those that the log holds as sensors measured them.
    pairs
        Responses ``output/input`` to fit, each with its band or ``None``; by default all that are coherent.
    pair_weights
        Response to a factor on its cost.
    weights
        ``cifer`` minimizes CIFER's cost; ``covariance`` goes on from there with weights made of the measured covariance
        of all errors; ``auto`` does so where several outputs are fitted.
    reduce
        Drop step by step what the data do not show.
    speed_damping
        ``two_step`` takes X_u and Y_v from the responses of u_dot to theta and v_dot to phi before everything else;
        ``two_step_force`` does so with the force of the command, which ``two_step`` neglects.
    method
        ``frequency`` fits responses; ``output_error``, ``prediction_error`` and ``equation_error`` fit time histories;
        ``auto`` takes output error for responses to set-points and black boxes, and responses for all other models.
    hold
        What inputs do between their samples in a time-domain fit: ``zero`` order, ``first`` order, or ``auto``: zero
        for commands that stand in the log at the rate of the fit, first for all others.
    pieces_s
        Length of the pieces in which a time-domain fit begins anew; by default whole records for stable models.
    starts
        Where time-domain searches begin: ``default``, ``central`` (composite design), ``sobol:N`` or ``random:N``.
    search
        A global search before the fit, by its name in :func:`rotorid.search.catalog.searches` with its options.
    evaluations
        Its budget; by default 2000.
    runs
        How often the search is repeated with other seeds, to see how much its results scatter; with
        ``add_noise_percent`` how often noise is added.
    add_noise_percent
        Artificial noise on the sensors, in percent of the rms of each about its mean; each run identifies anew.
    workers
        Processes that share out runs and bootstraps; ``None`` for none. The answer does not depend on their number.
    bootstrap
        Number of refits with new noise, for standard deviations next to the stated ones.
    layout, arm_m, curve, rotor_diameter_m
        Of ``physical.motors``, as in :class:`~rotorid.settings.motors.MotorSettings`; all but ``curve`` of
        ``physical.hover`` too, which has its arm and the diameter of its propellers from them.
    predictor
        Whether ``physical.flight`` also fits numbers that predict its closed loop best, which are never exported.
    """

    fix: Annotated[Mapping[str, float], Option("--fix", "Fix a parameter at a value. Repeatable.", "Models", FIXED)] = (
        field(default_factory=dict)
    )
    known: Annotated[
        Mapping[str, tuple[float, float]],
        Option(
            "--known",
            "Give a value that logs cannot show, such as I_zz=0.012:0.0004, to derive thrust and rotors. Repeatable.",
            "Models",
            KNOWN,
        ),
        Written("given"),
    ] = field(default_factory=dict)
    ties: Annotated[Mapping[str, str], Option("--tie", "Tie a parameter to others. Repeatable.", "Models", TIES)] = (
        field(default_factory=dict)
    )
    correct_filters: Annotated[
        bool,
        Option(
            "--correct-filters",
            "Remove known autopilot filters from the outputs, so that the model excludes them.",
            "Data",
        ),
        Written("given"),
    ] = False
    filters: SensorFilters = field(default_factory=dict)
    correct_sensors: Annotated[
        bool,
        Option(
            "--correct-sensors",
            "Estimate and remove scale, bias, misalignment and position of the sensors.",
            "Data",
        ),
        Written("given"),
    ] = False
    free: Annotated[
        tuple[str, ...], Option("--free", "Fit a parameter that the model fixes. Repeatable.", "Models", WORDS)
    ] = ()
    constants: Annotated[
        Mapping[str, float],
        Option("--constant", "Set a constant of the model, such as theta0. Repeatable.", "Models", CONSTANTS),
    ] = field(default_factory=dict)
    outputs: Annotated[
        tuple[str, ...],
        Option("--outputs", "Channels to fit. [default: all logged sensors]", "Models", NAMES, metavar="CHANNEL,..."),
    ] = ()
    pairs: Annotated[
        Mapping[str, tuple[float, float] | None],
        Option("--pair", "Fit only this response, in this band. Repeatable.", "Models", PAIRS),
    ] = field(default_factory=dict)
    pair_weights: Annotated[
        Mapping[str, float], Option("--weight", "Weigh a response in the cost. Repeatable.", "Models", WEIGHTS)
    ] = field(default_factory=dict)
    weights: Annotated[
        WeightsChoice,
        Option(
            "--weights",
            "Weights of the cost: CIFER's, or the measured covariance; auto decides by the number of outputs.",
            "Models",
        ),
    ] = "auto"
    reduce: Annotated[bool, Option("--reduce", "Drop parameters that the data do not need.", "Models")] = False
    speed_damping: Annotated[
        SpeedDamping, Option("--speed-damping", "Fit X_u and Y_v together with all others, or first.", "Models")
    ] = "joint"
    method: Annotated[
        MethodChoice,
        Option(
            "--method",
            "Fit method; auto is output_error for response.* and black_box:N, frequency for others. "
            "physical.motors takes prediction_error or accelerations.",
            "Fit",
        ),
    ] = "auto"
    hold: Annotated[
        HoldChoice,
        Option("--hold", "Hold of inputs between samples, for fits in time; auto is zero for commands.", "Fit"),
    ] = "auto"
    pieces_s: Annotated[
        float | None,
        Option(
            "--pieces", "Restart a fit in time after so many seconds. [default: whole records of stable models]", "Fit"
        ),
    ] = None
    starts: Annotated[
        str, Option("--starts", "Starting points of fits in time.", "Fit", metavar="default|central|sobol:N|random:N")
    ] = "default"
    search: Annotated[
        str | None,
        Option(
            "--search",
            "Global search before the fit: evolution[:POPULATION] (when in doubt), cma[:POPULATION], "
            "genetic[:POPULATIONxGENERATIONS], kmeans[:CANDIDATES], sobol[:STARTS], random[:STARTS] or central. "
            "[default: none]",
            "Fit",
            metavar="NAME[:OPTIONS]",
        ),
    ] = None
    evaluations: Annotated[
        int | None, Option("--evaluations", f"Most cost evaluations of --search. [default: {EVALUATIONS}]", "Fit")
    ] = None
    runs: Annotated[
        int | None,
        Option(
            "--runs",
            f"Repeat --search from so many seeds, or --add-noise so often. [default with --add-noise: {NOISE_RUNS}]",
            "Fit",
        ),
        Written("given"),
    ] = None
    add_noise_percent: Annotated[
        float | None,
        Option(
            "--add-noise",
            "Identify again with noise on all sensors, in percent of the rms of each; see --runs.",
            "Fit",
            metavar="PERCENT",
        ),
        Written("given"),
    ] = None
    workers: Annotated[
        int | None,
        Option(
            "--workers",
            "Processes for --runs, --bootstrap and several models. [default: one per core for --runs]",
            "Fit",
        ),
        Written("never"),
    ] = None
    bootstrap: Annotated[
        int | None,
        Option(
            "--bootstrap",
            "Refit so many times to simulated noise, for standard deviations and intervals (200 or more).",
            "Fit",
        ),
    ] = None
    layout: Annotated[
        str | None,
        Option(
            "--layout",
            "Rotor layout of physical.*: quad.x, hexa.plus, ... or a file. [default: from the log]",
            "Models in physical parameters",
            metavar="NAME|FILE.toml",
        ),
        Written("never"),
    ] = None
    arm_m: Annotated[
        float | None,
        Option(
            "--arm",
            "Distance from the center of gravity to the farthest rotor, for physical.*.",
            "Models in physical parameters",
        ),
        Written("never"),
    ] = None
    curve: Annotated[
        "ChosenCurve",
        Option(
            "--curve",
            "Thrust curve of physical.motors.",
            "Models in physical parameters",
            words=("auto", "linear", "quadratic", "affine", "polynomial"),
        ),
        Written("never"),
    ] = "auto"
    rotor_diameter_m: Annotated[
        float | None,
        Option(
            "--rotor-diameter",
            "Rotor diameter, to check thrust against logged rotor speed; D of physical.hover.",
            "Models in physical parameters",
        ),
        Written("never"),
    ] = None
    predictor: Annotated[
        bool,
        Option(
            "--predictor",
            "Also fit numbers that predict this closed loop best; never exported. For physical.flight.",
            "Models in physical parameters",
        ),
        Written("never"),
    ] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        mappings = ("fix", "known", "ties", "constants", "pairs", "pair_weights")
        self._set(
            free=as_names(self.free), outputs=as_names(self.outputs), **{name: getattr(self, name) for name in mappings}
        )
        for name in {*self.fix, *self.ties, *self.free}:
            if sum(name in group for group in (self.fix, self.ties, self.free)) > 1:
                raise UsageError(f"{name} has more than one of --fix, --tie and --free", remedy="use one of them")
        if self.pieces_s is not None and not 0.0 < self.pieces_s < math.inf:
            raise UsageError(f"--pieces {self.pieces_s:g} is not a length", needed="more than 0 s")
        if not _STARTS.fullmatch(self.starts):
            raise UsageError(f"unknown --starts {self.starts!r}", needed="default, central, sobol:N or random:N")
        noise = self.add_noise_percent
        if noise is not None and not 0.0 < noise <= _MOST_NOISE_PERCENT:
            raise UsageError(f"--add-noise {noise:g} is out of range", needed="percent above 0, such as 5")
        if noise is not None:
            _require_enough(self.runs)
        require_search(self.search, self.evaluations, self.starts, None if noise is not None else self.runs)
        require_runs(self.bootstrap)
        require_workers(self.workers)


@dataclass(frozen=True, kw_only=True)
class ModelSettings(Immutable):
    """Which models are identified, and which logs validate them."""

    models: Annotated[
        tuple[str, ...],
        Option(
            "--model",
            "Model to identify: rate.roll, hover.lateral, ... (see rotorid models) or a file; "
            "all tries every model. Several with commas.",
            "Models",
            LISTED,
            metavar="NAME|FILE.toml,...",
            words=models_known,
        ),
    ]
    verify: Annotated[
        tuple[Path, ...],
        Option("--verify", "Log to validate the model on; it is not fitted. Repeatable.", "Judging", PATHS),
    ] = ()
    inputs: Annotated[
        tuple[str, ...],
        Option(
            "--inputs",
            "Input channels of response.*, transfer:m/n and black_box:N.",
            "Models",
            NAMES,
            metavar="CHANNEL,...",
        ),
    ] = ()
    decoupled: Annotated[
        bool, Option("--decoupled", "Fit a separate black box for each input and its output.", "Models")
    ] = False
    cross_validate: Annotated[
        str | None,
        Option(
            "--cross-validate",
            "Identify on each log and score on the others, or leave one out and score on it.",
            "Judging",
            words=("each", "leave_one_out"),
        ),
    ] = None

    @property
    def beside(self) -> dict[str, object]:
        """Options that need a single linear model."""
        return {
            "--cross-validate": self.cross_validate,
            "--inputs": self.inputs,
            "--decoupled": self.decoupled,
        }
