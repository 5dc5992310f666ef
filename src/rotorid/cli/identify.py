"""``rotorid identify``: logs in, a model with bounds out, and how it does on unseen data."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean, stdev
from typing import TYPE_CHECKING

from rotorid.cli.command import carry_out, read_logs, with_command
from rotorid.cli.console import INKS, default_folder, output_console, print_findings, print_lines, print_table
from rotorid.cli.options import ForPaper, Logs, Map, Output
from rotorid.data.display import listed
from rotorid.data.quantity import MISSING, error_columns, significant, with_error
from rotorid.data.trust import BOUNDS_MEANING
from rotorid.errors import UsageError
from rotorid.settings.identifying import IdentifySettings, ModelSettings
from rotorid.settings.models import ALL, asks_all
from rotorid.units import require_units

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

    from rotorid.data.record import FlightRecord
    from rotorid.documents.base import FindingDocument
    from rotorid.documents.result import ResultDocument
    from rotorid.documents.results import ResultsDocument
    from rotorid.identifying.identify_many import SeveralModels
    from rotorid.models.nonlinear import NonlinearStructure
    from rotorid.models.structure import LinearStructure
    from rotorid.results.model import IdentifiedModel
    from rotorid.results.summary import NoiseRuns, ParameterEstimate, SearchRuns


def identify_command(
    logs: Logs, *, asked: ModelSettings, settings: IdentifySettings, map: Map = None, output: Output, paper: ForPaper
) -> None:
    """Identify a model from flight logs, with error bounds and a report."""
    from rotorid.documents.result import refused_document, result_document
    from rotorid.identifying.cross_validation import cross_validated, parse_kind
    from rotorid.identifying.identification import identify, refused
    from rotorid.models.nonlinear import NonlinearStructure
    from rotorid.report.files import write_results
    from rotorid.report.publication import of_model

    kind, settings = parse_kind(asked.cross_validate), _with_workers(settings)
    if len(asked.models) > 1 or asks_all(asked.models):
        _identify_several(logs, asked, settings=settings, map=map, output=output, paper=paper)
        return
    wanted = _wanted(asked, settings)
    name = wanted if isinstance(wanted, str) else wanted.name

    def compute(records: Sequence[FlightRecord]) -> IdentifiedModel:
        unseen = list(read_logs(asked.verify, map))
        result = identify(records, wanted, settings=settings, verify=unseen)
        if kind is None or isinstance(wanted, NonlinearStructure):
            return result
        # Folds are scored, and need no spread.
        plain = replace(settings, bootstrap=None, add_noise_percent=None, runs=None)
        return cross_validated(result, records, wanted, kind=kind, settings=plain)

    title = f"{name} from {', '.join(log.name for log in logs)}"
    carry_out(
        logs,
        mapping=map,
        output=output,
        folder=default_folder(logs, name),
        file="result.json",
        compute=compute,
        write=lambda folder, result: write_results(folder, result, title=title),
        refused=lambda error, records: refused_document(refused(error, records, wanted, settings=settings)),
        document=result_document,
        show=print_result,
        paper=paper,
        publication=of_model,
    )


def _with_workers(settings: IdentifySettings) -> IdentifySettings:
    """A process for each core, where many runs were asked for and no number of processes."""
    from rotorid.io.pool import cores

    many = settings.runs is not None or settings.add_noise_percent is not None
    return replace(settings, workers=cores()) if many and settings.workers is None else settings


def _wanted(asked: ModelSettings, settings: IdentifySettings) -> str | LinearStructure | NonlinearStructure:
    """The structure, or the name of one that takes its channels from the logs; no log is read for wrong options."""
    from rotorid.identifying.families import require_choices
    from rotorid.models.families import order_is_open
    from rotorid.models.nonlinear import NonlinearStructure
    from rotorid.models.structure import LinearStructure
    from rotorid.settings.resolve import asked_model, read_model, require_known

    (model,) = asked.models
    if asked.cross_validate and order_is_open(model):
        raise UsageError(
            f"{model} cross-validates its orders already",
            remedy="leave out --cross-validate, or use black_box:N with the order found",
        )
    require_choices(model, settings, options=asked.beside)
    wanted = read_model(model)
    if not isinstance(wanted, NonlinearStructure):
        wanted = asked_model(model, inputs=asked.inputs, outputs=settings.outputs, decoupled=asked.decoupled)
    _require_units([wanted], settings)
    if isinstance(wanted, LinearStructure):
        require_known(wanted, settings)
    return wanted


def _identify_several(
    logs: Sequence[Path],
    asked: ModelSettings,
    *,
    settings: IdentifySettings,
    map: Path | None,
    output: Output,
    paper: ForPaper,
) -> None:
    """Several models into one folder: a folder for each with its files, one report, one ``results.json``."""
    from rotorid.documents.results import RESULTS, refused_results, results_document
    from rotorid.identifying.identify_many import identify_several, none_identified
    from rotorid.report.several import write_several

    models = _several(asked, settings)
    found: list[SeveralModels] = []

    def compute(records: Sequence[FlightRecord]) -> SeveralModels:
        unseen = list(read_logs(asked.verify, map))
        several = identify_several(records, models, settings=settings, verify=unseen)
        found.append(replace(several, answers={name: with_command(answer) for name, answer in several.items()}))
        if not several.identified:
            raise none_identified(several, records)
        return found[0]

    title = f"{', '.join(asked.models)} from {', '.join(log.name for log in logs)}"
    carry_out(
        logs,
        mapping=map,
        output=output,
        paper=paper,
        folder=default_folder(logs, "+".join(Path(name).stem if "/" in name else name for name in asked.models)),
        file=RESULTS,
        compute=compute,
        write=lambda folder, several: write_several(
            folder, several, title=title, figures=paper.figures, tables=paper.tables
        ),
        refused=lambda error, _records: refused_results(found[0], error),
        document=results_document,
        show=_print_several,
    )


def _several(asked: ModelSettings, settings: IdentifySettings) -> str | list[LinearStructure | str]:
    """The models, or ``all``; raises for names that none of them has."""
    from rotorid.identifying.identify_many import own_choices, require_known_by_any
    from rotorid.settings.resolve import asked_model, require_known

    if any(asked.beside.values()):
        raise UsageError(
            "--cross-validate, --inputs and --decoupled need a single model", remedy="name one with --model"
        )
    if asks_all(asked.models):
        _require_units((), settings)
        return ALL
    models = [asked_model(name, outputs=settings.outputs) for name in asked.models]
    _require_units(models, settings)
    for structure in models:
        if not isinstance(structure, str):
            require_known(structure, own_choices(structure, settings))
    require_known_by_any(models, settings)
    return models


def _require_units(models: Iterable[str | LinearStructure | NonlinearStructure], settings: IdentifySettings) -> None:
    """Raise for --fix values in a unit of another quantity; models that need the logs are checked as far as known."""
    from rotorid.models.families import family_of

    units: dict[str, str] = {}
    for model in models:
        units |= (
            family_of(model).units
            if isinstance(model, str)
            else {parameter.name: parameter.unit for parameter in model.parameters}
        )
    require_units(settings.fix, units, option="--fix")


def print_result(document: ResultDocument, folder: Path, *, verbose: bool = False) -> None:
    """Print parameters, fit, checks, findings and where the files are."""
    _print_model(document, verbose=verbose)
    _print_end([document], folder, verbose=verbose)


def _print_several(document: ResultsDocument, folder: Path, *, verbose: bool) -> None:
    """Print a line for each model and the findings of all once; with ``-v`` each model as if it were alone."""
    from rich.table import Table

    from rotorid.report.words import scale_sentence

    if verbose:
        shared = _shared(document.results)
        for result in document.results:
            _print_model(result, shared, verbose=True)
        if shared:
            output_console().print("of several models", markup=False)
            print_findings(shared, verbose=True)
        _print_end(document.results, folder, verbose=True)
        return
    table = Table(box=None, pad_edge=False)
    for name in ("model", "fit", "warnings", "parameters"):
        table.add_column(name, no_wrap=name != "parameters", justify="right" if name == "warnings" else "left")
    rows = [_row(result) for result in document.results if result.parameters]
    print_table(table, rows, verbose=False, item="model", most=_MOST_MODELS)
    print_lines([words for result in document.results if (words := scale_sentence(result))], verbose=True)
    refusals = [
        f"{result.model}: no model. {next((f.message for f in result.findings if f.severity == 'error'), '')}".rstrip()
        for result in document.results
        if not result.parameters
    ]
    print_lines(refusals, verbose=False, item="model without an answer", most=2)
    identified = [result for result in document.results if result.parameters]
    print_findings([finding for result in identified for finding in result.findings])
    _print_end(document.results, folder, verbose=False)


_TENFOLD = 10.0
_MOST_MODELS = 8
_MOST_VALUES = 3
_MOST_LINES = 5
_LIMITS = "± is one standard deviation. CR above 20 % or I above 10 %: the data barely determine the parameter."


def _row(document: ResultDocument) -> tuple[str, Text, str, str]:
    """A model, its verdict, how many warnings it has, its best known parameters and those that are not known."""
    from rich.text import Text

    known = {
        name: estimate
        for name, estimate in document.parameters.items()
        if estimate.status == "free" and estimate.std is not None
    }
    best = sorted(known, key=lambda name: (known[name].std or 0.0) / max(abs(known[name].value), 1e-12))[:_MOST_VALUES]
    values = [
        f"{name} {with_error(known[name].value, known[name].std)} {known[name].unit}".removesuffix(" 1")
        for name in known
        if name in best
    ]
    more = f" and {len(known) - len(best)} more" if len(known) > len(best) else ""
    word = ("", "") if document.verdict is None else (document.verdict.word, INKS[document.verdict.color])
    warnings = sum(finding.severity != "info" for finding in document.findings)
    return document.model, Text(*word), str(warnings), f"{', '.join(values)}{more}{_unknown(known)}"


def _unknown(known: Mapping[str, ParameterEstimate]) -> str:
    """Parameters whose error is larger than their value, the worst first; empty where there are none."""
    errors = {name: (known[name].std or 0.0) / max(abs(known[name].value), 1e-12) for name in known}
    names = sorted((name for name, error in errors.items() if error > 1.0), key=lambda name: -errors[name])
    if not names:
        return ""
    # Beyond a factor of ten the percentage says nothing more, as of numbers that may be zero.
    shown = [
        f"{name} ±{100.0 * errors[name]:.0f} %" if errors[name] < _TENFOLD else f"{name} over ±1000 %"
        for name in names[:_MOST_VALUES]
    ]
    more = f" and {len(names) - len(shown)} more" if len(names) > len(shown) else ""
    return f". Not determined: {', '.join(shown)}{more}"


def _print_end(documents: Sequence[ResultDocument], folder: Path, *, verbose: bool) -> None:
    """Print what CR and I are, once, and where the files are."""
    single = verbose or len(documents) == 1
    if single and any(each.cramer_rao_percent is not None for one in documents for each in one.parameters.values()):
        output_console().print(BOUNDS_MEANING if verbose else _LIMITS, style="dim", markup=False)
    output_console().print(f"report: {folder / 'report.html'}", soft_wrap=True, markup=False)


def _shared(documents: Sequence[ResultDocument]) -> list[FindingDocument]:
    """Findings that several models have in the same words, once."""
    each = [
        {(finding.severity, finding.kind, finding.message): finding for finding in document.findings}
        for document in documents
        if document.parameters
    ]
    every = {key: finding for findings in each for key, finding in findings.items()}
    return [finding for key, finding in every.items() if sum(key in findings for findings in each) > 1]


def _print_model(document: ResultDocument, elsewhere: Sequence[FindingDocument] = (), *, verbose: bool) -> None:
    console = output_console()
    if not document.parameters:
        console.print(f"{document.model}: no model", markup=False)
        print_findings([finding for finding in document.findings if finding.severity == "error"], verbose=verbose)
        return
    print_table(*_table(document), verbose=verbose, item="parameter")
    if (found := document.verdict) is not None:
        console.print(f"fit: {found.word}", style=INKS[found.color], markup=False, end=". ")
        console.print(found.reason, markup=False)
    parts = (_verified, _derived, _motors, _flight, _fit, _repeated, _orders)
    lines = [*(line for part in parts for line in part(document)), *(each.words for each in document.identifiability)]
    print_lines(lines, verbose=verbose, item="detail", most=_MOST_LINES)
    printed = {(finding.kind, finding.message) for finding in elsewhere}
    own = [finding for finding in document.findings if (finding.kind, finding.message) not in printed]
    print_findings(own, verbose=verbose)


def _table(document: ResultDocument) -> tuple[Table, list[tuple[str, ...]]]:
    """The table of parameters and its rows."""
    from rich.table import Table

    from rotorid.report.words import status_word
    from rotorid.results.verdicts import NOT_IDENTIFIED, error_of

    again = document.bootstrap
    table = Table(title=document.model, title_justify="left", box=None, pad_edge=False)
    table.add_column("parameter")
    for name in ("value", "± std", *(("bootstrap",) if again is not None else ())):
        table.add_column(name, justify="right")
    table.add_column("unit")
    for name in ("CR %", "I %"):
        table.add_column(name, justify="right")
    table.add_column("")
    rows = []
    for name, parameter in document.parameters.items():
        if parameter.status == "dropped":
            continue
        spread = [] if again is None else [f"{again.parameters[name].std:.2g}" if name in again.parameters else ""]
        std = error_of(name, parameter, document.findings)
        status, numbers = status_word(document, name), error_columns(parameter.value, std, digits=5)
        percents = _percents(parameter)
        if status == NOT_IDENTIFIED:
            numbers, percents = (MISSING, ""), (MISSING, MISSING)
        rows.append((name, *numbers, *spread, parameter.unit, *percents, status))
    return table, rows


def _percents(parameter: ParameterEstimate) -> tuple[str, str]:
    both = parameter.cramer_rao_percent, parameter.insensitivity_percent
    cramer_rao, insensitivity = ("" if percent is None else f"{percent:.0f}" for percent in both)
    return cramer_rao, insensitivity


def _motors(document: ResultDocument) -> Iterator[str]:
    """Thrust, and what set the scale of a vehicle."""
    if document.motors is None:
        return
    words = {
        "thrust_hover": f"thrust of a rotor {'at the mean output' if document.flight is None else 'in hover'}",
        "thrust_slope": "its slope",
        "thrust_full": "at full output",
        "thrust_to_weight": "full thrust over weight",
    }
    lines = [
        f"{words[name]} {with_error(derived.value, derived.std)}{'' if derived.unit == '1' else ' ' + derived.unit}"
        for name, derived in document.motors.derived.items()
    ]
    yield ", ".join(lines)
    yield f"rotors: {document.motors.layout}; {document.motors.curve} thrust curve of {document.motors.source}"


def _flight(document: ResultDocument) -> Iterator[str]:
    """Drag, wind and errors of a model of flight."""
    if (flight := document.flight) is None:
        return
    from rotorid.report.flight import drag_words

    if (drag := flight.hover.get("drag")) is not None:
        words = drag_words(flight)
        yield f"rotor drag {with_error(drag.value, drag.std)} 1/s in hover{f'; {words}' if words else ''}"
    for log in flight.logs:
        wind = f", wind {log.wind_m_s[0]:.1f} m/s north, {log.wind_m_s[1]:.1f} m/s east" if log.wind_m_s else ""
        moment = "" if log.moment_rms_nm is None else f", of moment {significant(1e3 * log.moment_rms_nm)} mN m"
        yield f"{log.record}: error of force {significant(log.force_rms_n)} N{moment}{wind}"


def _derived(document: ResultDocument) -> Iterator[str]:
    """What follows from the parameters and from values that were given."""
    if (derived := document.derived) is None:
        return
    for name, quantity in derived.quantities.items():
        unit = "" if quantity.unit == "1" else f" {quantity.unit}"
        yield f"{name} {with_error(quantity.value, quantity.std)}{unit}: {quantity.words}"
    for name, needed in derived.missing.items():
        yield f"{name} also needs {', '.join(needed)}: add --known {needed[0]}=VALUE:STD"


def _fit(document: ResultDocument) -> Iterator[str]:
    """What was left out, and how well the rest fits."""
    if dropped := [name for name, parameter in document.parameters.items() if parameter.status == "dropped"]:
        yield f"dropped, not needed to explain the data: {', '.join(dropped)}"
    if document.cost is not None:
        for pair, cost in document.cost.pairs.items():
            low, high = cost.band_rad_s
            yield f"cost of {pair} {cost.value:.1f} over {low:.2g} to {high:.3g} rad/s"
    if document.fit_percent:
        fits = ", ".join(f"{name} {percent:.1f} %" for name, percent in document.fit_percent.items())
        hold = f", {document.hold}-order hold" if document.hold else ""
        yield f"{document.method.replace('_', ' ')}{hold}; explained: {fits}"
    for output, removed in document.filters_removed.items():
        yield f"removed from {output}: {removed.words}"
    yield from _lines_by_record(document)


def _lines_by_record(document: ResultDocument) -> Iterator[str]:
    """Parameters from each record alone, and their spread; where a record has none, why."""
    for name in dict.fromkeys(name for fit in document.records for name in (*fit.parameters, *fit.missing)):
        estimates = [fit.parameters[name] for fit in document.records if name in fit.parameters]
        if len(estimates) == 1:
            yield f"{name} from 1 record: {with_error(estimates[0].value, estimates[0].std, digits=3)}"
        if len(estimates) > 1:
            each = ", ".join(with_error(derived.value, derived.std, digits=3) for derived in estimates)
            mean, spread = fmean(derived.value for derived in estimates), stdev(derived.value for derived in estimates)
            yield f"{name} from each of {len(estimates)} records: mean {mean:.3g}, spread {spread:.2g} ({each})"
    reasons: dict[str, dict[str, list[str]]] = {}
    for fit in document.records:
        for name, reason in fit.missing.items():
            reasons.setdefault(reason, {}).setdefault(name, []).append(f"{fit.start_s:.1f} s")
    for reason, names in reasons.items():
        alike = {
            places: [n for n, own in names.items() if own == list(places)] for places in map(tuple, names.values())
        }
        parts = [f"{listed(of)} from the record at {listed(places)}" for places, of in alike.items()]
        yield f"no value of {', nor of '.join(parts)} alone: {reason}"


def _orders(document: ResultDocument) -> Iterator[str]:
    """The orders of black boxes that were compared."""
    from rotorid.report.time import order_words

    if (choice := document.orders) is None:
        return
    yield "order  parameters           fit, own data       fit, other data   below the best       MDL"
    for row in choice.rows:
        if row.refused:
            yield f"{row.order:5d}  {row.refused}"
            continue
        yield (
            f"{row.order:5d}{row.parameters:12d}{row.fitted_percent or 0.0:22.1f} %"
            f"{with_error(row.unseen_percent, row.unseen_std):>19} %"
            f"{with_error(row.behind_percent, row.behind_std):>16}{row.bic or 0.0:10.0f}"
        )
    yield order_words(choice)


def _repeated(document: ResultDocument) -> Iterator[str]:
    """Searches and bootstraps."""
    from rotorid.search.catalog import POPULATIONS

    if (search := document.search) is not None:
        minima = "1 minimum" if len(search.minima) == 1 else f"{len(search.minima)} minima"
        yield (
            f"search by {search.name}: {search.evaluations} evaluations and {search.local_searches} local searches, "
            f"{minima}, the lowest at a cost of {search.minima[0].cost:.5g}"
        )
    if search is not None and search.alone is not None and search.name.partition(":")[0] in POPULATIONS:
        values = ", ".join(f"{name} {value:.4g}" for name, value in search.alone.parameters.items())
        yield f"by {search.name} alone, without local searches: {values}, at a cost of {search.alone.cost:.5g}"
    if search is not None and (runs := search.runs) is not None:
        yield from _runs(runs)
    if (noisy := document.noise_runs) is not None:
        yield from _noise_lines(noisy)
    if (again := document.bootstrap) is not None:
        left = sum(again.left_out.values())
        without = f", {left} without an answer" if left else ""
        yield f"bootstrap: standard deviations of {again.runs} refits with new noise{without}"


def _noise_lines(noisy: NoiseRuns) -> Iterator[str]:
    """Runs with artificial noise: mean, standard deviation and bias, next to the stated error."""
    yield f"{noisy.words}: mean ± standard deviation, bias (stated error of the log as it is)"
    for name, spread in noisy.parameters.items():
        stated = "" if spread.stated_std is None else f" (± {significant(spread.stated_std, digits=2)})"
        bias = with_error(spread.bias, spread.bias_std)
        yield f"  {name:<15} {with_error(spread.mean, spread.std)} {spread.unit}, bias {bias}{stated}"


def _runs(runs: SearchRuns) -> Iterator[str]:
    """The same search from other seeds: mean, standard deviation, least and largest."""
    left = f", {sum(runs.left_out.values())} without an answer" if runs.left_out else ""
    for words, table in (("alone", runs.alone), ("with local searches", runs.polished)):
        yield f"{runs.runs} runs from other seeds{left}, {words}: mean ± standard deviation (least to largest)"
        for name, spread in {"cost": table.cost, **table.parameters}.items():
            ends = f"{significant(spread.min, digits=4)} to {significant(spread.max, digits=4)}"
            yield f"  {name:<15} {with_error(spread.mean, spread.std)} ({ends})"


def _verified(document: ResultDocument) -> Iterator[str]:
    """How well the model predicts data it was not fitted to."""
    from rotorid.data.trust import EXCELLENT_COST

    for record, outputs in document.verification.records.items():
        scores = ", ".join(f"{name} TIC {s.tic:.2f}, fit {s.nrmse_fit_percent:.0f} %" for name, s in outputs.items())
        yield f"unseen data: {record}: {scores}"
    for record, cost_value in document.verification.frequency.items():
        yield f"unseen data: {record} cost {cost_value:.1f} (up to {EXCELLENT_COST:.0f} is good)"
    if (crossed := document.cross_validation) is not None and crossed.mean_percent is not None:
        ahead = "" if crossed.horizon_s is None else f", {crossed.horizon_s:.2g} s ahead"
        mean = with_error(crossed.mean_percent, crossed.spread_percent, digits=3)
        yield f"cross-validated on other records{ahead}: {mean} %"
        if crossed.best is not None:
            yield f"best record to identify on: {crossed.best.record}, {crossed.best.mean_percent:.1f} % (optimistic)"
