"""The report on identifications: a section for each model, with its tables, sentences and pictures.

A section has parameters, costs, responses, poles and matrices, delays, correlated parameters, the steps of a reduction,
the minima of a search and the spread of a bootstrap, where the result has them. :mod:`rotorid.report.words` explains
the numbers; :mod:`rotorid.report.parts` has the parts that other pages share.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.display import counted, listed
from rotorid.data.quantity import (
    MISSING,
    error_columns,
    milliseconds,
    minus,
    percent,
    significant,
    unit,
    with_error,
    with_interval,
)
from rotorid.data.trust import BOUNDS_MEANING
from rotorid.documents.base import FindingDocument
from rotorid.documents.result import ResultDocument
from rotorid.errors import UsageError
from rotorid.models.library import SPIN_UP
from rotorid.plot.curves import Frequency, View
from rotorid.plot.figure import Figure, quantity
from rotorid.plot.loops import correlation_map
from rotorid.plot.search import clusters, convergence, noise_spread, run_histogram
from rotorid.report.derived import DerivedShown, derived_shown
from rotorid.report.findings import FindingRow, finding_rows
from rotorid.report.flight import FlightShown, flight_shown
from rotorid.report.frame import Picture, drawn, over_frequency, render
from rotorid.report.motors import MotorsShown, motors_shown
from rotorid.report.parts import (
    Cell,
    CostRow,
    Dropped,
    ManeuverRow,
    ParameterGroup,
    RangeRow,
    Shown,
    constants_sentence,
    cost_rows,
    dropped_parameters,
    maneuver_row,
    model_pictures,
    parameter_groups,
    range_rows,
    timelines,
    truth_of_dropped,
)
from rotorid.report.time import Crossed, TimeFits, crossed, time_fits
from rotorid.report.verification import Check, UnseenSweeps, check_section, unseen_sweeps
from rotorid.report.words import (
    PoleRow,
    document_verdict,
    fit_sentences,
    has_held_out_costs,
    pole_rows,
    poles_picture,
    poles_sentence,
    result_sentences,
    several_sentences,
    sparkline,
    summary,
    time_sentences,
    worst_maneuver,
    worst_record,
)
from rotorid.results.model import IdentifiedModel, Refused
from rotorid.results.summary import (
    BootstrapSummary,
    Correlation,
    DelayBudget,
    NoiseRuns,
    NoiseSpread,
    ReductionStep,
    RunSpread,
    SearchRuns,
    SearchSummary,
)
from rotorid.results.verdicts import LEVELS, Verdict, badge, cost_verdict, refused_verdict
from rotorid.search.catalog import POPULATIONS
from rotorid.search.result import Progress


@dataclass(frozen=True, kw_only=True, slots=True)
class MatrixTable:
    """One matrix of ``M x' = F x + G u(t - tau)``, ``y = H0 x + H1 x'``."""

    symbol: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[str, ...]], ...]


def matrix_tables(document: ResultDocument) -> tuple[MatrixTable, ...]:
    """All matrices but those that are zero or the identity.

    Columns of rows are named after states, inputs and outputs where their number fits.
    """
    if document.matrices is None:
        return ()
    matrices, states = document.matrices, document.states
    shapes = (
        ("M", matrices.M, states, states),
        ("F", matrices.F, states, states),
        ("G", matrices.G, states, document.inputs),
        ("H0", matrices.H0, document.outputs, states),
        ("H1", matrices.H1, document.outputs, states),
    )
    return tuple(
        _table(symbol, matrix, rows, columns) for symbol, matrix, rows, columns in shapes if not _plain(matrix)
    )


def _plain(matrix: Sequence[Sequence[float]]) -> bool:
    """Whether a matrix is empty, zero or the identity."""
    entries = [(i, j, value) for i, row in enumerate(matrix) for j, value in enumerate(row)]
    square = len(matrix) == len(matrix[0]) if matrix else True
    identity = square and all(value == float(i == j) for i, j, value in entries)
    return identity or all(value == 0.0 for _, _, value in entries)


def _table(symbol: str, matrix: Sequence[Sequence[float]], rows: Sequence[str], columns: Sequence[str]) -> MatrixTable:
    return MatrixTable(
        symbol=symbol,
        columns=_named(columns, len(matrix[0])),
        rows=tuple(
            (name, tuple(significant(value, digits=4) for value in row))
            for name, row in zip(_named(rows, len(matrix)), matrix, strict=True)
        ),
    )


def _named(names: Sequence[str], count: int) -> tuple[str, ...]:
    return tuple(names) if len(names) == count else tuple(str(number) for number in range(1, count + 1))


@dataclass(frozen=True, kw_only=True, slots=True)
class DelayRow:
    """The way from one input to all outputs that share its delays, in milliseconds."""

    input: str
    outputs: str
    before: str
    motor: str
    after: str
    total: str
    known: str


def delay_rows(document: ResultDocument) -> tuple[DelayRow, ...]:
    """One row for each input and each budget; outputs that share a budget share a row."""
    return tuple(
        DelayRow(
            input=name,
            outputs=", ".join(outputs),
            before=milliseconds(budget.input_delay_s),
            motor=milliseconds(budget.motor_lag_s),
            after=milliseconds(budget.output_delay_s),
            total=milliseconds(budget.total_s, budget.total_std_s),
            known=MISSING if budget.known_filters_s is None else milliseconds(budget.known_filters_s),
        )
        for name, outputs, budget in _ways(document)
    )


def delay_sentence(document: ResultDocument) -> str:
    """The delay of the vehicle after each input; of outputs with their own budget, the first counts.

    Empty where the spin-up of rotors answers first, because the delays are then not those of the vehicle.

    Examples
    --------
    >>> budget = DelayBudget(
    ...     input_delay_s=0.03, motor_lag_s=0.01, output_delay_s=0.0, total_s=0.04, total_std_s=0.0004)
    >>> delay_sentence(ResultDocument.model_construct(delays={"q/pitch_command": budget}))
    'The vehicle responds to the pitch command after 40.0 ± 0.4 ms.'
    """
    delay_words: dict[str, str] = {}
    for name, outputs, budget in _ways(document):
        if name not in delay_words and not ("r" in outputs and name == "yaw_command" and _spins_up(document)):
            delay_words[name] = (
                f"the {quantity(name).words} after {milliseconds(budget.total_s, budget.total_std_s)} ms"
            )
    return f"The vehicle responds to {listed(list(delay_words.values()))}." if delay_words else ""


def _spins_up(document: ResultDocument) -> bool:
    """Whether yaw answers to the spin-up of rotors before it answers to their torque."""
    lead = getattr(document, "parameters", {}).get(SPIN_UP)
    return lead is not None and lead.status != "dropped" and lead.value != 0.0


def _ways(document: ResultDocument) -> list[tuple[str, list[str], DelayBudget]]:
    """Input, outputs and what they share, inputs together."""
    ways: dict[tuple[str, DelayBudget], list[str]] = {}
    names = _inputs(document.delays)
    for name in names:
        for pair, budget in document.delays.items():
            output, _, input = pair.partition("/")
            if input == name:
                ways.setdefault((name, budget), []).append(output)
    return [(name, outputs, budget) for (name, budget), outputs in ways.items()]


def _inputs(pairs: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(pair.partition("/")[2] for pair in pairs))


HIGH = 0.9
"""Correlation beyond which two parameters are named."""

_LEAST_DRAWN = 5
"""Number of parameters from which correlations are drawn."""

_MOST_LISTED = 8
"""Pairs that are named; the others are counted."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Together:
    """Two parameters and how their estimates go together."""

    first: str
    second: str
    correlation: float

    @property
    def words(self) -> str:
        """The pair in words."""
        return minus(f"{self.first} and {self.second}: {self.correlation:.2f}")


def correlation_sentence(correlation: Correlation | None) -> str:
    """Pairs of parameters that are correlated by more than 0.9, or else the highest correlation of all.

    Examples
    --------
    >>> correlation_sentence(Correlation(names=("M_q", "M_u"), matrix=((1.0, -0.93), (-0.93, 1.0))))
    'Correlated by more than 0.9 (an error in one is an error in the other): M_q and M_u: −0.93.'
    """
    pairs = _pairs(correlation) if correlation else []
    if not pairs:
        return ""
    high = [pair for pair in pairs if abs(pair.correlation) > HIGH]
    if not high:
        return f"No parameters are correlated by more than {HIGH:g}. Highest: {pairs[0].words}."
    correlation_words = "; ".join(pair.words for pair in high[:_MOST_LISTED])
    more = f"; and {len(high) - _MOST_LISTED} more" if len(high) > _MOST_LISTED else ""
    return f"Correlated by more than {HIGH:g} (an error in one is an error in the other): {correlation_words}{more}."


def correlation_picture(correlation: Correlation | None, *, key: str) -> Picture | None:
    """The map of correlations; none of up to four parameters, for which words do."""
    if correlation is None or len(correlation.names) < _LEAST_DRAWN:
        return None
    return Picture(
        key=key,
        description="Correlation of every two parameters as a map",
        figure=drawn(correlation_map, correlation.names, np.array(correlation.matrix, dtype=np.float64)),
    )


def _pairs(correlation: Correlation) -> list[Together]:
    """Every two parameters, the strongest first; a correlation that is no number is left out."""
    names = correlation.names
    pairs = [
        Together(first=names[column], second=name, correlation=row[column])
        for number, (name, row) in enumerate(zip(names, correlation.matrix, strict=True))
        for column in range(number)
        if np.isfinite(row[column])
    ]
    return sorted(pairs, key=lambda pair: -abs(pair.correlation))


_SOURCES = {
    "responses": "random errors of the responses with their covariance",
    "outputs": "noise of the outputs with the spectrum of the residuals",
}


@dataclass(frozen=True, kw_only=True, slots=True)
class SpreadLine:
    """A parameter over all runs; ``std`` is marked where it, or the mean, contradicts what is stated."""

    name: str
    unit: str
    value: str
    stated: str
    mean: str
    std: Cell
    relative: str
    interval: str


@dataclass(frozen=True, kw_only=True, slots=True)
class BootstrapShown:
    """A bootstrap on the page."""

    words: str
    rows: tuple[SpreadLine, ...]


def bootstrap_shown(document: ResultDocument) -> BootstrapShown | None:
    """What to show of a bootstrap; nothing where none was made."""
    again = document.bootstrap
    if again is None:
        return None
    disagrees = {finding.where for finding in document.findings if finding.kind == "bootstrap_disagrees"}
    return BootstrapShown(
        words=_bootstrap_words(again),
        rows=tuple(_line(document, again, name, name in disagrees) for name in again.parameters),
    )


def _line(document: ResultDocument, again: BootstrapSummary, name: str, disagrees: bool) -> SpreadLine:
    estimate, spread = document.parameters[name], again.parameters[name]
    value, stated = error_columns(estimate.value, estimate.std)
    mean, std = error_columns(spread.mean, spread.std)
    return SpreadLine(
        name=name,
        unit=unit(estimate.unit),
        value=value,
        stated=stated,
        mean=mean,
        std=Cell(std, disagrees),
        relative=percent(spread.relative_percent),
        interval=with_interval(spread.mean, spread.low, spread.high)[1],
    )


def _bootstrap_words(again: BootstrapSummary) -> str:
    left = sum(again.left_out.values())
    without = f" {left} did not converge and {'is' if left == 1 else 'are'} not counted." if left else ""
    return f"{again.runs} refits, each to newly drawn {_SOURCES[again.source]}.{without}"


@dataclass(frozen=True, kw_only=True, slots=True)
class NoiseLine:
    """A parameter over runs with artificial noise; ``bias`` is marked where it is more than chance."""

    name: str
    unit: str
    value: str
    stated: str
    mean: str
    std: str
    bias: Cell


@dataclass(frozen=True, kw_only=True, slots=True)
class NoiseShown:
    """Runs with artificial noise on the page."""

    words: str
    rows: tuple[NoiseLine, ...]
    picture: Picture | None


def noise_shown(document: ResultDocument, *, key: str) -> NoiseShown | None:
    """What to show of runs with artificial noise; nothing where none were made."""
    if (runs := document.noise_runs) is None:
        return None
    biased = {finding.where for finding in document.findings if finding.kind == "noise_bias"}
    return NoiseShown(
        words=f"{runs.words} about its mean, each identified from the log on.",
        rows=tuple(_noise_line(name, spread, name in biased) for name, spread in runs.parameters.items()),
        picture=_noise_picture(runs, key),
    )


def _noise_line(name: str, spread: NoiseSpread, biased: bool) -> NoiseLine:
    value, stated = error_columns(spread.value, spread.stated_std)
    mean, std = error_columns(spread.mean, spread.std)
    return NoiseLine(
        name=name,
        unit=unit(spread.unit),
        value=value,
        stated=stated,
        mean=mean,
        std=std,
        bias=Cell(with_error(spread.bias, spread.bias_std), biased),
    )


def _noise_picture(runs: NoiseRuns, key: str) -> Picture | None:
    shown = {name: spread for name, spread in runs.parameters.items() if spread.stated_std}
    if not shown:
        return None
    return Picture(
        key=key,
        description=f"{runs.words}: each run, in stated standard deviations from the value without noise",
        figure=drawn(
            noise_spread,
            {name: np.array([value for value in runs.draws[name] if value is not None]) for name in shown},
            values={name: spread.value for name, spread in shown.items()},
            stds={name: spread.stated_std or 1.0 for name, spread in shown.items()},
        ),
    )


_MOST_ROWS = 12
_COSTS = {
    "frequency": "CIFER's cost, summed over the responses",
    "output_error": "the sum of squared output errors, each output relative to its size",
    "accelerations": "the mean absolute error of accelerations, each relative to its deviations from the mean",
}


@dataclass(frozen=True, kw_only=True, slots=True)
class BasinRow:
    """A minimum: its cost, the percent of local searches that ended there, its parameters."""

    cost: str
    share: str
    values: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class RunRow:
    """A number over runs from other seeds: name, then mean, deviation, least, largest alone and after polishing."""

    name: str
    alone: tuple[str, ...]
    polished: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class SearchShown:
    """A search on the page."""

    words: str
    minima_words: str
    names: tuple[str, ...]
    rows: tuple[BasinRow, ...]
    more: int
    population: bool
    picture: Picture | None
    alone: tuple[str, ...] = ()
    run_words: str = ""
    run_rows: tuple[RunRow, ...] = ()
    run_picture: Picture | None = None
    cluster_picture: Picture | None = None

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All, as far as there are any."""
        return tuple(
            picture for picture in (self.picture, self.cluster_picture, self.run_picture) if picture is not None
        )


def search_shown(document: SearchSummary | None, *, key: str) -> SearchShown | None:
    """What to show of a search; nothing where none was made.

    Parameters
    ----------
    key
        Identifier of its picture.
    """
    if document is None:
        return None
    minima = document.minima
    names = tuple(minima[0].parameters)
    rows = tuple(
        BasinRow(
            cost=significant(minimum.cost, digits=5),
            share=percent(100.0 * minimum.share),
            values=tuple(significant(minimum.parameters[name], digits=4) for name in names),
        )
        for minimum in minima[:_MOST_ROWS]
    )
    return SearchShown(
        words=_search_words(document),
        minima_words=_minima_words(document),
        names=names,
        rows=rows,
        more=max(len(minima) - _MOST_ROWS, 0),
        population=document.name.partition(":")[0] in POPULATIONS,
        picture=_picture(document, key),
        cluster_picture=_cluster_picture(document, f"{key}-clusters"),
        alone=_search_only_row(document, names),
        run_words="" if document.runs is None else _run_words(document.name, document.runs),
        run_rows=() if document.runs is None else _run_rows(document.runs),
        run_picture=None if document.runs is None else _run_picture(document, document.runs, f"{key}-runs"),
    )


def _search_only_row(document: SearchSummary, names: Sequence[str]) -> tuple[str, ...]:
    """Cost and parameters where the search ended by itself."""
    if document.alone is None:
        return ()
    values = (significant(document.alone.parameters[name], digits=4) for name in names)
    return (significant(document.alone.cost, digits=5), *values)


def _run_words(name: str, runs: SearchRuns) -> str:
    left = sum(runs.left_out.values())
    without = f" {left} had no answer." if left else ""
    return (
        f"{name} from {runs.runs} other seeds on the same data: where it ended by itself, and after its local searches."
        f"{without} This is the scatter of the search, not the error of the values."
    )


def _run_rows(runs: SearchRuns) -> tuple[RunRow, ...]:
    def run_row(spread: RunSpread) -> tuple[str, ...]:
        ends = (significant(number, digits=4) for number in (spread.min, spread.max))
        return (*error_columns(spread.mean, spread.std), *ends)

    alone = {"cost": runs.alone.cost, **runs.alone.parameters}
    polished = {"cost": runs.polished.cost, **runs.polished.parameters}
    return tuple(
        RunRow(name=name, alone=run_row(spread), polished=run_row(polished[name])) for name, spread in alone.items()
    )


def _run_picture(document: SearchSummary, runs: SearchRuns, key: str) -> Picture | None:
    centers = {name: value for name, value in document.minima[0].parameters.items() if value != 0.0}
    if not centers:
        return None
    alone, polished = (
        {name: np.array(values) for name, values in table.draws.items()} for table in (runs.alone, runs.polished)
    )
    return Picture(
        key=key,
        description=f"Results of {runs.runs} runs of {document.name}, a histogram for each parameter",
        figure=drawn(run_histogram, alone, polished, centers=centers),
    )


def _search_words(document: SearchSummary) -> str:
    local = "1 local search" if document.local_searches == 1 else f"{document.local_searches} local searches"
    return (
        f"Before the fit, {document.name} minimized {_COSTS[document.objective]}: {document.evaluations} evaluations, "
        f"then {document.polishing} in {local}."
    )


def _minima_words(document: SearchSummary) -> str:
    count = len(document.minima)
    if count == 1:
        return "All converged local searches ended in the same minimum, where the fit started."
    starts = {
        "frequency": "the lowest",
        "output_error": "all of them, and from the initial values of the model",
        "accelerations": "the lowest",
    }
    return f"Local searches found {count} minima. The fit started from {starts[document.objective]}."


def _cluster_picture(document: SearchSummary, key: str) -> Picture | None:
    """Who owned which point at each iteration; nothing of a search that does not share the points."""
    steps = document.iterations
    if not steps:
        return None
    owners = np.array([step.owners for step in steps])
    of_responses = len(document.points) == owners.shape[1]
    places = np.array(
        [point.omega_rad_s for point in document.points] if of_responses else range(owners.shape[1]), dtype=np.float64
    )
    costs = [[np.nan if cluster.cost is None else cluster.cost for cluster in step.clusters] for step in steps]

    def draw(*, frequency: Frequency = "rad/s") -> Figure:
        return clusters(
            np.array(costs, dtype=np.float64),
            owners,
            places=View(frequency=frequency).across(places) if of_responses else places,
            place=f"Frequency [{frequency}]" if of_responses else "Number of the point",
            logarithmic=of_responses,
        )

    description = f"Cost and data points of each candidate of {document.name} over the iterations"
    return over_frequency(draw, key=key, description=description)


def _picture(document: SearchSummary, key: str) -> Picture | None:
    """The cost over the evaluations; nothing where the first of them was the best."""
    costs = [best for _, best in document.trace]
    if not costs or max(costs) == min(costs):
        return None
    trace = [Progress(evaluations, best) for evaluations, best in document.trace]
    return Picture(
        key=key,
        description=f"Lowest cost so far over the evaluations of {document.name}, and the lowest minimum",
        figure=drawn(convergence, {document.name: trace}, levels={"lowest minimum": document.minima[0].cost}),
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class StepRow:
    """One parameter that was tested, and whether it was dropped."""

    anchor: str
    number: int
    parameter: str
    action: str
    reason: str
    cost: str
    cramer_rao: str
    insensitivity: str


def step_rows(steps: Sequence[ReductionStep], *, anchor: str) -> tuple[StepRow, ...]:
    """One row for each step, in order.

    Parameters
    ----------
    anchor
        Prefix of the identifiers of the section.
    """
    return tuple(
        StepRow(
            anchor=f"{anchor}-step-{number}",
            number=number + 1,
            parameter=step.parameter,
            action=step.action,
            reason=step.reason,
            cost=f"{significant(step.mean_cost_before)} → {significant(step.mean_cost_after)}"
            if step.mean_cost_after is not None
            else significant(step.mean_cost_before),
            cramer_rao=percent(step.cramer_rao_percent),
            insensitivity=percent(step.insensitivity_percent),
        )
        for number, step in enumerate(steps)
    )


def reduction_sentence(steps: Sequence[ReductionStep]) -> str:
    """How many parameters were dropped, and how the cost changed.

    Examples
    --------
    >>> step = ReductionStep(parameter="Z_q", action="dropped", reason="", value_before=0.0, insensitivity_percent=None,
    ...     cramer_rao_percent=None, mean_cost_before=0.221, mean_cost_after=0.222)
    >>> reduction_sentence([step])
    '1 of 1 tested parameter dropped; the mean cost changed from 0.221 to 0.222.'
    """
    if not steps:
        return ""
    dropped = [step for step in steps if step.action == "dropped"]
    sentence = f"{len(dropped) or 'None'} of {counted(len(steps), 'tested parameter')} dropped"
    if not dropped:
        return f"{sentence}."
    before, after = significant(steps[0].mean_cost_before), significant(dropped[-1].mean_cost_after)
    return f"{sentence}; the mean cost changed from {before} to {after}."


def repeats_steps(finding: FindingDocument, document: ResultDocument) -> bool:
    """Whether a finding only repeats the table of steps; warnings are always shown."""
    parameters = {step.parameter for step in document.reduction}
    return finding.kind == "dropped_parameter" and finding.severity == "info" and finding.where in parameters


@dataclass(frozen=True, kw_only=True)
class FitShown:
    """How the fit ended."""

    sentences: tuple[str, ...]
    curve: str


@dataclass(frozen=True, kw_only=True)
class Section:
    """One identification on the page."""

    anchor: str
    title: str
    document: ResultDocument
    result: str
    sentences: tuple[str, ...]
    cost: Verdict | None
    unseen: Verdict | None
    parameters: tuple[ParameterGroup, ...]
    dropped: tuple[Dropped, ...]
    truth_of_dropped: str
    bounds: str
    fit: FitShown | None
    costs: tuple[CostRow, ...]
    unseen_words: str
    responses: tuple[Picture, ...]
    folded_responses: tuple[Picture, ...]
    joint: bool
    least_coherence: float
    checks: tuple[Check, ...]
    sweeps: tuple[UnseenSweeps, ...]
    poles: tuple[PoleRow, ...]
    poles_words: str
    poles_picture: Picture | None
    matrices: tuple[MatrixTable, ...]
    delays: tuple[DelayRow, ...]
    delay_words: str
    covered: tuple[RangeRow, ...]
    constants: str
    steps: tuple[StepRow, ...]
    steps_words: str
    correlation: Picture | None
    correlation_words: str
    findings: tuple[FindingRow, ...]
    findings_in_steps: int
    maneuvers: tuple[ManeuverRow, ...]
    excitations: str
    timelines: tuple[Picture, ...]
    time: TimeFits | None = None
    crossed: Crossed | None = None
    search: SearchShown | None = None
    bootstrap: BootstrapShown | None = None
    noise: NoiseShown | None = None
    motors: MotorsShown | None = None
    air: FlightShown | None = None
    derived: DerivedShown | None = None

    @property
    def warnings(self) -> int:
        """How many findings are more than a note."""
        return sum(1 + len(row.others) for row in self.findings if row.severity != "info")

    @property
    def far_from_truth(self) -> bool:
        """Whether a known truth lies beyond what the stated errors explain."""
        return any(row.off.marked for group in self.parameters for row in group.rows)

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All figures of the section."""
        noise = self.noise.picture if self.noise else None
        single = (*(self.search.pictures if self.search else ()), noise, self.poles_picture, self.correlation)
        return (
            *(self.motors.pictures if self.motors else ()),
            *(self.air.pictures if self.air else ()),
            *((self.derived.picture,) if self.derived and self.derived.picture else ()),
            *(self.time.all_pictures if self.time else ()),
            *self.responses,
            *self.folded_responses,
            *(picture for check in self.checks for picture in check.pictures),
            *(picture for sweeps in self.sweeps for picture in sweeps.pictures),
            *(picture for picture in single if picture is not None),
            *self.timelines,
        )


def section(
    shown: Shown, *, anchor: str, truth: Mapping[str, float], common: Iterable[FindingDocument] = ()
) -> Section:
    """Everything that the page shows of one identification.

    Parameters
    ----------
    anchor
        Prefix of the identifiers on the page, unique among its sections.
    truth
        True parameter values where they are known, as ``model.name`` or ``name``.
    common
        Findings that the page shows once for several models.
    """
    document = shown.document
    responses = model_pictures(shown, anchor=anchor)
    own = [finding for finding in document.findings if not repeats_steps(finding, document)]
    findings = [finding for finding in own if finding not in common]
    flown = {maneuver.record for maneuver in document.provenance.maneuvers}
    return Section(
        anchor=anchor,
        title=_title(document),
        document=document,
        result=" ".join(result_sentences(document)),
        sentences=summary(document),
        cost=badge(document_verdict(document)),
        unseen=_unseen(document),
        parameters=parameter_groups(document, truth),
        dropped=dropped_parameters(document, anchor=anchor),
        truth_of_dropped=truth_of_dropped(document, truth),
        bounds=BOUNDS_MEANING,
        fit=_fit(document),
        costs=cost_rows(document),
        unseen_words="Held-out maneuver" if has_held_out_costs(document) else "Unseen sweeps",
        responses=responses.leading,
        folded_responses=responses.folded,
        joint=shown.data.response.estimate == "joint",
        least_coherence=shown.data.least_coherence,
        checks=tuple(
            check_section(check, key=f"{anchor}-check-{number}")
            for number, check in enumerate(() if document.motors else shown.verifications.maneuvers)
        ),
        sweeps=tuple(
            unseen_sweeps(frequency_check, key=f"{anchor}-sweeps-{number}", least_coherence=shown.data.least_coherence)
            for number, frequency_check in enumerate(shown.verifications.sweeps)
        ),
        poles=pole_rows(document.poles),
        poles_words=poles_sentence(document.poles),
        poles_picture=poles_picture(document.poles, key=f"{anchor}-poles"),
        matrices=matrix_tables(document),
        delays=delay_rows(document),
        delay_words=delay_sentence(document),
        covered=range_rows(document.covered),
        constants=constants_sentence(document.constants),
        steps=step_rows(document.reduction, anchor=anchor),
        steps_words=reduction_sentence(document.reduction),
        correlation=correlation_picture(document.correlation, key=f"{anchor}-correlation"),
        correlation_words=correlation_sentence(document.correlation),
        findings=finding_rows(findings),
        findings_in_steps=len(document.findings) - len(own),
        maneuvers=tuple(maneuver_row(maneuver.record, maneuver) for maneuver in document.provenance.maneuvers),
        excitations=f"{counted(len(document.provenance.maneuvers), 'maneuver')} in {counted(len(flown), 'log')}",
        time=None if document.motors else time_fits(shown, key=f"{anchor}-time"),
        motors=motors_shown(shown, key=f"{anchor}-motors"),
        air=flight_shown(shown, key=f"{anchor}-air"),
        derived=derived_shown(document.derived, key=f"{anchor}-thrust-coefficient"),
        crossed=crossed(document.cross_validation),
        search=search_shown(document.search, key=f"{anchor}-search-cost"),
        bootstrap=bootstrap_shown(document),
        noise=noise_shown(document, key=f"{anchor}-noise-runs"),
        timelines=timelines(
            () if shown.data.simulated else shown.data.segments,
            document.provenance.maneuvers,
            inputs=document.inputs,
            outputs=document.outputs,
            key=f"{anchor}-timeline",
        ),
    )


def _title(document: ResultDocument) -> str:
    # "Roll" for a single command, the model's name for anything richer.
    if len(document.inputs) == 1 and document.inputs[0].endswith("_command"):
        return document.inputs[0].removesuffix("_command").capitalize()
    return document.model


def _cost(cost: float) -> Verdict:
    return Verdict(cost_verdict(cost).level, f"cost {significant(cost)}")


def _unseen(document: ResultDocument) -> Verdict | None:
    """The worse verdict of unseen maneuvers and unseen sweeps."""
    costs = document.verification.frequency.values()
    found = document.verification
    flown = worst_maneuver(found.maneuvers) if found.maneuvers else worst_record(found.records)
    verdicts = [*([flown] if flown else []), *([_cost(max(costs))] if costs else [])]
    return max(verdicts, key=lambda verdict: LEVELS.index(verdict.level), default=None)


def _fit(document: ResultDocument) -> FitShown | None:
    if document.fit is None:
        return None
    in_time = document.method != "frequency"
    sentences = time_sentences(document, document.fit) if in_time else fit_sentences(document.fit)
    return FitShown(sentences=sentences, curve=sparkline(document.fit.trace))


def render_report(
    models: Sequence[IdentifiedModel],
    *,
    title: str,
    truth: Mapping[str, float] | None = None,
    refused: Mapping[str, Refused] | None = None,
) -> str:
    """The whole report as one HTML document, which holds everything it shows and lets no text of a log act.

    Parameters
    ----------
    models
        At least one; each becomes a section.
    truth
        True parameter values where they are known, as ``model.name`` or ``name``: adds a column to the tables.
    refused
        Models that the data cannot support, which the page lists.

    Raises
    ------
    UsageError
        There is nothing to report.
    """
    return render_sections([Shown.of(model) for model in models], title=title, truth=truth, refused=refused)


def common_findings(documents: Sequence[ResultDocument]) -> list[FindingDocument]:
    """Findings that several models have in the same words, once each."""
    each = [
        finding
        for document in documents
        for number, finding in enumerate(document.findings)
        if finding not in document.findings[:number]
    ]
    return [finding for number, finding in enumerate(each) if each.count(finding) > 1 and finding not in each[:number]]


def render_sections(
    shown: Sequence[Shown],
    *,
    title: str,
    truth: Mapping[str, float] | None = None,
    refused: Mapping[str, Refused] | None = None,
) -> str:
    """The same of models with their documents."""
    if not shown:
        raise UsageError("a report needs at least one identification")
    documents = [model.document for model in shown]
    several = len(shown) > 1 or bool(refused)
    common = common_findings(documents) if several else []
    sections = [
        section(model, anchor=f"s{number}", truth=truth or {}, common=common)
        for number, model in enumerate(shown, start=1)
    ]
    left_out = {name: refused_verdict(answer.findings).reason for name, answer in (refused or {}).items()}
    return render(
        "identification.html",
        title=title,
        sections=sections,
        several=several,
        answer=several_sentences(documents, left_out),
        common=finding_rows(common),
        refused=list(left_out.items()),
        has_truth=bool(truth),
        logs=[name for model in shown for name in model.document.provenance.inputs],
        pictures=[picture for each in sections for picture in each.pictures],
    )
