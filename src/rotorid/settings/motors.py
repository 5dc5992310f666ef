"""Choices of ``physical.motors`` and ``physical.flight``."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias, Union, get_args

from rotorid.errors import UsageError, unknown_name
from rotorid.io.documents import read_text
from rotorid.settings.identifying import IdentifySettings, require_search
from rotorid.settings.option import Settings, Written

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rotorid.data.record import Maneuver
    from rotorid.models.motors import Curve
    from rotorid.models.rotors import RotorLayout

MotorMethod: TypeAlias = Literal["prediction_error", "accelerations"]

FROM_ANGLES = ("phi", "theta", "psi", "north", "east", "down")
"""Channels that are differentiated where gyros, accelerometer or velocity are missing, or where they are asked for."""

ChosenCurve: TypeAlias = Union[Literal["auto"], "Curve"]
"""``auto``: linear for demanded thrust, quadratic for speeds, and for outputs as many terms as the flight supports."""


def _rounded(known: Mapping[str, float]) -> list[str]:
    return [f"{name}={value:g}" for name, value in known.items()]


def _rounded_segments(segments: "Iterable[Maneuver]") -> list[str]:
    return [f"{segment.axis}:{segment.start_s:g}:{segment.stop_s:g}" for segment in segments]


def _file_name(layout: str | None) -> str | None:
    return Path(layout).name if layout else None


@dataclass(frozen=True, kw_only=True)
class MotorSettings(Settings):
    """Choices of one run.

    Parameters
    ----------
    known
        Values that were measured otherwise, by parameter.
    layout
        Name of a layout or a TOML file of rotors; what the log says by default.
    arm_m
        Horizontal distance of the farthest rotor from the center of gravity.
    curve
        Thrust of a rotor by its output.
    rotor_diameter_m
        Of each rotor, to judge its figure of merit where speeds were measured.
    segments
        Stretches to use instead of the excitations that are found.
    voltage
        Whether thrust follows the voltage of the battery, where outputs of motors were logged.
    bootstrap
        Number of refits with new noise, for standard deviations next to the stated ones.
    search
        A global search for a start, with its options, as ``genetic:15x50``.
    evaluations
        Its budget.
    runs
        How often it is repeated from other seeds.
    workers
        Processes that share out runs and bootstraps; ``None`` for none.
    method
        ``prediction_error``, or ``accelerations``: the sum of absolute errors of accelerations.
    outputs
        Angles, height and positions in place of gyros, accelerometer and velocity, for ``accelerations`` alone.
    predictor
        Whether ``physical.flight`` also fits numbers that predict its closed loop best.
    seed
        Of what a bootstrap or a search draws.

    Raises
    ------
    UsageError
        A length is not positive, or there is no such curve or search.
    """

    known: Annotated[Mapping[str, float], Written(write=_rounded)] = field(default_factory=dict)
    layout: Annotated[str | None, Written(write=_file_name)] = None
    arm_m: Annotated[float | None, Written()] = None
    curve: Annotated[ChosenCurve, Written()] = "auto"
    rotor_diameter_m: Annotated[float | None, Written()] = None
    segments: Annotated["tuple[Maneuver, ...]", Written(write=_rounded_segments)] = ()
    voltage: Annotated[bool, Written()] = True
    # Held only where there is one, as the values do not depend on it.
    bootstrap: Annotated[int | None, Written("given")] = None
    search: Annotated[str | None, Written("given")] = None
    evaluations: Annotated[int | None, Written("given")] = None
    runs: Annotated[int | None, Written("given")] = None
    workers: Annotated[int | None, Written("never")] = None
    method: Annotated[MotorMethod, Written("given")] = "prediction_error"
    outputs: Annotated[tuple[str, ...], Written("given")] = ()
    predictor: Annotated[bool, Written("given")] = False
    seed: int = 0

    def __post_init__(self) -> None:
        require_search(self.search, self.evaluations, "default", self.runs)
        if self.method not in get_args(MotorMethod):
            raise UsageError(
                f"physical.motors has no method {self.method!r}", needed=" or ".join(get_args(MotorMethod))
            )
        if self.method == "accelerations" and self.bootstrap is not None:
            raise UsageError(
                "--method accelerations has no bootstrap",
                remedy="use --search NAME --runs N, or --method prediction_error",
            )
        if self.outputs and (self.method != "accelerations" or not set(self.outputs) <= set(FROM_ANGLES)):
            raise UsageError(
                f"physical.motors cannot fit --outputs {','.join(self.outputs)}",
                needed=f"{', '.join(FROM_ANGLES[:-1])} or {FROM_ANGLES[-1]} with --method accelerations",
                remedy="leave out --outputs to fit gyros and accelerometer",
            )
        for name, length_m in (("--arm", self.arm_m), ("--rotor-diameter", self.rotor_diameter_m)):
            if length_m is not None and not length_m > 0.0:
                raise UsageError(f"{name} {length_m:g} m is not positive")
        from rotorid.models.motors import TERMS_OF_CURVE

        if self.curve not in ("auto", *TERMS_OF_CURVE):
            raise unknown_name("curve", self.curve, ("auto", *TERMS_OF_CURVE))


def motor_settings(settings: IdentifySettings) -> MotorSettings:
    """What of the choices of a run is about ``physical.motors``.

    Raises
    ------
    UsageError
        A choice is impossible.
    """
    return MotorSettings(
        known=settings.fix,
        layout=settings.layout,
        arm_m=settings.arm_m,
        curve=settings.curve,
        rotor_diameter_m=settings.rotor_diameter_m,
        segments=settings.segments,
        seed=settings.seed,
        bootstrap=settings.bootstrap,
        search=settings.search,
        evaluations=settings.evaluations,
        # Runs with noise repeat the whole identification, not its search.
        runs=None if settings.add_noise_percent is not None else settings.runs,
        workers=settings.workers,
        method="accelerations" if settings.method == "accelerations" else "prediction_error",
        outputs=settings.outputs,
        predictor=settings.predictor,
    )


def chosen_layout(text: str) -> "RotorLayout":
    """A layout of the library by its name, or that of a TOML file.

    Raises
    ------
    UsageError
        There is neither; the error suggests the nearest name.
    ModelError
        The file does not describe rotors.
    """
    from rotorid.models.rotors import layout_from_toml, layout_names, library_layout

    if text in layout_names():
        return library_layout(text)
    path = Path(text)
    if path.suffix != ".toml":
        raise unknown_name("layout", text, layout_names())
    return layout_from_toml(read_text(path, needed="a TOML file of [[rotor]] tables"), where=path.name)
