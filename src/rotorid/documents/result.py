"""``result.json``, schema ``rotorid.result/1``: an identified model as a document, and back."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from rotorid.data.display import counted, cut
from rotorid.data.findings import Finding
from rotorid.data.response import FrequencyResponse
from rotorid.data.trust import least_coherence
from rotorid.documents.base import Document, FindingDocument, ProvenanceDocument, checked, to_json
from rotorid.errors import ModelError, UsageError
from rotorid.io import documents
from rotorid.io.files import write_atomically, write_npz
from rotorid.io.tables.npz import read_arrays
from rotorid.models.nonlinear import NonlinearStructure, linear_of
from rotorid.models.state_space import StateSpace
from rotorid.models.structure import LinearStructure, silent_structure
from rotorid.models.toml import structure_from_toml
from rotorid.results.model import FittedData, IdentifiedModel, Refused, SimulatedRecord, no_response
from rotorid.results.provenance import LoggedManeuver, Provenance
from rotorid.results.summary import (
    BootstrapSummary,
    Checks,
    Compared,
    ControllerSettings,
    Correlation,
    Cost,
    CrossValidationSummary,
    DelayBudget,
    DerivedSummary,
    EquationFit,
    Fit,
    FitEnd,
    FitVerdict,
    FlightPhysics,
    HoverRotors,
    Information,
    MethodName,
    Minimum,
    MotorPhysics,
    NoiseRuns,
    OrderChoice,
    ParameterEstimate,
    PoleEstimate,
    Range,
    RecordFit,
    ReductionStep,
    RemovedFilters,
    Residuals,
    SearchSummary,
    UnseenCombination,
)
from rotorid.results.verdicts import verdict
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import Bounds

RESULT, MODEL, RESPONSES, SCHEMA = "result.json", "model.toml", "responses.npz", "rotorid.result/1"

_DENSITY = "density_"
_NOISE = "noise_"
"""Beginning of the names of arrays in ``responses.npz`` that hold densities of commands."""

_ROUNDED = 1e-6
"""What rounding may do to a correlation: below one of a parameter with itself, and below zero of an eigenvalue."""
_LARGEST_STD = 1e100
"""Of which a square, and products with slopes, are still numbers."""

_WANTED = f"a folder that rotorid identify wrote, or its {RESULT}"


class DelaysDocument(Document):
    """Delays of inputs and outputs in seconds, in the order of the names."""

    inputs: list[float]
    outputs: list[float]


class MatricesDocument(Document):
    """Matrices of ``M x' = F x + G u(t - tau)``, ``y = H0 x + H1 x'`` at the identified values."""

    M: list[list[float]]
    F: list[list[float]]
    G: list[list[float]]
    H0: list[list[float]]
    H1: list[list[float]]
    delays_s: DelaysDocument


class ResultDocument(Document):
    """``result.json``: everything that an identification answers."""

    schema_name: Annotated[Literal["rotorid.result/1"], Field(alias="schema")] = "rotorid.result/1"
    model: str
    inputs: list[str]
    outputs: list[str]
    states: list[str]
    parameters: dict[str, ParameterEstimate] = Field(default_factory=dict)
    verdict: FitVerdict | None = None
    cost: Cost | None = None
    fit_percent: dict[str, float] | None = None
    fit: FitEnd | None = None
    method: MethodName = "frequency"
    hold: Literal["zero", "first"] | None = None
    pieces_s: float | None = None
    records: list[RecordFit] = Field(default_factory=list)
    noise: dict[str, float] | None = None
    log_likelihood: float | None = None
    information: Information | None = None
    residuals: Residuals | None = None
    minima: list[Minimum] = Field(default_factory=list)
    search: SearchSummary | None = None
    bootstrap: BootstrapSummary | None = None
    noise_runs: NoiseRuns | None = None
    equations: list[EquationFit] = Field(default_factory=list)
    frequency_fit: dict[str, Compared] | None = None
    reduction: list[ReductionStep] = Field(default_factory=list)
    orders: OrderChoice | None = None
    correlation: Correlation | None = None
    constants: dict[str, float] = Field(default_factory=dict)
    matrices: MatricesDocument | None = None
    poles: list[PoleEstimate] = Field(default_factory=list)
    delays: dict[str, DelayBudget] = Field(default_factory=dict)
    filters_removed: dict[str, RemovedFilters] = Field(default_factory=dict)
    covered: dict[str, Range] = Field(default_factory=dict)
    verification: Checks = Field(default_factory=Checks)
    cross_validation: CrossValidationSummary | None = None
    identifiability: list[UnseenCombination] = Field(default_factory=list)
    motors: MotorPhysics | None = None
    flight: FlightPhysics | None = None
    rotors: HoverRotors | None = None
    derived: DerivedSummary | None = None
    controller: ControllerSettings | None = None
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument


def result_document(model: IdentifiedModel) -> ResultDocument:
    """An identified model as ``result.json`` holds it."""
    fit, structure = model.fit, model.structure
    return ResultDocument(
        model=structure.name,
        inputs=list(structure.inputs),
        outputs=list(fit.outputs),
        states=list(structure.states),
        parameters=dict(model.parameters),
        verdict=verdict(model),
        cost=fit.cost,
        fit_percent=_plain(fit.fit_percent),
        fit=fit.end,
        method=fit.method,
        hold=fit.hold,
        pieces_s=fit.pieces_s,
        records=list(fit.records),
        noise=_plain(fit.noise),
        log_likelihood=fit.log_likelihood,
        information=fit.information,
        residuals=fit.residuals,
        minima=list(fit.minima),
        search=fit.search,
        bootstrap=fit.bootstrap,
        noise_runs=fit.noise_runs,
        equations=list(fit.equations),
        frequency_fit=_plain(fit.frequency_fit),
        reduction=list(fit.reduction),
        orders=fit.orders,
        correlation=Correlation(names=model.bounds.names, matrix=_rows(model.bounds.correlation)),
        constants=dict(structure.constants),
        matrices=matrices_document(model.system),
        poles=list(model.pole_estimates),
        delays=dict(model.delays),
        filters_removed=dict(model.data.filters_removed),
        covered=dict(model.covered),
        verification=model.verification,
        cross_validation=model.cross_validation,
        identifiability=list(model.combinations),
        motors=model.motors,
        flight=model.flight,
        rotors=model.rotors,
        derived=model.derived,
        controller=model.controller,
        findings=[FindingDocument.model_validate(finding) for finding in model.findings],
        provenance=ProvenanceDocument.model_validate(model.provenance),
    )


def refused_document(refused: Refused) -> ResultDocument:
    """The document of data that cannot support a model: its findings say why, and no number is given."""
    structure = refused.structure
    return ResultDocument(
        model=refused.name,
        inputs=list(structure.inputs if structure else ()),
        outputs=list(structure.outputs if structure else ()),
        states=list(structure.states if structure else ()),
        verdict=verdict(refused),
        findings=[FindingDocument.model_validate(finding) for finding in refused.findings],
        provenance=ProvenanceDocument.model_validate(refused.provenance),
    )


def _plain(values: Mapping[str, Any] | None) -> dict[str, Any] | None:
    return None if values is None else dict(values)


def _rows(matrix: FloatArray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in matrix.tolist())


def matrices_document(system: StateSpace) -> MatricesDocument:
    """The matrices as lists."""
    return MatricesDocument(
        M=system.M.tolist(),
        F=system.F.tolist(),
        G=system.G.tolist(),
        H0=system.H0.tolist(),
        H1=system.H1.tolist(),
        delays_s=DelaysDocument(inputs=system.input_delays_s.tolist(), outputs=system.output_delays_s.tolist()),
    )


def save(model: IdentifiedModel, folder: str | Path) -> None:
    """Write ``result.json``, ``model.toml`` and ``responses.npz``, from which :func:`load` makes the model again.

    Parameters
    ----------
    model
        What to write.
    folder
        Where it goes; made when missing. Files of the same names are replaced.
    """
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    write_npz(place / RESPONSES, response_arrays(model.data))
    write_atomically(place / MODEL, model.to_toml())
    write_atomically(place / RESULT, to_json(result_document(model)))


def load(path: str | Path) -> IdentifiedModel:
    """Read a model that ``identify`` wrote or :func:`save` saved.

    It answers as the model that was saved: values, standard deviations, covariance, poles, response and simulation.
    Signals of verifications and maneuvers are not in the files, so that ``verifications`` and ``data.segments`` are
    empty; what they said is in ``verification``.

    Parameters
    ----------
    path
        The folder, or its ``result.json``.

    Raises
    ------
    UsageError
        The path leads to no result, or to several.
    ModelError
        The ``model.toml`` is wrong.
    """
    file = Path(path) / RESULT if Path(path).is_dir() else Path(path)
    inside = sorted(file.parent.name for file in Path(path).glob(f"*/{RESULT}")) if not file.exists() else []
    if inside:
        raise UsageError(
            f"{path} has {counted(len(inside), 'model')}: {', '.join(inside)}",
            needed="one of them",
            remedy=f"give {Path(path) / inside[0]}",
        )
    document = read_result(file, read_text(file))
    structure = structure_from_toml(read_text(file.parent / MODEL), where=MODEL)
    if structure.name != document.model:
        raise UsageError(f"{MODEL} is of {structure.name} and {file} of {document.model}", needed="files of one result")
    responses = file.parent / RESPONSES
    arrays = read_arrays(responses) if responses.exists() else None
    return model_of(file, document, structure, arrays)


def model_of(
    file: Path,
    document: ResultDocument,
    structure: LinearStructure | NonlinearStructure | None,
    arrays: Mapping[str, np.ndarray] | None = None,
) -> IdentifiedModel:
    """The model behind the files of a result, as :func:`identified_model` makes it.

    Parameters
    ----------
    file
        The ``result.json``, for messages.
    document, structure, arrays
        What is in it, in the ``model.toml`` and in the ``responses.npz`` of its folder.

    Raises
    ------
    UsageError
        The files do not fit together: each is what it should be, and their sizes or names differ.
    """
    try:
        return identified_model(document, structure, arrays)
    # Names that are missing, tables that are not square, arrays of other sizes.
    except (ValueError, LookupError, TypeError) as error:
        raise UsageError(
            f"{file} and the other files of its folder do not match: {cut(str(error), 120)}",
            needed="all files of one result, as identify wrote them",
            remedy="run identify again",
        ) from error


def identified_model(
    document: ResultDocument,
    structure: LinearStructure | NonlinearStructure | None,
    arrays: Mapping[str, np.ndarray] | None = None,
) -> IdentifiedModel:
    """The model behind a document.

    Parameters
    ----------
    document
        A result with parameters.
    structure
        Its ``model.toml``; without it the model has names and no equations.
    arrays
        Its ``responses.npz``, where that is known.
    """
    nonlinear = structure if isinstance(structure, NonlinearStructure) else None
    if isinstance(structure, NonlinearStructure):
        structure = linear_of(structure)
    structure = structure or silent_structure(
        document.model, inputs=document.inputs, states=document.states, outputs=document.outputs
    )
    end = document.fit or FitEnd(weights="cifer", outcome="", evaluations=0, trace=(), inflation=1.0)
    return IdentifiedModel(
        structure=structure,
        parameters=document.parameters,
        bounds=_bounds(document, end),
        fit=Fit(
            method=document.method,
            outputs=tuple(document.outputs),
            end=end,
            cost=document.cost,
            fit_percent=document.fit_percent,
            hold=document.hold,
            pieces_s=document.pieces_s,
            records=tuple(document.records),
            noise=document.noise,
            log_likelihood=document.log_likelihood,
            information=document.information,
            residuals=document.residuals,
            minima=tuple(document.minima),
            search=document.search,
            bootstrap=document.bootstrap,
            equations=tuple(document.equations),
            frequency_fit=document.frequency_fit,
            reduction=tuple(document.reduction),
            orders=document.orders,
        ),
        data=_data(document, structure, arrays),
        verification=document.verification,
        pole_estimates=tuple(document.poles),
        delays=document.delays,
        covered=document.covered,
        combinations=tuple(document.identifiability),
        motors=document.motors,
        flight=document.flight,
        rotors=document.rotors,
        nonlinear=nonlinear,
        derived=document.derived,
        controller=document.controller,
        cross_validation=document.cross_validation,
        findings=tuple(Finding(**finding.model_dump()) for finding in document.findings),
        provenance=_provenance(document.provenance),
    )


def _bounds(document: ResultDocument, end: FitEnd) -> Bounds:
    """Covariance from correlation and standard deviations, bounds from their percents.

    Raises
    ------
    ModelError
        The numbers belong to no covariance. Decompositions of it need not be guarded behind this.
    """
    known = document.correlation or Correlation(names=(), matrix=())
    parameters = [document.parameters[name] for name in known.names]
    std, random = (
        np.array([getattr(estimate, name) or 0.0 for estimate in parameters]) for name in ("std", "std_random")
    )
    correlation = np.array(known.matrix, dtype=np.float64).reshape(len(parameters), len(parameters))
    if not (_is_correlation(correlation) and all(_are_deviations(stds) for stds in (std, random))):
        raise ModelError(
            f"the covariance of {document.model} has numbers that no identification gives",
            needed="a result of identify",
            remedy="run identify again",
        )
    size = np.array([0.01 * abs(estimate.value) for estimate in parameters])
    return Bounds(
        names=tuple(known.names),
        cramer_rao=np.array([estimate.cramer_rao_percent or 0.0 for estimate in parameters]) * size,
        insensitivity=np.array([estimate.insensitivity_percent or 0.0 for estimate in parameters]) * size,
        covariance=correlation * np.outer(std, std),
        random=correlation * np.outer(random, random),
        colored=None if end.weights in ("cifer", "covariance") else end.inflation,
    )


def _is_correlation(matrix: FloatArray) -> bool:
    if not matrix.size:
        return True
    if not (np.isfinite(matrix).all() and np.abs(matrix).max() <= 1.0 + _ROUNDED):
        return False
    own = np.abs(matrix.diagonal() - 1.0).max() <= _ROUNDED and np.abs(matrix - matrix.T).max() <= _ROUNDED
    return bool(own and np.linalg.eigvalsh(matrix).min() >= -_ROUNDED)


def _are_deviations(stds: FloatArray) -> bool:
    return bool(((stds >= 0.0) & (stds < _LARGEST_STD)).all())


def _provenance(document: ProvenanceDocument) -> Provenance:
    fields = document.model_dump(exclude={"maneuvers", "command", "instruments"})
    return Provenance(
        **fields,
        command=tuple(document.command),
        instruments=tuple(document.instruments),
        maneuvers=tuple(LoggedManeuver(**maneuver.model_dump()) for maneuver in document.maneuvers),
    )


def response_arrays(data: FittedData) -> dict[str, np.ndarray]:
    """Arrays of ``responses.npz``, without pickles; of a fit in time also its records, as ``record_0_time_s`` ..."""
    arrays = measured_arrays(data.response, data.direct)
    for number, record in enumerate(data.simulated):
        parts = {
            "time_s": record.time_s,
            "inputs": record.inputs,
            "measured": record.measured,
            "simulated": record.simulated,
        }
        arrays |= {f"record_{number}_{name}": values for name, values in parts.items()}
    arrays |= {f"{_DENSITY}{command}": density for command, density in data.command_densities.items()}
    arrays |= {f"{_NOISE}{axis}": density for axis, density in data.rate_densities.items()}
    return arrays | {"model": data.model_response, "fitted": data.used}


def measured_arrays(response: FrequencyResponse, direct: FrequencyResponse | None) -> dict[str, np.ndarray]:
    """Arrays of measured responses, and of the direct estimate where there is a joint one."""
    arrays = {
        "omega_rad_s": response.omega_rad_s,
        "values": response.values,
        "coherence": response.coherence,
        "random_error": response.random_error,
        "covariance": response.covariance,
        "inputs": np.array(response.inputs),
        "outputs": np.array(response.outputs),
        "instruments": np.array(response.instruments, dtype=np.str_),
        "estimate": np.array(response.estimate),
        "windows_s": np.array(response.windows_s),
        "processing": np.array(response.processing, dtype=np.str_),
    }
    if direct is not None:
        arrays |= {
            "direct_values": direct.values,
            "direct_coherence": direct.coherence,
            "direct_random_error": direct.random_error,
        }
    return arrays


def _data(document: ResultDocument, structure: LinearStructure, arrays: Mapping[str, np.ndarray] | None) -> FittedData:
    if arrays is None:
        nothing = no_response(structure)
        return FittedData(
            response=nothing, direct=None, model_response=nothing.values, used=np.zeros(nothing.values.shape, np.bool_)
        )
    response = _response(arrays)
    direct = None
    if "direct_values" in arrays:
        direct = FrequencyResponse(
            omega_rad_s=response.omega_rad_s,
            values=arrays["direct_values"],
            coherence=arrays["direct_coherence"],
            random_error=arrays["direct_random_error"],
            covariance=np.zeros(response.covariance.shape, dtype=np.complex128),
            inputs=response.inputs,
            outputs=response.outputs,
            estimate="direct",
            windows_s=response.windows_s,
        )
    limit = document.provenance.settings.get("coherence")
    asked = float(limit) if isinstance(limit, int | float) else None
    return FittedData(
        response=response,
        direct=direct,
        model_response=arrays["model"],
        used=arrays["fitted"],
        least_coherence=least_coherence(asked, joint=response.estimate == "joint"),
        simulated=tuple(_record(document, arrays, number) for number in range(len(document.records))),
        command_densities=_named(_DENSITY, arrays),
        rate_densities=_named(_NOISE, arrays),
    )


def _named(prefix: str, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name.removeprefix(prefix): values for name, values in arrays.items() if name.startswith(prefix)}


def _response(arrays: Mapping[str, np.ndarray]) -> FrequencyResponse:
    def names(key: str) -> tuple[str, ...]:
        return tuple(str(name) for name in arrays[key])

    return FrequencyResponse(
        omega_rad_s=arrays["omega_rad_s"],
        values=arrays["values"],
        coherence=arrays["coherence"],
        random_error=arrays["random_error"],
        covariance=arrays["covariance"],
        inputs=names("inputs"),
        outputs=names("outputs"),
        estimate="joint" if str(arrays["estimate"]) == "joint" else "direct",
        instruments=names("instruments"),
        windows_s=tuple(map(float, arrays["windows_s"])),
        processing=names("processing"),
    )


def _record(document: ResultDocument, arrays: Mapping[str, np.ndarray], number: int) -> SimulatedRecord:
    summary = document.records[number]
    flown = [maneuver for maneuver in document.provenance.maneuvers if maneuver.record == summary.record]
    return SimulatedRecord(
        record=summary.record,
        maneuver=LoggedManeuver(**flown[min(number, len(flown) - 1)].model_dump()),
        time_s=arrays[f"record_{number}_time_s"],
        inputs=arrays[f"record_{number}_inputs"],
        measured=arrays[f"record_{number}_measured"],
        simulated=arrays[f"record_{number}_simulated"],
    )


def read_text(path: Path) -> str:
    """The text of one file of a result.

    Raises
    ------
    UsageError
        It cannot be read.
    """
    return documents.read_text(path, needed=_WANTED, most_bytes=documents.MOST_JSON_BYTES)


def read_result(file: Path, text: str) -> ResultDocument:
    """The document in a text, which must be a result with parameters.

    Parameters
    ----------
    file
        Where the text stood, for messages.
    text
        JSON.

    Raises
    ------
    UsageError
        It is no result, or one without a model.
    """
    try:
        table = documents.parse_json(text)
    except documents.DocumentError as error:
        raise UsageError(f"{file} is no JSON: {error}", needed=_WANTED) from error
    schema = table.get("schema") if isinstance(table, dict) else None
    if schema != SCHEMA:
        came = f"has the schema {schema}" if isinstance(schema, str) else "names no schema"
        raise UsageError(f"{file} {came}", needed=f"a {RESULT} with the schema {SCHEMA}")
    try:
        document = checked(ResultDocument, table)
    except documents.DocumentError as error:
        raise UsageError(
            f"{file} does not fit its schema at {error}",
            needed=f"a {RESULT} of this version",
            remedy="run identify again",
        ) from error
    if not document.parameters:
        raise UsageError(f"{file} has no model: not enough data", needed="results with parameters")
    return document
