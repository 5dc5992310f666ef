"""How the models of a family are fitted, which choices they take, and the errors on others.

:mod:`rotorid.models.families` knows the models; here each family has its method. Most are linear structures, fitted to
responses or in time (:data:`LINEAR`); a row of :data:`FITTINGS` is a family that is fitted in another way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, get_args

from rotorid.data.record import FlightRecord
from rotorid.errors import UsageError, listed
from rotorid.flights.flight_data import flight_data
from rotorid.flights.motor_data import motor_data
from rotorid.models.derived import require_useful
from rotorid.models.families import FLIGHT, HOVER, LARGE_MOTION, MOTOR_SPEED, MOTORS, RIG, family_of
from rotorid.models.input_units import in_logged_units
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.models.structure import LinearStructure
from rotorid.settings.identifying import IdentifySettings, MethodChoice
from rotorid.settings.motors import MotorMethod, motor_settings
from rotorid.settings.option import options_given
from rotorid.settings.resolve import Model, read_model, resolve_model

if TYPE_CHECKING:
    from rotorid.identifying.methods import Method

# The methods of a family are imported where a model of it is fitted: a log of one vehicle needs one or two of six.

Read: TypeAlias = str | LinearStructure | NonlinearStructure
"""A model whose file was read: a structure, or a name of the library."""


class _Refusal(NamedTuple):
    """Error on a choice ``{wrong}`` that a model ``{name}`` lacks; it takes ``{methods}``, ``{others}`` have it."""

    came: str
    needed: str = ""
    remedy: str = ""

    def error(self, **words: str) -> UsageError:
        came, needed, remedy = (text.format(**words) for text in self)
        return UsageError(came, needed=needed, remedy=remedy)


_NO_CHOICE = _Refusal("{wrong} does not apply to {name}", remedy="leave it out, or choose another model")
_NO_METHOD = _Refusal("--method {wrong} does not apply to {name}", "one of {methods}")


@dataclass(frozen=True, kw_only=True)
class Fitting:
    """How the models of a family are fitted.

    Parameters
    ----------
    method
        The method for a model, with the logs in which it finds its channels, and the choices of the run.
    prepare
        What the method prepares, where that needs no module that fits: ``inspect`` asks for it and imports none.
    choices
        Fields of :class:`rotorid.settings.identifying.IdentifySettings` that its models have.
    methods
        Words of ``--method`` that they take.
    only_with
        Choices that one word of ``--method`` alone has.
    no_choice, no_method, no_option
        The errors on other fields, of other words, and of options that are no fields, such as ``--inputs``, where the
        family takes none.
    check
        What else refuses choices before any log is read.
    """

    method: Callable[[Read, Sequence[FlightRecord], IdentifySettings], Method[Any, Any]]
    choices: Sequence[str]
    methods: Sequence[str]
    no_choice: _Refusal = _NO_CHOICE
    no_method: _Refusal = _NO_METHOD
    no_option: _Refusal | None = None
    only_with: Mapping[str, str] = field(default_factory=dict)
    check: Callable[[Read, IdentifySettings], object] = lambda _, __: None
    prepare: Callable[[Sequence[FlightRecord], IdentifySettings], object] | None = None


def logged_by_all(records: Sequence[FlightRecord]) -> tuple[str, ...]:
    """Channels in every record."""
    names = [record.channel_names for record in records]
    return tuple(name for name in (names[0] if names else ()) if all(name in others for others in names))


def _linear(model: Read, records: Sequence[FlightRecord], settings: IdentifySettings) -> Method[Any, Any]:
    structure = resolve_model(model, outputs=settings.outputs, logged=logged_by_all(records))
    return _of_structure(in_logged_units(_of_logged_motors(structure, records), records), settings)


def _of_logged_motors(structure: LinearStructure, records: Sequence[FlightRecord]) -> LinearStructure:
    """A model of one axis on a pivot without the motors that no log has, which then stand still or are in a difference.

    Of two motors that work against each other the axis shows the difference alone: where one voltage drives both, it is
    that.
    """
    logged = [name for name in structure.inputs if any(name in record.channel_names for record in records)]
    family = family_of(structure)
    single = family.needs == "single motors" and len(family.axes.get(structure.name, ())) == 1
    return structure.select(inputs=logged) if single and 0 < len(logged) < len(structure.inputs) else structure


def _hover(_: Read, records: Sequence[FlightRecord], settings: IdentifySettings) -> Method[Any, Any]:
    from rotorid.identifying.hover_physics import hover_of_vehicle

    return _of_structure(hover_of_vehicle(records, settings), settings)


def _of_structure(structure: LinearStructure, settings: IdentifySettings) -> Method[Any, Any]:
    """By the method of the settings, else responses to set-points in time and all others in frequency."""
    from rotorid.identifying.methods import Frequency, InTime

    require_useful(structure.parameters.names, settings.known, model=structure.name)
    name = settings.method
    if name == "auto":
        name = "output_error" if family_of(structure).answers_setpoints else "frequency"
    if name == "frequency":
        return Frequency(model=structure, settings=settings)
    assert name != "accelerations"
    return InTime(model=structure, settings=settings, kind=name)


def _nonlinear(model: Read, _: Sequence[FlightRecord], settings: IdentifySettings) -> Method[Any, Any]:
    from rotorid.identifying.nonlinear import Nonlinear

    assert isinstance(model, NonlinearStructure)
    return Nonlinear(model=model, settings=settings)


def _motors(_: Read, __: Sequence[FlightRecord], settings: IdentifySettings) -> Method[Any, Any]:
    from rotorid.identifying.motors import Motors

    return Motors(motor_settings(settings))


def _flight(_: Read, __: Sequence[FlightRecord], settings: IdentifySettings) -> Method[Any, Any]:
    from rotorid.identifying.flight import Flights

    return Flights(settings=motor_settings(settings))


def _motor_speed(_: Read, __: Sequence[FlightRecord], settings: IdentifySettings) -> Method[Any, Any]:
    from rotorid.identifying.motor_speed import MotorSpeeds

    return MotorSpeeds(settings=settings)


def _require_parameters(model: Read, settings: IdentifySettings) -> None:
    from rotorid.identifying.nonlinear import asked_parameters

    assert isinstance(model, NonlinearStructure)
    asked_parameters(model, settings)


_OF_ROTORS = ("layout", "arm_m", "curve", "rotor_diameter_m")
"""Choices of models in physical parameters."""

_OF_FLIGHT = ("predictor",)
"""Choices of ``physical.flight`` alone."""

_OF_RUNS = ("add_noise_percent", "workers")
"""Choices of every model: how often it is identified, and by how many processes."""

_ALL = tuple(item.name for item in fields(IdentifySettings))

LINEAR = Fitting(
    method=_linear,
    choices=tuple(name for name in _ALL if name not in (*_OF_ROTORS, *_OF_FLIGHT)),
    methods=tuple(word for word in get_args(MethodChoice) if word != "accelerations"),
    no_choice=_Refusal("{wrong} does not apply to {name}", remedy="leave it out, or use {others}"),
    no_method=_Refusal("--method {wrong} does not apply to {name}", remedy=f"use it with {MOTORS.name}"),
)

FITTINGS: Mapping[str, Fitting] = {
    RIG.name: replace(
        LINEAR,
        no_choice=_Refusal(
            "{wrong} does not apply to {name}",
            remedy="leave it out, and give the distance from pivot to rotor with --fix L=VALUE",
        ),
    ),
    HOVER.name: replace(
        LINEAR, method=_hover, choices=tuple(name for name in _ALL if name not in ("curve", *_OF_FLIGHT))
    ),
    MOTORS.name: Fitting(
        method=_motors,
        prepare=lambda records, settings: motor_data(records, motor_settings(settings)),
        choices=(
            *_OF_ROTORS,
            *("filters", "fix", "segments", "seed", "method", "outputs", "bootstrap", "search", "evaluations", "runs"),
        ),
        methods=("auto", *get_args(MotorMethod)),
        only_with={"outputs": "accelerations"},
        no_option=_NO_CHOICE,
        check=lambda _, settings: motor_settings(settings),
    ),
    FLIGHT.name: Fitting(
        method=_flight,
        prepare=lambda records, settings: flight_data(records, motor_settings(settings)),
        choices=(*(name for name in _OF_ROTORS if name != "curve"), *_OF_FLIGHT, "fix", "segments", "seed", "method"),
        methods=("auto", "equation_error"),
        no_option=_NO_CHOICE,
        check=lambda _, settings: motor_settings(settings),
    ),
    MOTOR_SPEED.name: Fitting(
        method=_motor_speed,
        choices=("fix", "free", "segments", "shifts", "hold", "search", "evaluations", "runs", "seed", "method"),
        methods=("auto", "output_error"),
        no_option=_NO_CHOICE,
    ),
    LARGE_MOTION.name: Fitting(
        method=_nonlinear,
        choices=(
            *("fix", "ties", "free", "constants", "outputs", "segments", "shifts", "hold", "pieces_s"),
            *("starts", "search", "evaluations", "runs", "seed", "method"),
        ),
        methods=("auto", "output_error"),
        no_choice=_Refusal(
            "{wrong} does not apply to {name}, a nonlinear model",
            remedy="leave it out, or choose a linear model",
        ),
        no_method=_Refusal(
            "--method {wrong} does not apply to {name}, a nonlinear model",
            "--method output_error, the default",
        ),
        no_option=_Refusal(
            "{wrong} does not apply to {name}, a nonlinear model",
            "its own channels; --verify judges it on further logs, and each log is fitted separately too",
        ),
        check=_require_parameters,
    ),
}
"""Family to how it is fitted, where that is not :data:`LINEAR`."""


def fitting_of(model: Read) -> Fitting:
    """How a model is fitted."""
    family = family_of(model)
    # A structure has its channels and rotors already, and the small motion of a nonlinear model is linear.
    made = isinstance(model, LinearStructure) and family.make is not None
    return LINEAR if made and (family.by_logs or family.nonlinear) else FITTINGS.get(family.name, LINEAR)


def method_of(model: Model, records: Sequence[FlightRecord], settings: IdentifySettings) -> Method[Any, Any]:
    """Method of a model: that of the settings, else that of its family.

    Parameters
    ----------
    model, settings
        As for :func:`rotorid.identify`.
    records
        Logs in which a response model finds its channels.

    Raises
    ------
    UsageError, ModelError
        A choice or the model is wrong.
    InsufficientDataError
        The logs hold nothing that such a model is about.
    """
    read, fitting = _allowed(model, settings)
    return fitting.method(read, records, settings)


def require_ready(model: Model, records: Sequence[FlightRecord], settings: IdentifySettings) -> None:
    """Do all that is done before a fit, which refuses logs that do not hold what it needs.

    Parameters
    ----------
    model, settings
        As for :func:`rotorid.identify`.
    records
        Logs to fit.

    Raises
    ------
    UsageError, ModelError
        A choice or the model is wrong.
    InsufficientDataError
        The logs do not hold what the model needs.
    """
    read, fitting = _allowed(model, settings)
    if fitting.prepare is not None:
        fitting.prepare(records, settings)
    else:
        fitting.method(read, records, settings).prepare(records)


def require_choices(model: Model, settings: IdentifySettings, *, options: Mapping[str, object] | None = None) -> None:
    """Refuse choices that a model does not have, before any log is read for it.

    Parameters
    ----------
    model, settings
        As for :func:`rotorid.identify`.
    options
        Options that are no fields of the settings, such as ``--inputs``, with what was given.

    Raises
    ------
    UsageError
        A choice belongs to another family, or is impossible.
    ModelError
        A name is unknown.
    """
    _allowed(model, settings, options or {})


def _allowed(
    model: Model, settings: IdentifySettings, options: Mapping[str, object] = MappingProxyType({})
) -> tuple[Read, Fitting]:
    """A model that was read and how it is fitted, unless a choice is none that it has."""
    read = read_model(model)
    fitting = fitting_of(read)
    named = read if isinstance(read, NonlinearStructure) else model
    words = {"name": str(named) if isinstance(named, str | Path) else named.name}
    words["methods"] = ", ".join(fitting.methods)
    given = [option for option, value in options.items() if value and fitting.no_option is not None]
    alike = fitting.no_option is fitting.no_choice
    if fitting.no_option is not None and given and not alike:
        raise fitting.no_option.error(wrong=" and ".join(given), **words)
    if settings.method not in fitting.methods:
        raise fitting.no_method.error(wrong=settings.method, **words)
    own = _choices(fitting, settings)
    foreign = {name: option for name, option in options_given(settings).items() if name not in own}
    if wrong := [*foreign.values(), *(given if alike else ())]:
        raise fitting.no_choice.error(wrong=", ".join(wrong), others=_models_with(foreign), **words)
    fitting.check(read, settings)
    return read, fitting


def _choices(fitting: Fitting, settings: IdentifySettings) -> tuple[str, ...]:
    """Choices of a family in this run: noise can be added to the logs of any."""
    return (*fitting.choices, *_OF_RUNS, *(("runs",) if settings.add_noise_percent is not None else ()))


def _models_with(choices: Iterable[str]) -> str:
    """Models in physical parameters that have all of these choices, or words for none."""
    names = [family.name for family in (MOTORS, FLIGHT, HOVER) if {*choices} <= {*FITTINGS[family.name].choices}]
    return listed(names) or "each with its model"


def own_settings(model: Read, settings: IdentifySettings) -> IdentifySettings:
    """The settings without choices that a model does not have."""
    fitting, usual = fitting_of(model), IdentifySettings()
    foreign = {name for name in _ALL if name not in _choices(fitting, settings)}
    foreign |= {name for name, method in fitting.only_with.items() if settings.method != method}
    # Motors leave the methods of other models out; no other model leaves out theirs, which is refused.
    foreign |= {"method"} if settings.method in LINEAR.methods and settings.method not in fitting.methods else set()
    return replace(settings, **{name: getattr(usual, name) for name in foreign})
