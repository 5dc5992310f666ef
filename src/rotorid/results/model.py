"""An identified model: its structure with values, their covariance, the data behind it, and what it was checked on."""

from __future__ import annotations

import html
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from rotorid._faces import attached
from rotorid.data.axes import RATE_OF
from rotorid.data.base import Immutable, optional, read_only
from rotorid.data.display import counted, cut, html_table, lines_of
from rotorid.data.findings import Finding, Findings
from rotorid.data.quantity import MISSING, TWO_SIDED_95, error_columns, percent
from rotorid.data.record import FlightRecord, Maneuver
from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.state_space import StateSpace
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import nonlinear_to_toml, to_toml
from rotorid.results.provenance import Provenance
from rotorid.results.segment import Segment
from rotorid.results.summary import (
    Checks,
    ControllerSettings,
    CrossValidationSummary,
    DelayBudget,
    DerivedSummary,
    Fit,
    FlightPhysics,
    HoverRotors,
    MotorPhysics,
    PairCost,
    ParameterEstimate,
    PoleEstimate,
    Range,
    RemovedFilters,
    UnseenCombination,
)
from rotorid.results.verdicts import NOT_IDENTIFIED, error_of, has_value, verdict
from rotorid.typing import Axis, BoolArray, ComplexArray, FloatArray
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.uncertainty.propagation import Pole, covariance_of_all, pole_confidence
from rotorid.verification.verification import Verification

if TYPE_CHECKING:
    from rotorid.simulation.linear import Hold
    from rotorid.simulation.rational_model import Delays, RationalModel

Records: TypeAlias = FlightRecord | str | Path | Iterable[FlightRecord | str | Path]
"""Logs as :func:`rotorid.read` gives them, or their files; one may come without a list around it."""

_NEAR_ZERO = 1e-12


@dataclass(frozen=True, kw_only=True, eq=False)
class SimulatedRecord(Immutable):
    """A fitted stretch of a record with what the model makes of its inputs, for time-domain fits.

    Parameters
    ----------
    record
        Name of the file.
    time_s
        Stamps on the log's own clock, shape ``(samples,)``.
    inputs
        Shape ``(u, samples)``, as differences from their mean.
    measured, simulated
        Outputs, shape ``(y, samples)``; initial state and trim of the simulation were estimated.
    starts
        Samples at which the simulation began anew, the first included.
    """

    record: str
    maneuver: Maneuver
    time_s: FloatArray
    inputs: FloatArray
    measured: FloatArray
    simulated: FloatArray
    starts: tuple[int, ...] = (0,)

    def __post_init__(self) -> None:
        self._set(
            time_s=read_only(self.time_s, np.float64, ndim=1),
            inputs=read_only(self.inputs, np.float64, ndim=2),
            measured=read_only(self.measured, np.float64, ndim=2),
            simulated=read_only(self.simulated, np.float64, ndim=2),
            starts=tuple(self.starts),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedData(Immutable):
    """The data that a model was fitted to.

    Parameters
    ----------
    response
        The measured response that was fitted; of a fit in time that of the same data, without any frequency where it
        could not be measured.
    direct
        The direct estimate beside it, when ``response`` is a joint one.
    model_response
        The model on the same grid, shape ``(y, u, f)``; the exact response, delays included.
    used
        Points that entered the fit, shape ``(y, u, f)``.
    least_coherence
        Coherence below which points were left out.
    segments
        The maneuvers that were used, with their data.
    simulated
        What a fit in time was made to: every record, measured and simulated.
    command_densities
        Command of a rate loop to rad/s and one-sided density of it over the whole log, shape ``(2, n)``.
    rate_densities
        Axis to rad/s and one-sided density of the noise of its rate behind the flown filters, shape ``(2, n)``, where
        the log shows that of its gyro.
    filters_removed
        Output to the filters that were taken out of its responses.
    """

    response: FrequencyResponse
    direct: FrequencyResponse | None
    model_response: ComplexArray
    used: BoolArray
    least_coherence: float = 0.6
    segments: tuple[Segment, ...] = ()
    simulated: tuple[SimulatedRecord, ...] = ()
    command_densities: Mapping[str, FloatArray] = field(default_factory=dict)
    rate_densities: Mapping[str, FloatArray] = field(default_factory=dict)
    filters_removed: Mapping[str, RemovedFilters] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class FrequencyCheck:
    """Scores of a model on unseen sweeps.

    Parameters
    ----------
    pairs
        Each response that has usable points, by ``output/input``, with CIFER's cost of the model against it.
    findings
        Remarks on the sweeps and on the costs.
    records
        Names of the logs.
    response
        The measured responses, or ``None`` where there are none.
    model_response
        The model on the same grid, shape ``(y, u, f)``.
    used
        Points that counted, shape ``(y, u, f)``.
    """

    pairs: Mapping[str, PairCost] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    records: tuple[str, ...] = ()
    response: FrequencyResponse | None = None
    model_response: ComplexArray | None = None
    used: BoolArray | None = None

    @property
    def costs(self) -> dict[str, float]:
        """Cost of each response that has usable points, by ``output/input``."""
        return {name: pair.value for name, pair in self.pairs.items()}


@dataclass(frozen=True, kw_only=True, eq=False)
class Verifications:
    """Verifications of a model on unseen flights.

    Parameters
    ----------
    maneuvers
        Unseen maneuvers, measured and predicted in the time domain.
    sweeps
        Unseen sweeps in the frequency domain, with the measured responses and those of the model.
    frequency
        Cost of the model against each response of unseen sweeps, the worst where several logs were judged.
    """

    maneuvers: tuple[Verification, ...] = ()
    sweeps: tuple[FrequencyCheck, ...] = ()
    frequency: Mapping[str, float] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class IdentifiedModel(Immutable):
    r"""A model with all that is known about it.

    Parameters
    ----------
    structure
        The model with its identified values, without states that a dropped lag has left without dynamics.
    parameters
        Every parameter of the model, dropped ones included, by its name: value, unit, standard deviation, CIFER's
        percents, status.
    bounds
        Covariance of the free parameters: random errors, and what the structure leaves out.
    fit
        How it was fitted, and how well it follows the data.
    data
        Measured responses, maneuvers and simulated records.
    verification
        What unseen flights say, in numbers.
    verifications
        The same with measured and predicted signals; empty in a model that was loaded.
    pole_estimates
        Poles with their uncertainty in numbers, slowest first; none of ``physical.motors`` and ``physical.flight``,
        whose rotors have one each.
    delays
        Delays of every fitted response ``output/input``.
    covered
        Ranges of speeds, angles and commands that the data covered.
    combinations
        Parameters that the data cannot separate.
    motors
        Rotors and thrust, of ``physical.motors`` and ``physical.flight``.
    flight
        Air and range, of ``physical.flight``.
    rotors
        Rotors, of ``physical.hover``.
    nonlinear
        The equations with their identified values, of a nonlinear model; ``structure`` is then its small motion about
        rest.
    derived
        What follows from the parameters and from what was known beside them.
    controller
        What the first log says of the controller that flew.
    cross_validation
        Where one was asked for.
    findings
        Remarks, the worst first.
    provenance
        Where the model came from.

    Examples
    --------
    >>> import rotorid
    >>> model = rotorid.identify([rotorid.read("flight.BIN")], "rate.roll")  # doctest: +SKIP
    >>> model["L_roll"].value, model["L_roll"].std  # doctest: +SKIP
    (439.3, 3.1)
    >>> model.poles[0].words()  # doctest: +SKIP
    'The pole at -4.31 1/s is known to 0.42 1/s.'
    """

    structure: LinearStructure
    parameters: Mapping[str, ParameterEstimate]
    bounds: Bounds
    fit: Fit
    data: FittedData
    provenance: Provenance
    verification: Checks = field(default_factory=Checks)
    verifications: Verifications = field(default_factory=Verifications)
    pole_estimates: tuple[PoleEstimate, ...] = ()
    delays: Mapping[str, DelayBudget] = field(default_factory=dict)
    covered: Mapping[str, Range] = field(default_factory=dict)
    combinations: tuple[UnseenCombination, ...] = ()
    motors: MotorPhysics | None = None
    flight: FlightPhysics | None = None
    rotors: HoverRotors | None = None
    nonlinear: NonlinearStructure | None = None
    derived: DerivedSummary | None = None
    controller: ControllerSettings | None = None
    cross_validation: CrossValidationSummary | None = None
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        self._set(
            parameters=self.parameters,
            delays=self.delays,
            covered=self.covered,
            combinations=tuple(self.combinations),
            findings=Findings(self.findings),
        )

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.structure.name

    def __contains__(self, name: object) -> bool:
        """Whether a parameter has this name."""
        return name in self.parameters

    def __getitem__(self, name: str) -> ParameterEstimate:
        """A parameter by its name.

        Raises
        ------
        UsageError
            The model has no such parameter.
        """
        if name not in self.parameters:
            raise UsageError(f"{self.name} has no parameter {name}", needed=f"one of {', '.join(self.parameters)}")
        return self.parameters[name]

    @property
    def system(self) -> StateSpace:
        """The model as numbers, delays included."""
        return self.structure.matrices(self.structure.parameters.values)

    @property
    def poles(self) -> tuple[Pole, ...]:
        """Poles with their uncertainty, slowest first."""
        own = self.structure.parameters
        return tuple(pole_confidence(self.structure, own, bounds_of(self.bounds, own.free)))

    @property
    def band_rad_s(self) -> tuple[float, float] | None:
        """Lowest and highest fitted frequency; ``None`` where no responses were fitted."""
        bands = [pair.band_rad_s for pair in self.fit.cost.pairs.values()] if self.fit.cost else []
        return (min(low for low, _ in bands), max(high for _, high in bands)) if bands else None

    def response(self, omega_rad_s: FloatArray | Sequence[float]) -> ComplexArray:
        r"""Frequency response of the model at some frequencies, shape ``(y, u, f)``, exact with its delays."""
        return self.structure.response(
            self.structure.parameters.values, np.atleast_1d(np.asarray(omega_rad_s, dtype=np.float64))
        )

    def simulate(
        self,
        u: FloatArray | Sequence[float],
        *,
        sample_rate_hz: float,
        x0: FloatArray | None = None,
        hold: Hold | None = None,
    ) -> FloatArray:
        """Outputs of the model to its inputs, shape ``(y, samples)``; see :func:`rotorid.simulation.simulate_linear`.

        Parameters
        ----------
        u
            Inputs as differences from trim, shape ``(u, samples)``, or ``(samples,)`` for one; those of a nonlinear
            model as they are.
        sample_rate_hz
            Rate of inputs and outputs.
        x0
            States at the first sample, zero by default.
        hold
            What the inputs do between their samples; as in the fit by default, ``zero`` where it had none.

        Raises
        ------
        UsageError
            The inputs do not match the model.
        """
        from rotorid.simulation.linear import simulate_linear

        inputs, input_hold = np.atleast_2d(np.asarray(u, dtype=np.float64)), hold or self.fit.hold or "zero"
        if self.nonlinear is not None:
            from rotorid.simulation.nonlinear import Scheme, simulate_nonlinear

            equations = self.nonlinear
            return simulate_nonlinear(
                equations,
                equations.parameters.values,
                inputs,
                sample_rate_hz=sample_rate_hz,
                x0=x0,
                scheme=Scheme(hold=input_hold),
            )
        return simulate_linear(self.system, inputs, sample_rate_hz=sample_rate_hz, x0=x0, hold=input_hold)

    @property
    def rate_axes(self) -> tuple[Axis, ...]:
        """Axes whose rate model is in this one: rate by command, in ``rate.*``, ``axis.*`` and ``hover.*`` alike."""
        own = self.structure
        if self.motors is not None or self.nonlinear is not None:
            return ()
        return tuple(axis for axis, rate in RATE_OF.items() if f"{axis}_command" in own.inputs and rate in own.outputs)

    def rate_response(self, axis: Axis, omega_rad_s: FloatArray) -> ComplexArray:
        r"""Response of the rate of an axis to its command, shape ``(f,)``.

        .. math:: P(j\omega) = p / \delta_{roll} \quad \text{or} \quad q / \delta_{pitch}, \; r / \delta_{yaw}

        An unstable model has the response that its bounded motion has under a controller.

        Parameters
        ----------
        axis
            One of :attr:`rate_axes`.
        omega_rad_s
            Frequencies, shape ``(f,)``.
        """
        own = self.structure
        y, u = own.outputs.index(RATE_OF[axis]), own.inputs.index(f"{axis}_command")
        return np.asarray(self.system.response(omega_rad_s)[y, u])

    def to_toml(self) -> str:
        """The structure with the identified values and their standard deviations, as in ``model.toml``."""
        std = self.bounds.stds
        if self.nonlinear is not None:
            return nonlinear_to_toml(self.nonlinear, std)
        own = self.structure.parameters
        return to_toml(self.structure, own, {name: value for name, value in std.items() if name in own.names})

    def rational(
        self, *, delays: Delays = "states", pade_order: int | None = None, sample_rate_hz: float | None = None
    ) -> RationalModel:
        """The model as a state space without delays; see :func:`rotorid.simulation.rational`.

        Parameters
        ----------
        delays
            As ``states``, as a ``lag``, or ``none`` at all.
        pade_order
            Order of the approximation by states; by default the lowest whose phase is right, see
            :func:`rotorid.simulation.rational_model.sufficient_order`.
        sample_rate_hz
            Rate of a sampled model, exact for held inputs; continuous without it.

        Raises
        ------
        UsageError
            The order or the rate is out of range.
        ModelError
            The model has no proper state space.
        """
        from rotorid.simulation.rational_model import rational, right_up_to, sufficient_order

        system = self.system
        if pade_order is None:
            pade_order = sufficient_order(system, right_up_to(system, self.band_rad_s))
        return rational(
            system,
            delays=delays,
            pade_order=pade_order,
            sample_rate_hz=sample_rate_hz,
            states=self.structure.states,
        )

    def to_control(
        self, *, delays: Delays = "states", pade_order: int | None = None, sample_rate_hz: float | None = None
    ) -> Any:
        """The model as a ``control.StateSpace``, delays by default as Padé approximations.

        Parameters
        ----------
        delays, pade_order, sample_rate_hz
            As for :meth:`rational`.

        Raises
        ------
        UsageError
            python-control is not installed.
        ModelError
            The model has no proper state space.
        """
        control = optional("control")
        model = self.rational(delays=delays, pade_order=pade_order, sample_rate_hz=sample_rate_hz)
        return control.ss(
            *(np.array(getattr(model, name)) for name in "ABCD"),
            0 if model.sample_time_s is None else model.sample_time_s,
            inputs=list(self.structure.inputs),
            outputs=list(self.structure.outputs),
            states=list(model.states) or None,
        )

    def to_scipy(
        self, *, delays: Delays = "states", pade_order: int | None = None, sample_rate_hz: float | None = None
    ) -> Any:
        """The model as a ``scipy.signal.StateSpace``, delays by default as Padé approximations.

        Parameters
        ----------
        delays, pade_order, sample_rate_hz
            As for :meth:`rational`.

        Raises
        ------
        ModelError
            The model has no proper state space.
        """
        from scipy.signal import StateSpace as ScipyStateSpace

        model = self.rational(delays=delays, pade_order=pade_order, sample_rate_hz=sample_rate_hz)
        matrices = [np.array(getattr(model, name)) for name in "ABCD"]
        return ScipyStateSpace(*matrices, **({} if model.sample_time_s is None else {"dt": model.sample_time_s}))

    def measured_to_control(self) -> Any:
        """The measured response as a ``control.FrequencyResponseData``.

        Raises
        ------
        UsageError
            python-control is not installed.
        """
        measured = self.data.response
        return optional("control").frd(
            np.array(measured.values),
            np.array(measured.omega_rad_s),
            inputs=list(measured.inputs),
            outputs=list(measured.outputs),
        )

    @property
    def plot(self) -> Any:
        """Its pictures."""
        return attached(self)

    def __repr__(self) -> str:
        return "\n".join([lines_of(self._head, self._rows()), *(cut(f"  {line}") for line in self._summary_lines())])

    def _repr_html_(self) -> str:
        columns = ["parameter", "value", "± std", "unit", "CR %", "I %", "status"]
        poles = [
            (f"{pole.value:.4g}", *error_columns(pole.frequency_rad_s, pole.frequency_std_rad_s)) for pole in self.poles
        ]
        paragraphs = "".join(f"<p>{html.escape(line)}</p>" for line in self._summary_lines())
        table = html_table("Poles", ["pole in 1/s", "rad/s", "± std"], poles)
        return html_table(self._head, columns, self._table()) + paragraphs + table

    @property
    def _head(self) -> str:
        method = self.fit.method.replace("_", " ")
        return f"{self.name}: {', '.join(self.structure.inputs)} to {', '.join(self.fit.outputs)}, by {method}"

    def _table(self) -> Iterator[tuple[str, ...]]:
        for name, found in self.parameters.items():
            if found.status != "dropped":
                known = has_value(name, found, self.findings)
                error = error_of(name, found, self.findings)
                value, std = error_columns(found.value, error, digits=5) if known else (MISSING, "")
                bounds = (found.cramer_rao_percent, found.insensitivity_percent)
                percents = ("" if bound is None else percent(bound) for bound in bounds)
                yield name, value, std, found.unit, *percents, found.status if known else NOT_IDENTIFIED

    def _rows(self) -> list[tuple[str, ...]]:
        most = 12
        rows: list[tuple[str, ...]] = [
            (name, value, f"± {std}" if std else "", unit, "" if status == "free" else status)
            for name, value, std, unit, *_, status in self._table()
        ]
        return rows if len(rows) <= most else [*rows[: most - 1], (f"… {len(rows) - most + 1} more", "", "", "", "")]

    def _summary_lines(self) -> list[str]:
        """Cost or fit, verdict on unseen flights, and number of findings."""
        lines = []
        found = verdict(self)
        lines.append(f"fit: {found.word}. {found.reason}")
        if self.fit.fit_percent:
            lines.append(f"explained: {', '.join(f'{n} {p:.1f} %' for n, p in self.fit.fit_percent.items())}")
        checks = self.verification
        verdicts = [check.verdict for check in checks.maneuvers]
        if checks.records:
            verdict_words = ", ".join(f"{verdicts.count(word)} {word}" for word in dict.fromkeys(verdicts)) or "scored"
            lines.append(f"unseen maneuvers: {verdict_words}")
        if checks.frequency:
            lines.append(f"unseen sweeps: cost {max(checks.frequency.values()):.1f} at most")
        if not checks.records and not checks.frequency:
            lines.append("not verified on unseen flights")
        words = {"error": "error", "warning": "warning", "info": "remark"}
        counts = {word: sum(finding.severity == kind for finding in self.findings) for kind, word in words.items()}
        numbers = [counted(count, word) for word, count in counts.items() if count]
        lines.append(f"findings: {', '.join(numbers) or 'none'}")
        return lines


@dataclass(frozen=True, kw_only=True, eq=False)
class Refused(Immutable):
    """A result without numbers, with findings on why.

    Parameters
    ----------
    name
        Of the model.
    structure
        The model, where that much is known.
    findings
        The reasons, and the remarks on the logs.
    """

    name: str
    structure: LinearStructure | NonlinearStructure | None
    findings: tuple[Finding, ...]
    provenance: Provenance


def as_models(models: IdentifiedModel | Iterable[IdentifiedModel], *, remedy: str = "") -> tuple[IdentifiedModel, ...]:
    """Identified models; a single one may come without a list around it.

    Parameters
    ----------
    models
        What a program handed to a verb.
    remedy
        What to do about a text, which is a folder of a result that nobody has read by default.

    Raises
    ------
    UsageError
        One of them is no model.

    Examples
    --------
    >>> as_models("rotorid-out/flight")
    Traceback (most recent call last):
    rotorid.errors.UsageError: 'rotorid-out/flight' is no identified model; read a result with rotorid.load.
    """
    single = isinstance(models, IdentifiedModel | str | Path) or not isinstance(models, Iterable)
    found = (models,) if single else tuple(models)  # type: ignore[arg-type]
    for model in found:
        if not isinstance(model, IdentifiedModel):
            text = isinstance(model, str | Path)
            raise UsageError(
                f"{cut(repr(str(model)), 60) if text else type(model).__name__} is no identified model",
                needed="" if text else "what rotorid.identify or rotorid.load gave",
                remedy=(remedy or "read a result with rotorid.load") if text else "",
            )
    return found  # type: ignore[return-value]


def bounds_of(bounds: Bounds, names: Sequence[str]) -> Bounds:
    """The bounds of some of the parameters, in the order of ``names``."""
    if tuple(names) == bounds.names:
        return bounds
    rows = [bounds.names.index(name) for name in names]
    return replace(
        bounds,
        names=tuple(names),
        cramer_rao=bounds.cramer_rao[rows],
        insensitivity=bounds.insensitivity[rows],
        covariance=bounds.covariance[np.ix_(rows, rows)],
        random=bounds.random[np.ix_(rows, rows)],
        assumed=None if bounds.assumed is None else bounds.assumed[rows],
        implied={tie: moved[rows] for tie, moved in bounds.implied.items()},
    )


def parameter_estimates(parameters: ParameterSet, bounds: Bounds) -> dict[str, ParameterEstimate]:
    """Every parameter with its uncertainty."""
    rows = {name: index for index, name in enumerate(bounds.names)}
    total = np.sqrt(np.diag(covariance_of_all(parameters, bounds)))
    if bounds.assumed is not None or bounds.implied:
        # Derivatives were measured: what is assumed to read physical parameters from them is no error of theirs.
        made_of = [bounds.implied.keys() & _made_of(parameters, parameter.name) for parameter in parameters]
        for ties in map(set, dict.fromkeys(map(frozenset, made_of))):
            measured = np.sqrt(np.diag(covariance_of_all(parameters, bounds.of_measured(ties))))
            here = [one.tied is not None and of == ties for one, of in zip(parameters, made_of, strict=True)]
            total = np.where(here, measured, total)
    random = np.sqrt(np.diag(covariance_of_all(parameters, replace(bounds, covariance=bounds.random))))
    values = parameters.values
    return {
        parameter.name: _estimate(
            parameter, values[parameter.name], (float(std), float(part)), bounds, rows.get(parameter.name)
        )
        for parameter, std, part in zip(parameters, total, random, strict=True)
    }


def _made_of(parameters: ParameterSet, name: str) -> set[str]:
    """A parameter, and all that its ties are made of."""
    tied = parameters[name].tied
    return {name}.union(*(_made_of(parameters, one) for one in tied.names if one in parameters.names) if tied else ())


def _estimate(
    parameter: Parameter, value: float, stds: tuple[float, float], bounds: Bounds, row: int | None
) -> ParameterEstimate:
    std, random = stds
    if row is None and (parameter.status != "tied" or std == 0.0):
        return ParameterEstimate(value=value, unit=parameter.unit, status=parameter.status)
    spread = {
        "std": std,
        "std_random": random,
        "std_model": float(np.sqrt(max(std**2 - random**2, 0.0))),
        "lower": value - TWO_SIDED_95 * std,
        "upper": value + TWO_SIDED_95 * std,
    }
    if row is None:
        return ParameterEstimate(value=value, unit=parameter.unit, status=parameter.status, **spread)
    size = abs(value)
    return ParameterEstimate(
        value=value,
        unit=parameter.unit,
        **spread,
        cramer_rao_percent=100.0 * float(bounds.cramer_rao[row]) / size if size > _NEAR_ZERO else None,
        insensitivity_percent=100.0 * float(bounds.insensitivity[row]) / size if size > _NEAR_ZERO else None,
        status=parameter.status,
    )


def pole_estimates(poles: Sequence[Pole]) -> tuple[PoleEstimate, ...]:
    """Poles in numbers."""
    return tuple(
        PoleEstimate(
            real=float(pole.value.real),
            imag=float(pole.value.imag),
            damping=pole.damping or 0.0,
            frequency_rad_s=pole.frequency_rad_s,
            real_std=_root(pole.covariance, 0),
            imag_std=_root(pole.covariance, 1),
            damping_std=pole.damping_std,
            frequency_std_rad_s=pole.frequency_std_rad_s,
        )
        for pole in poles
    )


def _root(covariance: FloatArray | None, index: int) -> float | None:
    return None if covariance is None else float(np.sqrt(covariance[index, index]))


def no_response(structure: LinearStructure | NonlinearStructure) -> FrequencyResponse:
    """A response that could be measured at no frequency."""
    shape = (len(structure.outputs), len(structure.inputs), 0)
    return FrequencyResponse(
        omega_rad_s=np.zeros(0),
        values=np.zeros(shape, dtype=np.complex128),
        coherence=np.zeros(shape),
        random_error=np.zeros(shape),
        covariance=np.zeros((*shape, 0), dtype=np.complex128),
        inputs=structure.inputs,
        outputs=structure.outputs,
        estimate="direct",
    )
