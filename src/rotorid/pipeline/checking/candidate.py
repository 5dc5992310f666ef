"""A model to be judged, and the controllers under which it is flown.

A :class:`Candidate` holds structure, values, the fitted band, and where its outputs stood in the logs; it comes from a
fit that has just ended, from an identified model, or from the files of a result. :class:`Controllers` knows the rate
controllers of a log from its parameters or from a file of the user, and how closely they explain the logged commands:
gains that do not are not those that flew.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.data.axes import ANGLE_OF, RATE_OF
from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, remark
from rotorid.data.record import STANDARD_UNITS, FlightRecord, TimeHistory
from rotorid.errors import ModelError, UsageError
from rotorid.io.documents import MOST_JSON_BYTES, DocumentError, parse_json, parse_toml, read_text
from rotorid.models.autopilots.reading import rate_controller
from rotorid.models.controller import FILTERS, Driven, RateController
from rotorid.models.nonlinear import NonlinearStructure, linear_of
from rotorid.models.parameter import ParameterSet
from rotorid.models.state_space import StateSpace
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import structure_from_toml
from rotorid.models.toml_source import Source
from rotorid.pipeline.checking.flown_motors import KnownMotors, known_motors
from rotorid.pipeline.fits.frequency.fit import FrequencyFit
from rotorid.pipeline.preparation.measure import Measured
from rotorid.pipeline.preparation.segments import source_of
from rotorid.pipeline.provenance import LoggedManeuver, Provenance
from rotorid.pipeline.results import IdentifiedModel
from rotorid.pipeline.settings import MODEL as MOTORS
from rotorid.typing import Axis
from rotorid.verification.closed_loop import Loop, LoopScores, controller_alone
from rotorid.verification.sampled import Filter
from rotorid.verification.scores import GOOD_TIC


@dataclass(frozen=True, kw_only=True)
class GivenController(Immutable):
    """A controller that a person gave.

    Parameters
    ----------
    controller
        Gains and filters.
    setpoint
        Channel that drives it; empty for the outermost set-point that is logged and explains the command.
    """

    controller: RateController
    setpoint: str = ""

    def __str__(self) -> str:
        numbers = ((one.name, getattr(self.controller, one.name)) for one in fields(self.controller))
        told = [f"{name}={value!r}" for name, value in numbers if value]
        return " ".join([*told, *([f"setpoint={self.setpoint}"] if self.setpoint else [])])


def read_controllers(path: Path) -> dict[Axis, GivenController]:
    """Read the controllers of a TOML file, one table for each axis.

    ::

        [pitch]
        proportional_s = 0.15
        integral = 0.2
        angle_1_s = 6.0
        setpoint = "theta_setpoint"

    Parameters
    ----------
    path
        The file. Its fields are those of :class:`rotorid.models.controller.RateController`, and ``setpoint``.

    Raises
    ------
    UsageError
        The file cannot be read, is no TOML, or says something else; the message names the line.
    """
    text = read_text(path, needed="a TOML file with gains")
    try:
        table = parse_toml(text)
    except DocumentError as error:
        raise UsageError(f"{path.name} is no TOML: {error}", needed="[pitch] and proportional_s = 0.15") from error
    source = Source(text=text, where=path.name)
    try:
        found = {
            _axis(name, source): _given(source.table(value, (name,)), name, source) for name, value in table.items()
        }
    except ModelError as error:
        raise UsageError(error.came, needed=error.needed, remedy=error.remedy) from None
    if not found:
        raise UsageError(f"{path.name} holds no controller", needed=f"a table [{'], ['.join(RATE_OF)}]")
    return found


def _axis(name: str, source: Source) -> Axis:
    if name not in RATE_OF:
        raise source.unknown("axis", name, RATE_OF, (name,))
    return name  # type: ignore[return-value]


def _given(table: Mapping[str, Any], axis: str, source: Source) -> GivenController:
    known = [one.name for one in fields(RateController) if one.name not in FILTERS]
    values: dict[str, Any] = {}
    for name, value in table.items():
        if name not in (*known, "setpoint"):
            raise source.unknown("field of a controller", name, (*known, "setpoint"), (axis, name))
        if name in ("derivative_of_error", "late_integral", "late_angle"):
            if not isinstance(value, bool):
                raise source.error((axis, name), f"{name} is {value!r}", needed="true or false")
            values[name] = value
        elif name != "setpoint":
            values[name] = source.number(value, (axis, name))
    if "proportional_s" not in values:
        raise source.error((axis,), f"[{axis}] has no proportional_s", needed="the gain on the rate")
    try:
        controller = RateController(**values)
    except UsageError as error:
        raise source.error((axis,), error.came, needed=error.needed) from None
    return GivenController(
        controller=controller, setpoint=source.text_of(table.get("setpoint", ""), (axis, "setpoint"))
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Controllers(Immutable):
    """The controllers of one log.

    Parameters
    ----------
    record
        The log.
    given
        Those that a person gave; they go before the gains in the log.
    """

    record: FlightRecord
    given: Mapping[Axis, GivenController]

    def __post_init__(self) -> None:
        self._set(given=self.given)

    def of(self, axis: Axis) -> GivenController | None:
        """The controller of an axis, where one is known."""
        if axis in self.given:
            return self.given[axis]
        logged = rate_controller(self.record.parameters, axis) if axis in RATE_OF else None
        return GivenController(controller=logged) if logged else None

    def channels(self, axes: Sequence[Axis]) -> tuple[str, ...]:
        """Channels that may drive the controllers of some axes, as far as they are logged.

        Raises
        ------
        UsageError
            The log lacks a set-point that was named.
        """
        wanted = []
        for axis in axes:
            found = self.of(axis)
            if found is None:
                continue
            if found.setpoint and found.setpoint not in self.record.channel_names:
                raise UsageError(
                    f"{self.record.source.name} holds no {found.setpoint} for the {axis} controller",
                    needed=f"one of {', '.join(n for n in self.record.channel_names if n.endswith('_setpoint'))}",
                )
            wanted += [name for name, _ in _setpoints(axis, found)] + [f"{axis}_excitation"]
        return tuple(dict.fromkeys(name for name in wanted if name in self.record.channel_names))

    def loop(self, axis: Axis, history: TimeHistory, filtered: Filter) -> tuple[Loop, str, LoopScores] | None:
        """The loop of an axis, its set-point, and how well its controller alone explains the measured command.

        Of several set-points the outermost one counts with which it does so closely, else the one that comes nearest.
        ``None`` where there is no controller or no set-point.
        """
        found = self.of(axis)
        if found is None:
            return None
        tried = []
        for name, driven in _setpoints(axis, found):
            if name not in history.names or RATE_OF[axis] not in history.names:
                continue
            loop = Loop(
                command=f"{axis}_command",
                rate=RATE_OF[axis],
                controller=found.controller,
                driven=driven,
                setpoint=history[name],
                excitation=_excitation(axis, history),
            )
            scores = controller_alone(
                loop,
                history[loop.rate],
                history[loop.command],
                filtered=filtered,
                sample_rate_hz=history.sample_rate_hz,
            )
            if scores.alike:
                return loop, name, scores
            tried.append((loop, name, scores))
        return min(tried, key=lambda item: item[2].tic, default=None)


def _setpoints(axis: Axis, given: GivenController) -> list[tuple[str, Driven]]:
    """What may drive a controller, the outermost set-point first."""
    rate, angle = (f"{name}_setpoint" for name in (RATE_OF[axis], ANGLE_OF[axis]))
    if given.setpoint:
        return [(given.setpoint, "angle" if given.controller.angle_1_s and given.setpoint != rate else "rate")]
    outer: list[tuple[str, Driven]] = [(angle, "angle")] if given.controller.angle_1_s else []
    return [*outer, (rate, "rate")]


def _excitation(axis: Axis, history: TimeHistory) -> np.ndarray:
    """The test signal on the command, zero where there is none: one in another unit enters elsewhere."""
    name = f"{axis}_excitation"
    if name in history.names:
        channel = history.channels[history.names.index(name)]
        if channel.unit == STANDARD_UNITS[f"{axis}_command"]:
            return np.nan_to_num(history[name])
    return np.zeros(history.values.shape[1])


def no_controller(controllers: Controllers, axes: Sequence[Axis]) -> Finding:
    """The remark that a log holds no gains, or gains and nothing that drives them."""
    record, whose = controllers.record.source.name, " and ".join(axes)
    known = {axis: found for axis in axes if (found := controllers.of(axis)) is not None}
    table = f"[{axes[0]}]"
    if len(known) < len(axes):
        message = (
            f"Not flown in closed loop: {record} holds no gains of the {whose} controller. Give rotorid verify a "
            f"--controller FILE.toml with a table {table} of proportional_s, integral, derivative_s2, angle_1_s and, "
            "where it is no standard one, the setpoint that drives it."
        )
    else:
        drives = " or ".join(
            dict.fromkeys(name for axis, found in known.items() for name, _ in _setpoints(axis, found))
        )
        message = (
            f"Not flown in closed loop: {record} holds the gains of the {whose} controller and not what drives it, "
            f"{drives}. Log that set-point, or name another channel as setpoint in the table {table} of a --controller "
            "FILE.toml."
        )
    return remark("no_controller", record, message)


def other_controller(record: str, axis: Axis, setpoint: str, scores: LoopScores) -> Finding:
    """The remark that the gains are not those that flew."""
    return remark(
        "other_controller",
        f"{record}: {axis}",
        f"Not flown in closed loop: with its gains the {axis} controller does not make the logged {axis} command "
        f"of {setpoint} and the measured rate (Theil coefficient {scores.tic:.2f}, good: up to {GOOD_TIC:g}). It "
        "has parts that are not modeled, the gains changed in flight, or its set-point is another one.",
        tic=scores.tic,
        nrmse_fit_percent=scores.nrmse_fit_percent,
    )


RESULT, RESULTS, MODEL = "result.json", "results.json", "model.toml"

UNFILTERED = " without its known filters"
"""What follows the source of an output that known filters were taken off before the model was fitted."""

_SAME_VALUE = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate(Immutable):
    """A model with all that judging it needs.

    Parameters
    ----------
    structure, parameters
        The model.
    band_rad_s
        Where it was fitted, or ``None`` when that is not known.
    sources
        Output to where it stood in the logs that were fitted; empty when that is not known.
    controllers
        Controllers that a person gave, to fly the model in closed loop; they go before the gains in a log.
    provenance
        Which data it was fitted to, or ``None`` when that is not known.
    motors
        The vehicle, of a result of ``physical.motors``; the structure is then its motion around hover.
    nonlinear
        The equations with their values, of a nonlinear model; the structure is then its small motion about rest.
    """

    structure: LinearStructure
    parameters: ParameterSet
    band_rad_s: tuple[float, float] | None = None
    sources: Mapping[str, str] | None = None
    controllers: Mapping[Axis, GivenController] = field(default_factory=dict)
    provenance: Provenance | None = None
    motors: KnownMotors | None = None
    nonlinear: NonlinearStructure | None = None

    @property
    def system(self) -> StateSpace:
        """The model as numbers."""
        return self.structure.matrices(self.parameters.values)

    def system_of(self, outputs: Sequence[str]) -> StateSpace:
        """The model as numbers, with some of its outputs."""
        rows = [self.structure.outputs.index(name) for name in outputs]
        whole = self.system
        return replace(whole, H0=whole.H0[rows], H1=whole.H1[rows], output_delays_s=whole.output_delays_s[rows])


def candidate_of(fitted: FrequencyFit, measured: Measured) -> Candidate:
    """A model that has just been fitted."""
    return Candidate(
        structure=fitted.structure,
        parameters=fitted.structure.parameters,
        band_rad_s=fitted.band_rad_s,
        sources=output_sources(measured),
    )


def candidate_model(model: IdentifiedModel) -> Candidate:
    """An identified model, to be judged on further logs."""
    return Candidate(
        structure=model.structure,
        parameters=model.structure.parameters,
        band_rad_s=model.band_rad_s,
        sources=model.provenance.sources or None,
        provenance=model.provenance,
        motors=identified_motors(model),
        nonlinear=model.nonlinear,
    )


def identified_motors(model: IdentifiedModel) -> KnownMotors | None:
    """The vehicle of an identified model; ``None`` for one that is not of ``physical.motors``."""
    if model.motors is None:
        return None
    parameters = {name: asdict(one) for name, one in model.parameters.items()}
    return known_motors({"parameters": parameters, "motors": asdict(model.motors)})


def output_sources(measured: Measured) -> dict[str, str]:
    """Output to where it stood in the first log that holds it."""
    sources: dict[str, str] = {}
    for name in measured.response.outputs:
        held = [segment for segment in measured.segments if name in segment.history.names]
        if held:
            sources[name] = source_of(held[0], name) + (UNFILTERED if name in measured.unfiltered else "")
    return sources


_RESULT_FILES = "a folder that rotorid identify wrote, its result.json or a model.toml"


def read_candidate(result: Path) -> Candidate:
    """The model behind a result folder, a ``result.json`` or a ``model.toml``.

    Parameters
    ----------
    result
        A folder that ``identify`` wrote, or one of the two files. Of a ``result.json``, whatever it is called, the
        ``model.toml`` next to it is read too, and has to hold its values.

    Raises
    ------
    UsageError
        There is no such model, or several, the result is none of ``identify``, or it is a ``model.toml`` of
        ``physical.motors`` alone, which does not say how its inputs are had from a log.
    ModelError
        The ``model.toml`` is wrong.
    """
    folder = result if result.is_dir() else result.parent
    model = result if result.suffix == ".toml" else folder / MODEL
    if result.is_file() and result.suffix not in (".toml", ".json"):
        raise UsageError(
            f"{result.name} came where a result belongs",
            needed=_RESULT_FILES,
            remedy="a log is no result: identify a model first, and give its folder before the logs",
        )
    if not model.exists() and (folder / RESULTS).exists():
        held = ", ".join(sorted(path.parent.name for path in folder.glob(f"*/{MODEL}")))
        raise UsageError(
            f"{result.name} holds several models",
            needed=f"one of its folders: {held}",
            remedy="name it after the folder",
        )
    read = structure_from_toml(read_text(model, needed=_RESULT_FILES), where=model.name)
    nonlinear = read if isinstance(read, NonlinearStructure) else None
    structure = linear_of(read) if isinstance(read, NonlinearStructure) else read
    document = result if result.suffix == ".json" else folder / RESULT
    if structure.name == MOTORS and not document.exists():
        raise UsageError(
            f"{result} is the {MODEL} of {MOTORS} alone, which does not say how motors are had from a log",
            needed=f"its {RESULT} beside it",
            remedy="give the folder that identify wrote",
        )
    if result.suffix != ".toml" or document.exists():
        found = _with_result(structure, document, required=result.suffix != ".toml")
        return replace(found, nonlinear=nonlinear)
    return Candidate(structure=structure, parameters=structure.parameters, nonlinear=nonlinear)


def _with_result(structure: LinearStructure, path: Path, *, required: bool) -> Candidate:
    wanted = "a result.json with the schema rotorid.result/1, as identify writes it"
    try:
        table = parse_json(read_text(path, needed=_RESULT_FILES, most_bytes=MOST_JSON_BYTES))
    except DocumentError as error:
        raise UsageError(f"{path} is no JSON: {error}", needed=wanted) from error
    known = isinstance(table, dict) and table.get("schema") == "rotorid.result/1"
    if not known or table.get("model") != structure.name:
        if not required:
            return Candidate(structure=structure, parameters=structure.parameters)
        raise UsageError(f"{path} is not the result of the {MODEL} next to it", needed=wanted)
    if required and not _holds_values(structure, table):
        raise UsageError(f"the {MODEL} next to {path} holds other values", needed="both as identify wrote them")
    pairs = (table.get("cost") or {}).get("pairs") or {}
    bands = [pair["band_rad_s"] for pair in pairs.values()]
    sources = (table.get("provenance") or {}).get("sources") or None
    return Candidate(
        structure=structure,
        parameters=structure.parameters,
        band_rad_s=(min(low for low, _ in bands), max(high for _, high in bands)) if bands else None,
        sources=sources,
        provenance=_provenance(table),
        motors=known_motors(table) if structure.name == MOTORS else None,
    )


def _holds_values(structure: LinearStructure, table: Mapping[str, Any]) -> bool:
    """Whether the values of a model are those of a result, as far as the result tells them."""
    told = {
        name: one["value"]
        for name, one in (table.get("parameters") or {}).items()
        if isinstance(one, Mapping) and isinstance(one.get("value"), int | float)
    }
    values = structure.parameters.values
    return all(math.isclose(values[name], told[name], rel_tol=_SAME_VALUE) for name in told if name in values)


def _provenance(table: Mapping[str, Any]) -> Provenance | None:
    """Where a result came from; of one that was shortened by hand nothing is known."""
    try:
        told = dict(table["provenance"])
        maneuvers = tuple(
            LoggedManeuver(**{**one, "band_rad_s": one["band_rad_s"] and tuple(one["band_rad_s"])})
            for one in told.pop("maneuvers")
        )
        return Provenance(**told, maneuvers=maneuvers)
    except (KeyError, TypeError, ValueError):
        return None
