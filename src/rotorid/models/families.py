"""Families of models: how a name is recognized, and what every verb asks of a model.

A verb asks the family of a model instead of comparing its name: which channels drive it, what a log has to hold,
whether ``--model all`` tries it, whether its single parameters mean anything. A row of :data:`FAMILIES` holds all
answers; what fits a family, and which choices it takes, is a row of :mod:`rotorid.identifying.families`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias

from rotorid.data.findings import refusal
from rotorid.errors import InsufficientDataError, ModelError, RotoridError, UsageError, nearest_name
from rotorid.models.black_box import black_box, black_box_pairs
from rotorid.models.flight import FLIGHT_PARAMETERS
from rotorid.models.library import (
    RESPONSE_MODELS,
    library_model,
    library_text,
    model_names,
    nonlinear_library_text,
    nonlinear_model,
    nonlinear_model_names,
    rate_model,
    response_model,
    response_pairs,
    transfer_function,
)
from rotorid.models.motor_speed import NAME as MOTOR_SPEED_NAME
from rotorid.models.motor_speed import UNITS as MOTOR_SPEED_UNITS
from rotorid.models.motors import motor_parameters
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.models.physical import PHYSICAL_UNITS
from rotorid.models.structure import LinearStructure
from rotorid.typing import Axis

Structure: TypeAlias = LinearStructure | NonlinearStructure

Needs: TypeAlias = Literal["axis", "axes", "motors", "flight", "motor speeds", "single motors"]
"""What a log has to hold: of rate models the excitation of their axis, or a stick that moves it; of all others
excitations of one or several axes; outputs of all motors, with all axes of the sensors and motion through the air, or
with their speeds; or single motors that are swept.
:mod:`rotorid.flights.supports` looks for each."""


class Channels(NamedTuple):
    """What drives a model without channels of its own, and what answers.

    Parameters
    ----------
    inputs, outputs
        As they were named; of a response model they belong together in their order.
    decoupled
        Whether a black box is one for each input and its output, side by side.
    logged
        Channels of the logs, in which pairs are found where none was named.
    """

    inputs: Sequence[str] = ()
    outputs: Sequence[str] = ()
    decoupled: bool = False
    logged: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class Family:
    """Models that are alike for every verb.

    Parameters
    ----------
    name
        How lists and sentences call it, such as ``response.*``.
    pattern
        What a whole name looks like, as a regular expression; empty where the listed names are all.
    listed
        Names of its models that are no files of the library.
    about
        What a model is, in a sentence.
    together
        What all of them are, where a list names them in one line.
    make
        The structure of a model and its channels; ``None`` where it is no structure.
    text
        The TOML file of a model; ``None`` where it is written from the structure.
    nonlinear
        Whether they are nonlinear structures.
    channels
        Whether a model has its ``own`` channels, takes those that are ``given``, or else finds them in what is
        ``logged``.
    by_logs
        Whether a model is known only when the logs are read.
    units
        Units of its parameters, as far as they are known before.
    needs, axes, outputs
        What a log has to hold, and for each model the axes that have to be excited, and outputs of which one is enough;
        ``None`` where nobody looks.
    in_all
        Whether ``--model all`` tries it.
    answers_setpoints
        Whether it is what an autopilot with its vehicle makes of set-points, and so is fitted in time by default.
    opaque
        Whether single parameters mean nothing, so that they have neither bounds to refuse by nor remarks.
    slowed_by_air
        Whether its forces along speed are those of a hovering vehicle, which air can only slow.
    drags_by_rotors
        Whether drag is counted to the side forces of its rotors alone.
    assumed
        Fixed numbers of the library that each vehicle has otherwise.
    needs_result
        Whether a ``model.toml`` alone does not say how its inputs are had from a log.
    written
        What ``identify`` writes of a model that has no structure before the log is read.
    """

    name: str
    about: Callable[[str], str]
    pattern: str = ""
    listed: tuple[str, ...] = ()
    together: str = ""
    make: Callable[[str, Channels], Structure] | None = None
    text: Callable[[str], str] | None = None
    nonlinear: bool = False
    channels: Literal["own", "given", "logged"] = "own"
    by_logs: bool = False
    units: Mapping[str, str] = field(default_factory=dict)
    needs: Needs | None = None
    axes: Mapping[str, tuple[Axis, ...]] = field(default_factory=dict)
    outputs: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    in_all: bool = False
    answers_setpoints: bool = False
    opaque: bool = False
    slowed_by_air: bool = False
    drags_by_rotors: bool = False
    assumed: tuple[str, ...] = ()
    needs_result: bool = False
    written: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its models, where they can be listed."""
        return self.listed or tuple(name for name in model_names() if family_of(name) is self)

    @property
    def of_rates(self) -> bool:
        """Whether it has the rate of one axis after its command, and nothing besides."""
        return self.needs == "axis"

    @property
    def of_plans(self) -> bool:
        """Whether a plan of set-points says what its channels are, and foretells its parameters."""
        return self.answers_setpoints and not self.opaque

    def has(self, name: str) -> bool:
        """Whether a name is that of one of its models."""
        # A name with a line break is one too, of nobody's model.
        return re.fullmatch(self.pattern, name, re.DOTALL) is not None if self.pattern else name in self.listed


def _first_sentence(text: str) -> str:
    """The first sentence of the comment with which a model begins."""
    comment = takewhile(lambda line: line.startswith("#"), text.splitlines())
    sentence, dot, _ = " ".join(line.removeprefix("#").strip() for line in comment).partition(". ")
    return sentence + dot.strip()


def _about_response(name: str) -> str:
    plain = name.removesuffix("_delay")
    return _RESPONSES[plain] if plain == name else f"As {plain}, with a delay of each."


_RESPONSES = {
    "response.first_order": "Gain and time constant from each set-point to what it is of, as an autopilot flies it.",
    "response.second_order": "Gain, frequency and damping from each set-point to what it is of.",
    "response.second_order_zero": "The same with a zero.",
}


def _transfer_function(name: str, channels: Channels) -> LinearStructure:
    _require_channels(name, channels)
    above, below = map(int, name.partition(":")[2].split("/"))
    return transfer_function(numerator=above, denominator=below, inputs=channels.inputs, outputs=channels.outputs)


def _black_box(name: str, channels: Channels) -> LinearStructure:
    if not channels.inputs and channels.logged:
        # From the set-points of the logs, each to its own answer.
        pairs = _pairs_of(name, channels)
        channels = Channels([u for u, _ in pairs], [y for _, y in pairs], decoupled=True)
    _require_channels(name, channels)
    order, delays = _order(name), name.endswith("+delay")
    if channels.decoupled:
        box = black_box_pairs(order, _paired(name, channels), delays=delays)
    else:
        box = black_box(order, channels.inputs, channels.outputs, delays=delays)
    return replace(box, name=_AUTO) if order_is_open(name) else box


RATE_AXIS: Mapping[str, Axis] = {
    "rate.roll": "roll",
    "rate.pitch": "pitch",
    "rate.yaw": "yaw",
    "rate.vertical": "thrust",
}
"""Axis of each rate model."""

RATE = Family(
    name="rate.*",
    pattern=r"rate\..+",
    listed=tuple(RATE_AXIS),
    about=lambda _: (
        "Response of one rate to its command: gain, damping, motor lag, delay. Valid from about 3 to 8 rad/s up."
    ),
    make=lambda name, _: rate_model(name),
    needs="axis",
    axes={name: (axis,) for name, axis in RATE_AXIS.items()},
    in_all=True,
)

OWN = Family(
    name="FILE.toml",
    pattern=r".*",
    about=lambda name: _first_sentence(library_text(name)),
    make=lambda name, _: library_model(name),
    text=library_text,
)
"""Every other linear structure: one of a user, or a file that was added to the library."""

AIRFRAME = replace(
    OWN,
    name="axis.*, hover.*",
    pattern=r"(axis|hover)\..+",
    needs="axes",
    axes={"hover.longitudinal": ("pitch", "thrust"), "hover.lateral": ("roll", "yaw")},
    in_all=True,
    slowed_by_air=True,
)

HOVER = replace(
    OWN,
    name="physical.hover",
    pattern=r"physical\.hover",
    by_logs=True,
    units=PHYSICAL_UNITS,
    drags_by_rotors=True,
)
"""Hover in physical parameters, of the rotors of the vehicle that flew."""

RIG = replace(
    OWN,
    name="rig.*",
    pattern=r"rig\..+",
    needs="single motors",
    axes={"rig.roll": ("roll",), "rig.attitude": ("roll", "pitch")},
    outputs={"rig.roll": ("phi", "p"), "rig.attitude": ("phi", "theta", "psi")},
    assumed=("L",),
)

RESPONSE = Family(
    name="response.*",
    listed=RESPONSE_MODELS,
    about=_about_response,
    together=(
        "From each set-point to what it is of: first_order, second_order or second_order_zero, with _delay or without."
    ),
    make=lambda name, channels: response_model(name, _pairs_of(name, channels)),
    channels="logged",
    by_logs=True,
    answers_setpoints=True,
)

MOTORS = Family(
    name="physical.motors",
    listed=("physical.motors",),
    about=lambda _: (
        "Inertia, thrust, motor lag and torque of the vehicle from its motor outputs, gyros and accelerometer."
    ),
    by_logs=True,
    units={motor_parameter.name: motor_parameter.unit for motor_parameter in motor_parameters(known={"kappa": 1.0})},
    needs="motors",
    axes={"physical.motors": ()},
    in_all=True,
    needs_result=True,
    written="its linear model about hover",
)
"""Accelerations by motor outputs, which is no linear structure."""

FLIGHT = Family(
    name="physical.flight",
    listed=("physical.flight",),
    about=lambda _: "Thrust with inflow, rotor drag, inertia and wind: one physical model from hover to fast flight.",
    by_logs=True,
    units={name: parameter.unit for name, parameter in FLIGHT_PARAMETERS.items()},
    needs="flight",
    axes={"physical.flight": ()},
    in_all=True,
    needs_result=True,
    written="its linear model about hover",
)
"""Forces and moments by motors and air, which is no linear structure."""

MOTOR_SPEED = Family(
    name=MOTOR_SPEED_NAME,
    listed=(MOTOR_SPEED_NAME,),
    about=lambda _: "Speed of the motors by their outputs: lag up and down, curve, influence of the battery's voltage.",
    by_logs=True,
    units=MOTOR_SPEED_UNITS,
    needs="motor speeds",
    axes={MOTOR_SPEED_NAME: ()},
    in_all=True,
    written="its equations for the motors of the log",
)
"""Speeds by outputs, a nonlinear structure of as many motors as a log has."""

LARGE_MOTION = Family(
    name="drag.*, flight.*",
    listed=nonlinear_model_names(),
    about=lambda name: _first_sentence(nonlinear_library_text(name)),
    make=lambda name, _: nonlinear_model(name),
    text=nonlinear_library_text,
    nonlinear=True,
)
"""Nonlinear structures, those of users too."""

TRANSFER = Family(
    name="transfer:m/n",
    pattern=r"transfer:\d+/\d+",
    about=lambda _: "Any transfer function, m zeros over n poles, between channels named with --inputs and --outputs.",
    make=_transfer_function,
    channels="given",
)

BLACK_BOX = Family(
    name="black_box:N",
    pattern=r"black_box:(\d+|auto)(\+delay)?",
    about=lambda _: (
        "Any state space of N states, between channels named with --inputs and --outputs; +delay for delays."
    ),
    make=_black_box,
    channels="logged",
    by_logs=True,
    answers_setpoints=True,
    opaque=True,
)

_AUTO = "black_box:auto"
"""A black box whose order the records choose; until then it is one of first order."""

FAMILIES = (RATE, AIRFRAME, HOVER, RIG, RESPONSE, MOTORS, FLIGHT, MOTOR_SPEED, LARGE_MOTION, TRANSFER, BLACK_BOX, OWN)
"""In the order of lists; the first that has a name is its family."""


def family_of(model: str | Path | Structure) -> Family:
    """The family of a model by its name, or of a structure.

    Examples
    --------
    >>> [family_of(name).name for name in ("rate.roll", "hover.lateral", "black_box:2", "mine")]
    ['rate.*', 'axis.*, hover.*', 'black_box:N', 'FILE.toml']
    """
    if isinstance(model, NonlinearStructure):
        return LARGE_MOTION
    name = str(model) if isinstance(model, str | Path) else getattr(model, "name", None)
    if name is None:
        raise UsageError(
            f"a model of type {type(model).__name__} is no model",
            needed="one name such as rate.roll, a TOML file or a structure",
        )
    return next(family for family in FAMILIES if family.has(name))


def axes_on_pivot(name: str) -> tuple[Axis, ...]:
    """Axes that a model of a vehicle on a pivot shows; none of other models.

    Examples
    --------
    >>> axes_on_pivot("rig.roll"), axes_on_pivot("rate.roll")
    (('roll',), ())
    """
    return RIG.axes[name] if RIG.has(name) else ()


def is_rate_model(structure: LinearStructure) -> bool:
    """Whether a structure is a rate model of the library, which a stick may show."""
    return structure.name in RATE_AXIS


def lacks_speed_modes(structure: LinearStructure) -> bool:
    """Whether a structure is a rate model of an axis that the speed of the vehicle turns too, by M_u and L_v.

    It has no place for these modes. Yaw and climb have none.
    """
    return RATE_AXIS.get(structure.name) in ("roll", "pitch")


def rate_model_of(axis: str) -> str:
    """The name of the rate model of an axis.

    Examples
    --------
    >>> rate_model_of("roll"), rate_model_of("thrust")
    ('rate.roll', 'rate.vertical')
    """
    return next(name for name, own in RATE_AXIS.items() if own == axis)


def known_names() -> tuple[str, ...]:
    """Names of models that need no more than their name."""
    return tuple(name for family in FAMILIES for name in family.names)


def waits_for_logs(model: str | Path | Structure, inputs: Sequence[str] = ()) -> bool:
    """Whether a model takes its channels or its rotors from the logs, so that it is known only when they are read.

    Examples
    --------
    >>> [waits_for_logs(name) for name in ("response.first_order", "black_box:2", "physical.hover", "rate.roll")]
    [True, True, True, False]
    """
    return not inputs and isinstance(model, str | Path) and family_of(model).by_logs


def black_box_order(structure: LinearStructure) -> int | None:
    """Order of a black box, one where it is still to be chosen; ``None`` for any other structure.

    Examples
    --------
    >>> black_box_order(named_model("black_box:3", inputs=["u"], outputs=["y"]))
    3
    """
    return _order(structure.name) if BLACK_BOX.has(structure.name) else None


def order_is_open(name: str) -> bool:
    """Whether the records choose the order of a black box.

    Examples
    --------
    >>> order_is_open("black_box:auto+delay"), order_is_open("black_box:2")
    (True, False)
    """
    return name.startswith(_AUTO)


def _order(name: str) -> int:
    return 1 if order_is_open(name) else int(name.partition(":")[2].removesuffix("+delay"))


def named_model(
    name: str,
    *,
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    decoupled: bool = False,
    logged: Sequence[str] = (),
) -> LinearStructure:
    """The linear structure behind a name: of the library, ``response.*``, ``transfer:m/n`` or ``black_box:N``.

    Parameters
    ----------
    name
        Such as ``hover.longitudinal``.
    inputs, outputs, decoupled, logged
        See :class:`Channels`.

    Raises
    ------
    ModelError
        There is no such model.
    UsageError
        A model without channels of its own came without any, inputs came for a model that has its own, or the model is
        nonlinear.
    InsufficientDataError
        The logs hold no pair of set-point and response.

    Examples
    --------
    >>> named_model("transfer:0/1", inputs=["roll_command"], outputs=["p"]).parameters.names
    ('b0', 'a0', 'tau')
    >>> named_model("response.first_order", logged=["phi", "phi_setpoint", "theta"]).parameters.names
    ('K_phi', 'T_phi')
    >>> named_model("black_box:2+delay", inputs=["u"], outputs=["y"]).parameters.names
    ('a0_1', 'a1_1', 'b_x1', 'b_x2', 'tau')
    """
    family = family_of(name)
    if family.make is None:
        raise ModelError(
            f"{name} is not a linear structure",
            needed="a linear structure",
            remedy=f'rotorid identify LOG --model {name}, in Python rotorid.identify(log, "{name}")',
        )
    own = family.channels == "own"
    if own and name not in family.names:
        raise _unknown(name)
    structure = linear(family.make(name, Channels(inputs, outputs, decoupled, logged)))
    if own and inputs:
        raise has_inputs(structure, inputs)
    return structure


def linear(structure: Structure) -> LinearStructure:
    """A structure that has to be linear.

    Raises
    ------
    UsageError
        It is nonlinear.
    """
    if isinstance(structure, NonlinearStructure):
        raise UsageError(
            f"{structure.name} is nonlinear",
            needed="a linear structure",
            remedy="rotorid identify takes it by --model",
        )
    return structure


def has_inputs(structure: LinearStructure, inputs: Sequence[str]) -> UsageError:
    """That inputs came for a model that has its own."""
    return UsageError(
        f"the inputs {', '.join(inputs)} came with {structure.name}, which has {', '.join(structure.inputs)}",
        needed=f"--inputs with {without_channels()} alone",
        remedy="leave them out; inputs that were not excited take no part",
    )


def without_channels() -> str:
    """The families whose models have no channels of their own, in words."""
    *first, last = (family.name for family in FAMILIES if family.channels != "own")
    return f"{', '.join(first)} or {last}"


def _require_channels(name: str, channels: Channels) -> None:
    if not channels.inputs or not channels.outputs:
        raise UsageError(f"{name} needs channels", needed="--inputs and --outputs with their names")


def _paired(name: str, channels: Channels) -> tuple[tuple[str, str], ...]:
    inputs, outputs = channels.inputs, channels.outputs
    if len(inputs) != len(outputs):
        raise UsageError(
            f"got {len(inputs)} inputs and {len(outputs)} outputs for {name}", needed="an output for each input"
        )
    return tuple(zip(inputs, outputs, strict=True))


def _pairs_of(name: str, channels: Channels) -> tuple[tuple[str, str], ...]:
    if channels.inputs:
        return _paired(name, channels)
    outputs, logged = channels.outputs, channels.logged
    pairs = tuple(pair for pair in response_pairs(logged) if not outputs or pair[1] in outputs)
    if not pairs:
        raise _no_pair(name, outputs, logged)
    return pairs


def _no_pair(name: str, outputs: Sequence[str], logged: Sequence[str]) -> RotoridError:
    needed = "a channel and its set-point, such as phi and phi_setpoint"
    remedy = "name them with --inputs and --outputs, or in the log with --map"
    if not logged:
        return UsageError(f"{name} needs channels", needed=needed, remedy=remedy)
    which = f" of {', '.join(outputs)}" if outputs else ""
    message = f"No logged channel{which} has a set-point."
    finding = refusal("missing_channel", name, message)
    return InsufficientDataError(message, needed=needed, remedy=remedy, findings=[finding])


_AXES: Mapping[str, Axis] = {
    **{axis: axis for axis in ("roll", "pitch", "yaw")},
    **dict.fromkeys(("vertical", "az", "thrust", "heave"), "thrust"),
    "p": "roll",
    "q": "pitch",
    "r": "yaw",
}
"""Axes as people name them."""


def _unknown(model: str) -> ModelError:
    names = known_names()
    near = rate_model_of(_AXES[model.lower()]) if model.lower() in _AXES else ""
    near = near or nearest_name(model, (*names, "black_box:2"))
    made = [family.name for family in FAMILIES if not family.names and family is not OWN]
    return ModelError(
        f"there is no model {model!r}",
        needed=f"one of {', '.join((*names, *made))}, or a .toml file",
        remedy=f"did you mean {near}?" if near else "",
    )
