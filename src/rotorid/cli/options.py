"""Options that several commands share.

Options that all commands share which measure responses, as the choices of a run.

Options of ``physical.motors``, the one model that is no linear structure.

Options of the commands that fly in simulation: wind, numbers of the vehicle, limits, shapes of test inputs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

if TYPE_CHECKING:
    from rotorid.data.flight_plan import Shape
    from rotorid.pipeline.settings import IdentifySettings, MotorChoices
    from rotorid.planning.amplitude import Limits
    from rotorid.simulation.wind import Wind
    from rotorid.typing import Axis


Logs: TypeAlias = Annotated[
    list[Path],
    typer.Argument(
        help="Flight logs: PX4, ArduPilot, Betaflight, Crazyflie, ROS, .mat, .csv and more; also compressed."
    ),
]
Log: TypeAlias = Annotated[
    Path, typer.Argument(help="A flight log: PX4, ArduPilot, Betaflight, Crazyflie, ROS, .mat, .csv and more.")
]
Map: TypeAlias = Annotated[
    Path | None, typer.Option("--map", help="TOML file that names the channels of any other source.")
]
Out: TypeAlias = Annotated[
    Path | None, typer.Option("--out", help="Folder for the results. [default: rotorid-out/NAME]")
]
Json: TypeAlias = Annotated[bool, typer.Option("--json", help="Print the result as JSON and nothing else.")]
Quiet: TypeAlias = Annotated[bool, typer.Option("--quiet", help="Say nothing but errors.")]
Seed: TypeAlias = Annotated[int, typer.Option("--seed", help="Seed of everything drawn at random.")]
Band: TypeAlias = Annotated[str | None, typer.Option("--band", help="LO:HI in rad/s. [default: what was excited]")]
Windows: TypeAlias = Annotated[str | None, typer.Option("--windows", help="S,S,... window lengths in seconds.")]
Coherence: TypeAlias = Annotated[
    float | None, typer.Option("--coherence", help="Least coherence of a point. [default: 0.6 direct, 0.2 joint]")
]
Estimate: TypeAlias = Annotated[str, typer.Option("--estimate", help="auto, direct or joint.")]
Instrument: TypeAlias = Annotated[
    str | None, typer.Option("--instrument", help="CHANNEL,... to use as instruments, one for each input.")
]
Segments: TypeAlias = Annotated[
    list[str] | None,
    typer.Option("--segment", help="AXIS:START:STOP to use instead of what is found, in log seconds. Repeatable."),
]
Shifts: TypeAlias = Annotated[
    list[str] | None,
    typer.Option("--shift", help="CHANNEL:SECONDS to delay it by, where inspect finds its stamps wrong. Repeatable."),
]
Method: TypeAlias = Annotated[
    str,
    typer.Option(
        "--method",
        help="frequency, output_error, prediction_error, equation_error, or auto: output_error for response.* and "
        "black_box:N, frequency for others.",
    ),
]
Hold: TypeAlias = Annotated[
    str, typer.Option("--hold", help="zero or first order between samples, in time; auto: zero for logged commands.")
]
Starts: TypeAlias = Annotated[
    str, typer.Option("--starts", help="Where searches in time begin: default, central, sobol:N or random:N.")
]
Search: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--search",
        metavar="NAME[:OPTIONS]",
        help="A global search before the fit: evolution[:POPULATION] (when in doubt), cma[:POPULATION], "
        "genetic[:POPULATIONxGENERATIONS], kmeans[:CANDIDATES], sobol[:STARTS], random[:STARTS] or central. "
        "[default: none, the starts of the model]",
    ),
]
Evaluations: TypeAlias = Annotated[
    int | None, typer.Option("--evaluations", help="Costs that --search may compute. [default: 2000]")
]
Bootstrap: TypeAlias = Annotated[
    int | None,
    typer.Option("--bootstrap", help="Refits to noise drawn anew, for spreads and intervals: 200 and more."),
]
Pieces: TypeAlias = Annotated[
    float | None,
    typer.Option("--pieces", help="Seconds after which a fit in time begins anew. [default: as growing modes need]"),
]
Decoupled: TypeAlias = Annotated[
    bool, typer.Option("--decoupled", help="A black box for each input and its output, side by side.")
]
CrossValidate: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--cross-validate",
        help="each: identify on each log alone, score on all others. leave_one_out: on all but one, score on that one.",
    ),
]


def channel_names(text: str | None) -> tuple[str, ...]:
    """``CHANNEL,...`` as names."""
    return tuple(name.strip() for name in text.split(",")) if text else ()


def measure_choices(
    *,
    band: str | None,
    windows: str | None,
    coherence: float | None,
    estimate: str,
    instrument: str | None,
    segment: Sequence[str] | None,
    shift: Sequence[str] | None,
    seed: int = 0,
) -> dict[str, Any]:
    """Fields of :class:`rotorid.pipeline.settings.MeasureSettings` from the texts of the command line.

    Raises
    ------
    UsageError
        A text cannot be read.
    """
    from rotorid.pipeline.settings import parse_band, parse_numbers, parse_segment, parse_shifts

    return {
        "band_rad_s": parse_band(band) if band else None,
        "windows_s": parse_numbers(windows) if windows else (),
        "coherence": coherence,
        "estimate": estimate,
        "instruments": channel_names(instrument),
        "segments": tuple(parse_segment(text) for text in segment or ()),
        "shifts": parse_shifts(tuple(shift or ())),
        "seed": seed,
    }


MODEL = "physical.motors"

Layout: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--layout", help="Of physical.motors: quad.x, hexa.plus, ... or FILE.toml of rotors. [default: as the log says]"
    ),
]
Arm: TypeAlias = Annotated[
    float | None,
    typer.Option("--arm", help="Of physical.motors: meters from the center of gravity to the farthest rotor."),
]
Curve: TypeAlias = Annotated[
    str, typer.Option("--curve", help="Of physical.motors, thrust by output: linear, quadratic, affine or polynomial.")
]

RotorDiameter: TypeAlias = Annotated[
    float | None,
    typer.Option("--rotor-diameter", help="Of physical.motors, meters: judges rotors whose speed was measured."),
]

_USED = ("fix", "segments", "seed", "method")


def motor_choices(
    model: str,
    settings: IdentifySettings,
    *,
    layout: str | None,
    arm: float | None,
    curve: str,
    rotor_diameter: float | None,
    also: Mapping[str, str | None],
) -> MotorChoices | None:
    """What was chosen for ``physical.motors``; ``None`` for another model.

    ``also`` are options beside the settings that it does not have either.

    Raises
    ------
    UsageError
        An option was given that the model does not have.
    """
    from rotorid.errors import UsageError

    if model != MODEL:
        if layout is not None or arm is not None or rotor_diameter is not None or curve != "auto":
            raise UsageError(f"--layout, --arm or --curve came with {model}", needed=f"them with {MODEL} alone")
        return None
    from rotorid.pipeline.settings import MotorChoices

    usual = type(settings)()
    given = [
        one.name
        for one in fields(settings)
        if one.name not in _USED and getattr(settings, one.name) != getattr(usual, one.name)
    ]
    if settings.method not in ("auto", "prediction_error"):
        given.append("method")
    given += [name for name, value in also.items() if value]
    if given:
        raise UsageError(
            f"{', '.join(name.replace('_', ' ') for name in given)} came with {MODEL}, which has no such choice",
            needed="--fix, --layout, --arm, --curve, --segment, --verify",
            remedy="leave it out, or choose another model",
        )
    return MotorChoices(
        known=settings.fix,
        layout=layout,
        arm_m=arm,
        curve=curve,  # type: ignore[arg-type]
        rotor_diameter_m=rotor_diameter,
        segments=settings.segments,
        seed=settings.seed,
    )


WindOption: TypeAlias = Annotated[
    str | None, typer.Option("--wind", help="NORTH,EAST in m/s, where the air moves; one number blows north.")
]
Turbulence: TypeAlias = Annotated[
    float, typer.Option("--turbulence", help="Standard deviation of horizontal gusts in m/s.")
]
Height: TypeAlias = Annotated[float, typer.Option("--height", help="Meters above ground, for the size of the gusts.")]
Changes: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="A number of the vehicle: m, I_xx, I_yy, I_zz, T_motor, T_motor_up, T_motor_down, kappa, tau in SI units; "
        "thrust and drag as factors. Repeatable.",
    ),
]
LimitOptions: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--limit",
        metavar="NAME=VALUE",
        help="What a flight may reach: tilt (deg), rate (deg/s), position (m), height (m), motor_low, motor_high. "
        "[default: tilt=25, rate=180, position=10, height=5, motor_low=0.05, motor_high=0.95] Repeatable.",
    ),
]

_DEGREES = ("tilt", "rate")
_LIMITS = {
    "tilt": "tilt_rad",
    "rate": "rate_rad_s",
    "position": "position_m",
    "height": "height_m",
    "motor_low": "motor_low",
    "motor_high": "motor_high",
}
_SHAPES = {
    "sweep": "pilot_sweep",
    "log_sweep": "logarithmic_sweep",
    "multisine": "multisine",
    "binary": "random_binary",
    "doublet": "doublet",
    "2-1-1": "two_one_one",
    "3-2-1-1": "three_two_one_one",
}


def named_numbers(texts: Sequence[str] | None, option: str) -> dict[str, float]:
    """Pairs ``NAME=VALUE`` of an option that may be repeated.

    Examples
    --------
    >>> named_numbers(["m=1.5", "tau=0.01"], "--set")
    {'m': 1.5, 'tau': 0.01}
    """
    from rotorid.errors import UsageError

    numbers: dict[str, float] = {}
    for text in texts or ():
        name, sign, value = text.partition("=")
        try:
            numbers[name.strip()] = float(value)
        except ValueError:
            sign = ""
        if not sign or not math.isfinite(numbers[name.strip()]):
            raise UsageError(f"{option} {text} came", needed=f"{option} NAME=VALUE with a finite number")
    return numbers


def wind_of(text: str | None, turbulence_m_s: float, height_m: float) -> Wind:
    """The wind that options describe."""
    from rotorid.errors import UsageError
    from rotorid.simulation.wind import Wind

    parts = (text or "0").split(",")
    try:
        north, east = float(parts[0]), float(parts[1]) if len(parts) > 1 else 0.0
    except ValueError:
        parts = []
        north = east = 0.0
    if len(parts) not in (1, 2):
        raise UsageError(f"--wind {text} came", needed="--wind NORTH or --wind NORTH,EAST in m/s")
    return Wind(north_m_s=north, east_m_s=east, turbulence_m_s=turbulence_m_s, height_m=height_m)


def limits_of(texts: Sequence[str] | None) -> Limits:
    """The limits that options describe."""
    from rotorid.models.parameter import no_such
    from rotorid.planning.amplitude import Limits

    given = named_numbers(texts, "--limit")
    if wrong := [name for name in given if name not in _LIMITS]:
        raise no_such("limit", wrong[0], tuple(_LIMITS))
    return Limits(
        **{_LIMITS[name]: math.radians(value) if name in _DEGREES else value for name, value in given.items()}
    )


def shape_of(kind: str) -> Shape:
    """The shape behind the name that a user types.

    Examples
    --------
    >>> shape_of("3-2-1-1")
    'three_two_one_one'
    """
    from rotorid.models.parameter import no_such

    known = {**_SHAPES, **{shape: shape for shape in _SHAPES.values()}}
    if kind not in known:
        raise no_such("kind of test input", kind, tuple(_SHAPES))
    return known[kind]  # type: ignore[return-value]


def axes_of(text: str) -> tuple[Axis, ...]:
    """Axes, separated by commas; ``all`` is all four."""
    from rotorid.data.record import AXES
    from rotorid.models.parameter import no_such

    names = AXES if text == "all" else tuple(part.strip() for part in text.split(","))
    if wrong := [name for name in names if name not in AXES]:
        raise no_such("axis", wrong[0], AXES)
    return names  # type: ignore[return-value]
