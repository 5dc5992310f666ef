"""Logs in, a model with bounds, verified, out."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, TypeVar, Unpack

from rotorid.data.findings import refusal, worst_first
from rotorid.data.record import FlightRecord
from rotorid.data.sensor_filters import with_sensor_filters
from rotorid.errors import InsufficientDataError
from rotorid.flights.command_noise import command_densities
from rotorid.flights.controller_check import controller_findings
from rotorid.flights.controllers import controllers_of
from rotorid.flights.filter_effects import rate_densities
from rotorid.flights.same_vehicle import require_one_vehicle
from rotorid.identifying.artificial_noise import with_noise_runs
from rotorid.identifying.derivation import derivation, derivation_findings
from rotorid.identifying.families import logged_by_all, method_of, require_choices
from rotorid.identifying.hover_physics import rotors_of_hover
from rotorid.identifying.methods import Fitted, Method, Prepared
from rotorid.io.records import as_records
from rotorid.models.families import family_of
from rotorid.results.model import IdentifiedModel, Records, Refused, parameter_estimates, pole_estimates
from rotorid.results.provenance import provenance
from rotorid.results.summary import ControllerSettings, ParameterEstimate, UnseenCombination
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.motors import MotorSettings
from rotorid.settings.option import Settings, as_names, as_settings
from rotorid.settings.resolve import Model, asked_model, read_model, resolve_model

if TYPE_CHECKING:
    from rotorid.settings.option_types import IdentifyOptions

DataT = TypeVar("DataT", bound=Prepared)
FittedT = TypeVar("FittedT", bound=Fitted)


def identify(
    records: Records,
    model: Model,
    *,
    settings: IdentifySettings | None = None,
    verify: Records = (),
    inputs: str | Sequence[str] = (),
    decoupled: bool = False,
    **options: Unpack[IdentifyOptions],
) -> IdentifiedModel:
    """Identify a model from flight records.

    The steps: find the excitations, bring the channels on one clock, prepare what is fitted, fit the structure and drop
    what the data do not show, bound the parameters, and predict flights that were not fitted. Most models are fitted to
    composite-window frequency responses (joint input–output where an instrument is logged) in CIFER's cost; responses
    to set-points, black boxes, and whatever ``settings.method`` says, in time; the physics of motors to accelerations.

    Parameters
    ----------
    records
        Logs as :func:`rotorid.read` gives them, or their files; one may come without a list around it.
    model
        A name of the library such as ``hover.longitudinal``, ``rate.roll`` or ``physical.motors``, a response model
        such as ``response.second_order``, which finds its channels in the logs, one such as ``drag.linear``,
        a TOML file, or a structure.
    settings
        Choices; everything has a default.
    verify
        Further records, kept unseen, to judge the model on.
    inputs
        Input channels of ``response.*``, ``transfer:m/n`` and ``black_box:N``; the option ``outputs`` has the others.
    decoupled
        Whether a black box is fitted for each input and its output.
    **options
        Fields of :class:`rotorid.settings.identifying.IdentifySettings`, which go before ``settings``.

    Returns
    -------
    IdentifiedModel
        The model with its covariance, its fit, and what it was checked on.

    Raises
    ------
    InsufficientDataError
        The data cannot support the model; its findings say why.
    UsageError, ModelError
        An option or a model is wrong.

    Examples
    --------
    >>> import rotorid
    >>> model = identify("flight.BIN", "rate.roll", verify="other.BIN")  # doctest: +SKIP
    >>> model["L_roll"].value  # doctest: +SKIP
    439.3
    """
    chosen = as_settings(IdentifySettings, settings, options)
    model = _with_channels(model, chosen, as_names(inputs), decoupled=decoupled)
    fitted = as_records(records)
    every = with_sensor_filters((*fitted, *as_records(verify, optional=True)), chosen.filters)
    logs, unseen = every[: len(fitted)], every[len(fitted) :]
    if chosen.add_noise_percent is None:
        return identify_by(method_of(model, logs, chosen), logs, verify=unseen)
    require_choices(model, chosen)
    # The search of the log itself is one; the runs with noise repeat it.
    plain = replace(chosen, add_noise_percent=None, runs=None)
    found = identify_by(method_of(model, logs, plain), logs, verify=unseen)
    return with_noise_runs(found, logs, chosen, partial(method_of, model))


def _with_channels(model: Model, settings: IdentifySettings, inputs: tuple[str, ...], *, decoupled: bool) -> Model:
    """A model with its channels, where some were named."""
    if not inputs and not decoupled:
        return model
    require_choices(model, settings, options={"--inputs": inputs, "--decoupled": decoupled})
    return asked_model(model, inputs=inputs, outputs=settings.outputs, decoupled=decoupled)


def identify_by(
    method: Method[DataT, FittedT],
    records: Sequence[FlightRecord],
    *,
    verify: Sequence[FlightRecord] = (),
) -> IdentifiedModel:
    """Identify by a given method, see :func:`identify`."""
    require_one_vehicle((*records, *verify))
    data = method.prepare(records)
    fitted = method.fit(data)
    unseen = method.verify(data, fitted, verify)
    report = method.describe(data, fitted)
    parameters = parameter_estimates(fitted.listed, fitted.bounds)
    _require_numbers(fitted.structure.name, parameters)
    derived = derivation(
        fitted.listed,
        fitted.bounds,
        known=_known(method.settings),
        covered=report.covered,
        flights=getattr(data, "flights", ()),
    )
    return IdentifiedModel(
        structure=fitted.structure,
        parameters=parameters,
        bounds=fitted.bounds,
        fit=report.fit,
        data=replace(
            report.data,
            command_densities=command_densities(records, fitted.structure.inputs),
            rate_densities=rate_densities(records, fitted.structure.inputs),
        ),
        verification=method.checks(fitted, unseen),
        verifications=unseen,
        pole_estimates=pole_estimates(report.poles),
        delays=report.delays,
        covered=report.covered,
        combinations=tuple(
            UnseenCombination(words=found.words(), vector=dict(found.vector)) for found in report.combinations
        ),
        motors=report.motors,
        flight=report.flight,
        rotors=rotors_of_hover(fitted.structure.name, data.flights, method.settings),
        nonlinear=report.nonlinear,
        derived=derived,
        controller=controller_settings(records),
        findings=worst_first(
            [
                *(finding for record in (*records, *verify) for finding in record.findings),
                *(finding for record in records for finding in controller_findings(record)),
                *data.findings,
                *method.remarks(data, fitted, report),
                *derivation_findings(derived),
                *unseen.findings,
            ]
        ),
        provenance=provenance(
            (*records, *verify),
            method.settings,
            flights=data.flights,
            response=data.response,
            sources=data.sources,
        ),
    )


def controller_settings(records: Sequence[FlightRecord]) -> ControllerSettings | None:
    """The controller of roll, pitch and yaw from the first log that has one."""
    return next((known for record in records if (known := controllers_of(record).settings()) is not None), None)


def _known(settings: Settings) -> Mapping[str, tuple[float, float]]:
    """Known values besides the parameters of a linear model."""
    return settings.known if isinstance(settings, IdentifySettings) else {}


def _require_numbers(model: str, parameters: Mapping[str, ParameterEstimate]) -> None:
    """Refuse what is no number, or has none for its uncertainty."""
    odd = [
        name
        for name, parameter in parameters.items()
        if not math.isfinite(parameter.value) or not (parameter.std is None or math.isfinite(parameter.std))
    ]
    if odd:
        message = f"The data do not determine {', '.join(odd)}."
        raise InsufficientDataError(
            f"{model} has no finite {', '.join(odd)}",
            needed="parameters that affect the data",
            remedy="fix some with --fix NAME=VALUE, or use a smaller model",
            findings=[refusal("not_identifiable", name, message) for name in odd],
        )


def identify_motors(records: Records, choices: MotorSettings | None = None, *, verify: Records = ()) -> IdentifiedModel:
    """Identify inertia, thrust, motor lag and torque constant from motor outputs, gyros and accelerometer.

    The same as :func:`identify` of ``physical.motors``, with all choices that this model has.

    Parameters
    ----------
    records
        Logs of one vehicle.
    choices
        What is known of it, and how to read the logs.
    verify
        Further logs, kept unseen.

    Raises
    ------
    InsufficientDataError
        The logs do not have enough data; findings say why.
    UsageError, ModelError
        A choice is wrong.
    """
    from rotorid.identifying.motors import Motors

    method = Motors(choices or MotorSettings())
    return identify_by(method, as_records(records), verify=as_records(verify, optional=True))


def refused(
    error: InsufficientDataError,
    records: Sequence[FlightRecord],
    model: Model,
    *,
    settings: IdentifySettings,
) -> Refused:
    """The result for data that cannot support a model."""
    read = read_model(model)
    structure = None if isinstance(read, str) else read
    if isinstance(read, str) and family_of(read).make is not None:
        with contextlib.suppress(InsufficientDataError):
            structure = resolve_model(read, outputs=settings.outputs, logged=logged_by_all(records))
    name = structure.name if structure is not None else str(model)
    reasons = error.findings or (refusal("not_identifiable", name, str(error)),)
    return Refused(
        name=name,
        structure=structure,
        findings=worst_first([*(finding for record in records for finding in record.findings), *reasons]),
        provenance=provenance(records, settings),
    )
