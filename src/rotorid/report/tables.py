r"""Tables of results for a paper: parameters with CR and I, poles, costs, unseen maneuvers, as CSV and as LaTeX.

A CSV file holds every digit, one heading for each column, units in columns of their own or in the heading. A LaTeX file
is a ``tabular`` with the rules of the package ``booktabs``, rounded as one prints it: a value at the digit that its
standard deviation supports, percents with two digits.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from rotorid.data.quantity import percent, significant, with_error
from rotorid.data.trust import CRAMER_RAO_GUIDELINE_PERCENT, INSENSITIVITY_GUIDELINE_PERCENT
from rotorid.errors import UsageError
from rotorid.results.verdicts import NOT_IDENTIFIED, error_of, has_value

if TYPE_CHECKING:
    from rotorid.documents.compare import CompareDocument, ComparedValueDocument
    from rotorid.documents.response import ResponseDocument
    from rotorid.documents.result import ResultDocument
    from rotorid.documents.verify import VerifyDocument
    from rotorid.results.summary import DerivedSummary, FlightPhysics, ManeuverCheck, MotorPhysics

TableFormat: TypeAlias = Literal["csv", "tex"]
TABLE_FORMATS: tuple[TableFormat, ...] = ("csv", "tex")
Entry: TypeAlias = str | float | int | None


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table.

    Parameters
    ----------
    name
        Heading in CSV: one word, with the unit where all rows share one.
    title
        Heading on paper.
    shown
        A number on paper; text stays text.
    """

    name: str
    title: str
    shown: Callable[[float | None], str] = significant


@dataclass(frozen=True, kw_only=True, slots=True)
class Table:
    """A table of numbers and words.

    Parameters
    ----------
    name
        Of its files, without the ending.
    caption
        What it holds, in a sentence.
    columns, rows
        Headings, and entries in their order; ``None`` where there is no number.
    symbols
        Columns whose text is the name of a parameter.
    errors
        Column to that of its standard deviation, which says at which digit it is rounded on paper.
    """

    name: str
    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Entry, ...], ...]
    symbols: tuple[str, ...] = ()
    errors: Mapping[str, str] | None = None


def require_formats(names: Iterable[str]) -> tuple[TableFormat, ...]:
    """Refuse kinds of files that are not known, before any work is done for them.

    Examples
    --------
    >>> require_formats(["tex", "csv"])
    ('tex', 'csv')
    """
    wanted = tuple(dict.fromkeys(names))
    known: dict[str, TableFormat] = {name: name for name in TABLE_FORMATS}
    if unknown := [name for name in wanted if name not in known]:
        raise UsageError(f"tables as {', '.join(unknown)} were asked for", needed=f"one of {', '.join(TABLE_FORMATS)}")
    return tuple(known[name] for name in wanted)


def as_csv(table: Table) -> str:
    r"""A table with a line of headings, every digit, and nothing where there is no number.

    Examples
    --------
    >>> table = Table(name="poles", caption="Poles.", columns=(Column("real", "Real"),), rows=((-0.1,), (None,)))
    >>> as_csv(table)
    'real\n-0.1\n""\n'
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([column.name for column in table.columns])
    writer.writerows([[_plain(entry) for entry in row] for row in table.rows])
    return text.getvalue()


def _plain(entry: Entry) -> Entry:
    """An entry of CSV; text that a spreadsheet would take for a formula is marked as text."""
    if entry is None:
        return ""
    return f"'{entry}" if isinstance(entry, str) and entry.startswith(("=", "+", "-", "@", "\t")) else entry


def as_latex(table: Table) -> str:
    r"""A table as a ``tabular`` with ``booktabs`` rules; its caption is a comment.

    Examples
    --------
    >>> columns = (Column("parameter", "Parameter"), Column("value", "Value"), Column("std", "Std"))
    >>> table = Table(name="p", caption="Derivatives.", columns=columns, rows=(("L_roll", -439.23, 3.1),),
    ...     symbols=("parameter",), errors={"value": "std"})
    >>> print(as_latex(table))
    % Derivatives.
    % \usepackage{booktabs}
    \begin{tabular}{lrr}
    \toprule
    Parameter & Value & Std \\
    \midrule
    $L_{\mathrm{roll}}$ & $-439$ & $3$ \\
    \bottomrule
    \end{tabular}
    <BLANKLINE>
    """
    numeric = [any(isinstance(row[place], int | float) for row in table.rows) for place in range(len(table.columns))]
    lines = [
        f"% {' '.join(table.caption.split())}",
        r"% \usepackage{booktabs}",
        rf"\begin{{tabular}}{{{''.join('r' if number else 'l' for number in numeric)}}}",
        r"\toprule",
        _line(escaped(column.title) for column in table.columns),
        r"\midrule",
        *(_line(_cells(table, row)) for row in table.rows),
        r"\bottomrule",
        r"\end{tabular}",
    ]
    return "\n".join(lines) + "\n"


WRITERS: Mapping[TableFormat, Callable[[Table], str]] = {"csv": as_csv, "tex": as_latex}

_SPECIAL = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "±": r"$\pm$",
    "°": r"$^\circ$",
    "σ": r"$\sigma$",
    "−": r"$-$",
    "–": "--",
    **{character: f"\\{character}" for character in "&%$#_{}"},
}
_GREEK = (
    "alpha",
    "beta",
    "delta",
    "zeta",
    "theta",
    "kappa",
    "lambda",
    "mu",
    "rho",
    "sigma",
    "tau",
    "phi",
    "psi",
    "omega",
)
_UNIT = re.compile(r"\^(-?[0-9]{1,2})")
_SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def escaped(text: str) -> str:
    r"""Text escaped for LaTeX.

    Examples
    --------
    >>> print(escaped("50 % of p/roll_command"))
    50 \% of p/roll\_command
    """
    return "".join(_SPECIAL.get(character, character) for character in text if character.isprintable())


def symbol(name: str) -> str:
    r"""The name of a parameter as a formula: the part after the first underscore is its index.

    Examples
    --------
    >>> print(symbol("L_roll"), symbol("tau_ax"), symbol("M_u"), symbol("kappa"), symbol("T_motor_up"))
    $L_{\mathrm{roll}}$ $\tau_{\mathrm{ax}}$ $M_{u}$ $\kappa$ $T_{\mathrm{motor\,up}}$
    """
    head, _, index = name.partition("_")
    letter = f"\\{head}" if head in _GREEK else (escaped(head) if len(head) < 2 else f"\\mathrm{{{escaped(head)}}}")
    if not index:
        return f"${letter}$"
    words = r"\,".join(escaped(word) for word in index.split("_"))
    upright = words if len(index) == 1 else f"\\mathrm{{{words}}}"
    return f"${letter}_{{{upright}}}$"


def _line(cells: Iterable[str]) -> str:
    return f"{' & '.join(cells)} \\\\"


def _cells(table: Table, row: Sequence[Entry]) -> Iterator[str]:
    entries = {column.name: entry for column, entry in zip(table.columns, row, strict=True)}
    errors = table.errors or {}
    values = {error: value for value, error in reversed(list(errors.items()))}
    for column in table.columns:
        entry = entries[column.name]
        if isinstance(entry, str):
            yield _words(table, column.name, entry)
        elif column.name in errors:
            yield _number(column, entry, entries.get(errors[column.name]))
        elif column.name in values:
            yield _number(column, entries.get(values[column.name]), entry, deviation=True)
        else:
            yield _number(column, entry, None)


def _words(table: Table, column: str, entry: str) -> str:
    if column in table.symbols:
        return symbol(entry)
    return _UNIT.sub(r"$^{\1}$", "" if entry == "1" else entry) if column == "unit" else escaped(entry)


def _number(column: Column, value: Entry, std: Entry, *, deviation: bool = False) -> str:
    """A number on paper; of a value with a deviation either, both rounded at the digit that the deviation supports."""
    own = std if deviation else value
    if not isinstance(own, int | float) or not math.isfinite(own):
        return "--"
    if isinstance(value, int | float) and isinstance(std, int | float) and math.isfinite(value + std) and std > 0.0:
        both, _, power = with_error(value, std).strip("(").partition(")·10")
        text = both.split(" ± ")[deviation]
    else:
        text, _, power = column.shown(own).partition("·10")
    raised = power.translate(_SUPERSCRIPTS)
    times = f" \\cdot 10^{{{raised}}}" if raised else ""
    return f"${text.replace('−', '-').replace('> ', '>')}{times}$"


def _two(value: float | None) -> str:
    return significant(value, digits=2)


def _whole(value: float | None) -> str:
    return "" if value is None else f"{value:.0f}"


_BAND = (Column("from_rad_s", "From [rad/s]"), Column("to_rad_s", "To [rad/s]"))


def result_tables(document: ResultDocument) -> tuple[Table, ...]:
    """Tables of an identified model: parameters, poles, costs, unseen flight, delays, equations, search, and motors."""
    found = (
        _parameters(document),
        _poles(document),
        _responses(document),
        maneuver_table(document.verification.maneuvers),
        _unseen(document),
        _delays(document),
        *_matrices(document),
        _bootstrap(document),
        _noise_runs(document),
        _search_runs(document),
        _folds(document),
        *(motor_tables(document.motors) if document.motors else ()),
        *(flight_tables(document.flight) if document.flight else ()),
        *(derived_tables(document.derived) if document.derived else ()),
    )
    return tuple(table for table in found if table is not None and table.rows)


def verification_tables(document: VerifyDocument) -> tuple[Table, ...]:
    """Tables of a verification: scores of each maneuver and output, cost of each response of unseen sweeps."""
    rows = [
        (", ".join(sweep.records), name, pair.value, *pair.band_rad_s, pair.points)
        for sweep in document.frequency
        for name, pair in sweep.pairs.items()
    ]
    sweeps = Table(
        name="unseen_responses",
        caption="Cost of the model against responses of sweeps that were not fitted; up to 100 is acceptable.",
        columns=(
            Column("records", "Records"),
            Column("response", "Response"),
            Column("cost", "Cost"),
            *_BAND,
            Column("points", "Points", _whole),
        ),
        rows=tuple(rows),
    )
    return tuple(table for table in (maneuver_table(document.maneuvers), sweeps) if table.rows)


def response_tables(document: ResponseDocument) -> tuple[Table, ...]:
    """Tables of measured responses: the band of each, windows and records, and margins of the loops."""
    from rotorid.documents.response import loops_of

    pairs = Table(
        name="responses",
        caption="What can be used of each response, and its mean coherence and random error there.",
        columns=(
            Column("response", "Response"),
            Column("unit", "Unit"),
            *_BAND,
            Column("points", "Points", _whole),
            Column("coherence", "Coherence", _two),
            Column("random_error_percent", "Error [%]", percent),
        ),
        rows=tuple(
            (
                name,
                pair.unit,
                *(pair.band_rad_s or (None, None)),
                pair.points,
                pair.mean_coherence,
                None if pair.mean_random_error is None else 100.0 * pair.mean_random_error,
            )
            for name, pair in document.pairs.items()
        ),
    )
    margins = Table(
        name="margins",
        caption="Margins of the loops with one standard deviation; the name has the unit.",
        columns=(
            Column("axis", "Axis"),
            Column("quantity", "Quantity"),
            Column("value", "Value"),
            Column("std", "Std", _two),
        ),
        rows=tuple(
            (key, name, number.value, number.std)
            for _, key, loop in loops_of(document.loops)
            for name, number in loop.numbers.items()
        ),
        errors={"value": "std"},
    )
    return tuple(table for table in (pairs, margins) if table.rows)


def comparison_tables(document: CompareDocument) -> tuple[Table, ...]:
    """Tables of a comparison: models, shared parameters side by side, scores of each maneuver."""
    labels = [model.label for model in document.models]
    found = (_compared_models(document), _compared_parameters(document, labels), _compared_maneuvers(document, labels))
    return tuple(table for table in found if table.rows)


def _compared_models(document: CompareDocument) -> Table:
    return Table(
        name="models",
        caption="Models side by side; fits in percent, AIC and BIC on the data of each.",
        columns=(
            *(Column(name, name.capitalize()) for name in ("result", "model", "method")),
            Column("order", "Order", _whole),
            Column("free_parameters", "Free", _whole),
            Column("own_percent", "Own [%]"),
            Column("cross_validated_percent", "Cross-validated [%]"),
            Column("on_logs_percent", "On logs [%]"),
            *(Column(name, title) for name, title in (("cost", "Cost"), ("aic", "AIC"), ("bic", "BIC"))),
        ),
        rows=tuple(
            (
                model.label,
                model.model,
                model.method,
                model.order,
                model.free_parameters,
                _mean(model.fit_percent),
                model.cross_validation.mean_percent if model.cross_validation else None,
                model.on_logs.mean_percent if model.on_logs else None,
                model.cost,
                model.aic,
                model.bic,
            )
            for model in document.models
        ),
    )


def _compared_parameters(document: CompareDocument, labels: Sequence[str]) -> Table:
    values = [(Column(label, label), Column(f"{label}_std", f"{label} std", _two)) for label in labels]
    return Table(
        name="parameters",
        caption="Parameters of all models with one standard deviation.",
        columns=(Column("parameter", "Parameter"), Column("unit", "Unit"), *(each for both in values for each in both)),
        rows=tuple(
            (
                name,
                parameter.unit,
                *(entry for label in labels for entry in _with_std(parameter.values.get(label))),
            )
            for name, parameter in document.parameters.items()
        ),
        symbols=("parameter",),
        errors={label: f"{label}_std" for label in labels},
    )


def _compared_maneuvers(document: CompareDocument, labels: Sequence[str]) -> Table:
    return Table(
        name="maneuvers",
        caption="Fit of every model on every maneuver in percent; frozen parameters.",
        columns=(
            *(Column(name, name.capitalize()) for name in ("record", "axis", "kind")),
            *(Column(label, label) for label in labels),
        ),
        rows=tuple(
            (
                maneuver.record,
                maneuver.axis,
                maneuver.kind,
                *(maneuver.models[label].mean_percent if label in maneuver.models else None for label in labels),
            )
            for maneuver in document.maneuvers
        ),
    )


def _with_std(value: ComparedValueDocument | None) -> tuple[Entry, Entry]:
    return (None, None) if value is None else (value.value, value.std)


def _mean(values: Mapping[str, float] | None) -> float | None:
    return sum(values.values()) / len(values) if values else None


def _parameters(document: ResultDocument) -> Table:
    return Table(
        name="parameters",
        caption=f"Parameters of {document.model} with one standard deviation. CR (Cramer-Rao, usual up to "
        f"{CRAMER_RAO_GUIDELINE_PERCENT:g} %) and I (insensitivity, usual up to {INSENSITIVITY_GUIDELINE_PERCENT:g} %) "
        "compare parameters by how sharply the cost rises, and are no errors.",
        columns=(
            Column("parameter", "Parameter"),
            Column("value", "Value"),
            Column("std", "Std", _two),
            Column("lower", "Lower"),
            Column("upper", "Upper"),
            Column("unit", "Unit"),
            Column("cramer_rao_percent", "CR [%]", percent),
            Column("insensitivity_percent", "I [%]", percent),
            Column("status", "Status"),
        ),
        rows=tuple(
            (
                name,
                *(
                    (estimate.value, error_of(name, estimate, document.findings), estimate.lower, estimate.upper)
                    if known
                    else (None,) * 4
                ),
                estimate.unit,
                *((estimate.cramer_rao_percent, estimate.insensitivity_percent) if known else (None, None)),
                estimate.status if known else NOT_IDENTIFIED,
            )
            for name, estimate in document.parameters.items()
            for known in (has_value(name, estimate, document.findings),)
        ),
        symbols=("parameter",),
        errors={"value": "std", "lower": "std", "upper": "std"},
    )


def _poles(document: ResultDocument) -> Table:
    return Table(
        name="poles",
        caption=f"Poles of {document.model} with one standard deviation.",
        columns=(
            Column("real_rad_s", "Real [rad/s]"),
            Column("real_std_rad_s", "Std", _two),
            Column("imag_rad_s", "Imaginary [rad/s]"),
            Column("imag_std_rad_s", "Std", _two),
            Column("damping", "Damping"),
            Column("frequency_rad_s", "Frequency [rad/s]"),
        ),
        rows=tuple(
            (pole.real, pole.real_std, pole.imag, pole.imag_std, pole.damping, pole.frequency_rad_s)
            for pole in document.poles
        ),
        errors={"real_rad_s": "real_std_rad_s", "imag_rad_s": "imag_std_rad_s"},
    )


def _responses(document: ResultDocument) -> Table | None:
    if document.cost is None:
        return None
    from rotorid.report.words import document_verdict

    found = document_verdict(document)
    return Table(
        name="responses",
        caption=f"Cost of each response, {significant(document.cost.average)} in the mean. Fit: {found.word}. "
        f"{found.reason}",
        columns=(Column("response", "Response"), Column("cost", "Cost"), *_BAND, Column("points", "Points", _whole)),
        rows=tuple((name, pair.value, *pair.band_rad_s, pair.points) for name, pair in document.cost.pairs.items()),
    )


def maneuver_table(maneuvers: Sequence[ManeuverCheck]) -> Table:
    """Scores of every output of every unseen maneuver."""
    return Table(
        name="maneuvers",
        caption="The model on maneuvers that were not fitted.",
        columns=(
            *(Column(name, name.capitalize()) for name in ("record", "axis", "kind")),
            Column("start_s", "Start [s]"),
            Column("output", "Output"),
            Column("tic", "TIC", _two),
            Column("fit_percent", "Fit [%]"),
            Column("rms", "RMS"),
            Column("j_rms", "J_rms"),
            Column("verdict", "Verdict"),
        ),
        rows=tuple(
            (
                *(check.record, check.axis, check.kind, check.start_s, output),
                *(scores.tic, scores.nrmse_fit_percent, scores.rms, check.j_rms, check.verdict),
            )
            for check in maneuvers
            for output, scores in check.scores.items()
            if output in check.moved
        ),
    )


def _unseen(document: ResultDocument) -> Table:
    return Table(
        name="unseen_responses",
        caption="Cost of the model against responses of sweeps that were not fitted; up to 100 is acceptable.",
        columns=(Column("response", "Response"), Column("cost", "Cost")),
        rows=tuple(document.verification.frequency.items()),
    )


def _delays(document: ResultDocument) -> Table:
    milli = 1e3
    return Table(
        name="delays",
        caption="Where the time between an input and an output goes.",
        columns=(
            Column("response", "Response"),
            Column("input_ms", "Input [ms]"),
            Column("motor_ms", "Motor [ms]"),
            Column("output_ms", "Output [ms]"),
            Column("total_ms", "Total [ms]"),
            Column("total_std_ms", "Std [ms]", _two),
        ),
        rows=tuple(
            (
                name,
                milli * budget.input_delay_s,
                milli * budget.motor_lag_s,
                milli * budget.output_delay_s,
                milli * budget.total_s,
                None if budget.total_std_s is None else milli * budget.total_std_s,
            )
            for name, budget in document.delays.items()
        ),
        errors={"total_ms": "total_std_ms"},
    )


def _matrices(document: ResultDocument) -> Iterator[Table]:
    if document.matrices is None:
        return
    of = {"F": document.states, "G": document.inputs}
    for name, columns in of.items():
        rows = getattr(document.matrices, name)
        if not rows or len(rows[0]) != len(columns) or len(rows) != len(document.states):
            continue
        yield Table(
            name=f"matrix_{name}",
            caption=f"Matrix {name} of M x' = F x + G u(t - tau), {document.model}.",
            columns=(Column("state", "State"), *(Column(each, each) for each in columns)),
            rows=tuple((state, *row) for state, row in zip(document.states, rows, strict=True)),
        )


def _bootstrap(document: ResultDocument) -> Table | None:
    if document.bootstrap is None:
        return None
    return Table(
        name="bootstrap",
        caption=f"Parameters over {document.bootstrap.runs} refits to newly drawn noise.",
        columns=(
            Column("parameter", "Parameter"),
            Column("mean", "Mean"),
            Column("std", "Std", _two),
            Column("std_percent", "Std [%]", percent),
            *(Column(name, name.capitalize()) for name in ("low", "median", "high")),
        ),
        rows=tuple(
            (name, spread.mean, spread.std, spread.relative_percent, spread.low, spread.median, spread.high)
            for name, spread in document.bootstrap.parameters.items()
        ),
        symbols=("parameter",),
        errors={"mean": "std"},
    )


def _noise_runs(document: ResultDocument) -> Table | None:
    """Mean and deviation over runs with artificial noise, next to the stated errors."""
    if document.noise_runs is None:
        return None
    return Table(
        name="noise_runs",
        caption=f"Parameters over {document.noise_runs.words}.",
        columns=(
            Column("parameter", "Parameter"),
            Column("unit", "Unit"),
            Column("value", "Value"),
            Column("stated_std", "Stated std", _two),
            Column("mean", "Mean"),
            Column("std", "Std", _two),
            Column("bias", "Bias"),
            Column("bias_std", "Std of the bias", _two),
            Column("runs", "Runs", _whole),
        ),
        rows=tuple(
            (name, s.unit, s.value, s.stated_std, s.mean, s.std, s.bias, s.bias_std, s.runs)
            for name, s in document.noise_runs.parameters.items()
        ),
        symbols=("parameter",),
        errors={"value": "stated_std", "mean": "std", "bias": "bias_std"},
    )


def _search_runs(document: ResultDocument) -> Table | None:
    """A search from other seeds, as the published table of a hundred runs of a genetic algorithm."""
    if document.search is None or document.search.runs is None:
        return None
    runs = document.search.runs
    kinds = {"alone": runs.alone, "with local searches": runs.polished}
    rows = [
        (words, name, spread.mean, spread.std, spread.min, spread.max)
        for words, table in kinds.items()
        for name, spread in {"cost": table.cost, **table.parameters}.items()
    ]
    return Table(
        name="search_runs",
        caption=f"{document.search.name} from {runs.runs} seeds on the same data: the scatter of the search.",
        columns=(
            Column("ended", "Ended"),
            Column("parameter", "Parameter"),
            Column("mean", "Mean"),
            Column("std", "Std"),
            Column("min", "Least"),
            Column("max", "Largest"),
        ),
        rows=tuple(rows),
    )


def _folds(document: ResultDocument) -> Table | None:
    if document.cross_validation is None:
        return None
    return Table(
        name="cross_validation",
        caption="Fit of every output of every record with the parameters of every fold.",
        columns=(
            Column("identified", "Identified on"),
            Column("record", "Record"),
            Column("unseen", "Unseen"),
            Column("output", "Output"),
            Column("fit_percent", "Fit [%]"),
            Column("tic", "TIC", _two),
        ),
        rows=tuple(
            (
                ", ".join(fold.identified),
                record,
                "yes" if record in fold.unseen else "no",
                output,
                score.nrmse_fit_percent,
                score.tic,
            )
            for fold in document.cross_validation.folds
            for record, outputs in fold.scores.items()
            for output, score in outputs.items()
        ),
    )


def motor_tables(motors: MotorPhysics) -> tuple[Table, ...]:
    """What follows of rotors: thrust in hover and at full output, and inertia by both ways of a regression."""
    derived = Table(
        name="motors",
        caption="What follows from the parameters, with one standard deviation.",
        columns=(
            Column("quantity", "Quantity"),
            Column("value", "Value"),
            Column("std", "Std", _two),
            Column("unit", "Unit"),
        ),
        rows=tuple((name, derived.value, derived.std, derived.unit) for name, derived in motors.derived.items()),
        errors={"value": "std"},
    )
    both = Table(
        name="inertia_both_ways",
        caption="Inertia by acceleration on torque and by torque on acceleration, plain and without the bias of noise.",
        columns=(
            Column("parameter", "Parameter"),
            *(Column(name, name.replace("_", " ").capitalize()) for name in _BOTH_WAYS),
            Column("unit", "Unit"),
        ),
        rows=tuple(
            (estimate.parameter, *estimate.plain, *estimate.corrected, estimate.unit) for estimate in motors.both_ways
        ),
        symbols=("parameter",),
    )
    return derived, both


def flight_tables(flight: FlightPhysics) -> tuple[Table, ...]:
    """The air of a vehicle: wind, stamps and errors of each stretch, and the terms that were tried."""
    logs = Table(
        name="flights",
        caption="Wind, stamps of the motors and errors of each stretch; errors are root mean squares.",
        columns=(
            Column("record", "Record"),
            Column("start_s", "Start [s]"),
            Column("stop_s", "Stop [s]"),
            Column("wind_north_m_s", "Wind north [m/s]"),
            Column("wind_east_m_s", "Wind east [m/s]"),
            Column("skew_s", "Motors early [s]"),
            Column("force_rms_n", "Force [N]"),
            Column("moment_rms_nm", "Moment [N m]"),
        ),
        rows=tuple(
            (
                log.record,
                log.start_s,
                log.stop_s,
                *(log.wind_m_s or (None, None)),
                log.skew_s,
                log.force_rms_n,
                log.moment_rms_nm,
            )
            for log in flight.logs
        ),
    )
    ladder = Table(
        name="terms",
        caption="Error of force on data that were left out, without and with some terms.",
        columns=(
            Column("terms", "Terms"),
            Column("before_n", "Without [N]"),
            Column("after_n", "With [N]"),
            Column("result", "Result"),
        ),
        rows=tuple(
            (", ".join(step.terms), step.before_n, step.after_n, "used" if step.entered else step.why or "left out")
            for step in flight.ladder
        ),
    )
    return logs, ladder


def derived_tables(derived: DerivedSummary) -> tuple[Table, ...]:
    """What follows from parameters and known quantities, and the thrust coefficient over the advance ratio."""
    quantities = Table(
        name="derived",
        caption="Quantities computed from the parameters and the given values, with one standard deviation.",
        columns=(
            Column("quantity", "Quantity"),
            Column("value", "Value"),
            Column("std", "Std", _two),
            Column("std_identified", "of the parameters", _two),
            Column("unit", "Unit"),
            Column("meaning", "Meaning"),
        ),
        rows=tuple(
            (name, quantity.value, quantity.std, quantity.std_identified, quantity.unit, quantity.words)
            for name, quantity in derived.quantities.items()
        ),
        errors={"value": "std"},
        symbols=("quantity",),
    )
    thrust = Table(
        name="thrust_coefficient",
        caption="Thrust coefficient over the advance ratio, with one standard deviation and an interval of 95 %.",
        columns=(
            Column("advance_ratio", "Advance ratio"),
            Column("c_T", "Coefficient"),
            Column("std", "Std", _two),
            Column("lower", "Lower"),
            Column("upper", "Upper"),
            Column("flown", "Flown"),
        ),
        rows=tuple(
            (
                point.advance_ratio,
                point.c_T,
                point.std,
                point.lower,
                point.upper,
                "unknown" if point.flown is None else "yes" if point.flown else "no",
            )
            for point in derived.thrust
        ),
        errors={"c_T": "std"},
    )
    return quantities, thrust


_BOTH_WAYS = ("plain_first", "plain_second", "corrected_first", "corrected_second")
