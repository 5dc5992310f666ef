r"""Whether the gains of a log made its commands: one answer for all that read a controller.

What each path of the controller makes of set-point :math:`r` and rate :math:`y`, proportional, integral and derivative,
is fitted to the logged command,

.. math:: u = k_P u_P(r, y) + k_I u_I(r, y) + k_D u_D(r, y) + u_F(r)

over windows of 4 s, at the frequencies where some linear relation of set-point and rate explains the command. Of gains
that flew each :math:`k` is one. A path counts where it makes a third of the command and more: on the logs of PX4,
ArduPilot and Betaflight at hand, logged at 24 to 1000 Hz, gains that flew lie within 9 % of one there (11 % in a limit
cycle), and gains that are wrong by 20 % beyond 13 %. A wrong filter shows in what stays unexplained. Three things are
no other gains: an integral below its own, which limits take back, a rate that is taken up to a sample later than it is
logged, as behind a filter that the log does not know, and a set-point that is taken a step earlier.

Betaflight's integral, derivative and feed-forward move with the sticks. There the logged terms are compared, each with
its own path, and the derivative may lie between its two ends.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from rotorid.autopilots.advice import loop_advice
from rotorid.autopilots.registry import named
from rotorid.data.axes import ANGLE_OF, RATE_OF
from rotorid.data.base import Immutable, cached_by_value
from rotorid.data.display import capital
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.quantity import with_error
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.flights.command_relation import CommandRelation, command_relation
from rotorid.flights.controllers import (
    EXPLAINED,
    controllers_of,
    flown_firmware,
    made_by_paths,
)
from rotorid.models.autopilots.betaflight import TOP
from rotorid.models.controller import Driven, RateController
from rotorid.typing import Axis, BoolArray, ComplexArray, FloatArray

ControllerVerdict: TypeAlias = Literal["made", "not made", "not checked"]

SAME_GAIN = 0.12
"""How far from one a path may lie for gains that flew."""

_LEAST_SHARE = 1.0 / 3.0
"""Paths that make less of the command are not judged."""

_SURE = 2.0
"""Standard deviations beyond that limit at which gains count as not flown."""

_LEAST_STD = 0.005
"""Least relative error of a gain from a flight."""

_HIGHEST_RAD_S = 200.0
"""Faster motion shows by how much of a step a set-point is late, more than which gains flew."""

_TRIED = 9
"""Times by which the rate may be late."""

_BEST_FIRST: tuple[ControllerVerdict, ...] = ("made", "not checked", "not made")

_GROUPS = 12
"""Number of groups of windows, each left out once."""

_REMEDY = "give the log in which these gains were flown; a controller with parts that are not modeled cannot be checked"


class PathGain(NamedTuple):
    """How many times its logged gain a path of the controller has in flight, and its share of the command."""

    slope: float
    std: float
    share: float


@dataclass(frozen=True, kw_only=True)
class ControllerCheck(Immutable):
    """Whether the gains of an axis made its commands.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    verdict
        ``made``, ``not made``, or ``not checked`` where the log does not show it.
    why
        The reason of another verdict than ``made``, as a sentence without its full stop.
    remedy
        What would help.
    setpoint
        Channel that drove the controller.
    unexplained
        Share of the command that the gains leave unexplained, as root mean square, beyond what any linear relation to
        set-point and rate leaves; ``None`` where nothing was compared.
    correlation
        Of the command with what the gains make of set-point and rate.
    paths
        ``p``, ``i``, ``d`` to what the command shows of them.
    terms
        The same letters to what each logged term shows; empty where none was compared.
    """

    axis: Axis
    verdict: ControllerVerdict
    why: str = ""
    remedy: str = ""
    setpoint: str = ""
    unexplained: float | None = None
    correlation: float | None = None
    paths: Mapping[str, PathGain] = field(default_factory=dict)
    terms: Mapping[str, PathGain] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(paths=self.paths, terms=self.terms)

    @property
    def numbers(self) -> dict[str, float]:
        """Numbers for findings: the unexplained share, and each gain over the logged one."""
        slopes = {f"{letter}_over_logged": path.slope for letter, path in (self.terms or self.paths).items()}
        return slopes if self.unexplained is None else {"unexplained": self.unexplained, **slopes}

    @property
    def findings(self) -> tuple[Finding, ...]:
        """``other_controller`` or ``controller_unchecked``, or nothing if the gains flew."""
        if self.verdict == "not made":
            return (remark("other_controller", self.axis, f"{self.why}.", **self.numbers),)
        if self.verdict == "not checked":
            message = f"{self.why}, so the logged gains could not be checked against the flight."
            return (remark("controller_unchecked", self.axis, message),)
        return ()


@cached_by_value
def check_controller(record: FlightRecord, axis: Axis) -> ControllerCheck:
    """Whether the gains in a log made the commands of an axis.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    """
    flown = controllers_of(record)
    found = flown.axis(axis)
    if found is None:
        return _unchecked(axis, *flown.unknown_gains(axis))
    moving = named(found.autopilot).gains_by_throttle

    def controller(throttle: float) -> RateController:
        there = flown.axis(axis, throttle=throttle)
        assert there is not None  # of these parameters another throttle made one
        return there.ends.get(TOP, there.controller) if moving else there.controller

    if moving:
        least = found.controller.derivative_s2 / max(controller(flown.throttle).derivative_s2, 1e-300)
        checked = _by_terms(record, axis, controller, least_derivative=min(least, 1.0))
    else:
        driver = _driver(record, axis, found.controller)
        checked = _by_command(record, axis, controller, *driver)
        if checked.verdict == "not made":
            # A soft yaw swings a hundred times as far below the lowest frequency: in windows that leaks to it and bends
            # what it shows of the integral. Gains are others only if they are with two differences too.
            again = _by_command(record, axis, controller, *driver, differences=2)
            checked = min(checked, again, key=lambda check: _BEST_FIRST.index(check.verdict))
    return checked


def _driver(record: FlightRecord, axis: Axis, controller: RateController) -> tuple[str, Driven]:
    """Channel that drove a controller: the rate set-point, or the angle set-point if only that is logged."""
    rate, angle = f"{RATE_OF[axis]}_setpoint", f"{ANGLE_OF[axis]}_setpoint"
    by_angle = controller.angle_1_s > 0.0 and rate not in record.channel_names and angle in record.channel_names
    return (angle, "angle") if by_angle else (rate, "rate")


def check_given(
    record: FlightRecord, axis: Axis, controller: RateController, *, setpoint: str, driven: Driven
) -> ControllerCheck:
    """Whether a controller that a person gave made the commands of an axis.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    setpoint, driven
        Channel that drives it, and what that is.
    """
    return _by_command(record, axis, lambda _: controller, setpoint, driven)


def controller_findings(record: FlightRecord) -> tuple[Finding, ...]:
    """Findings on the controllers of a log: its firmware, and gains that did not make the commands."""
    wrong = [check for axis in RATE_OF if (check := check_controller(record, axis)).verdict == "not made"]
    return (
        *flown_firmware(record).findings,
        *(
            warn("controller_unexplained", check.axis, f"{check.why}. {capital(check.remedy)}.", **check.numbers)
            for check in wrong
        ),
    )


def _unchecked(axis: Axis, why: str, remedy: str, setpoint: str = "") -> ControllerCheck:
    return ControllerCheck(axis=axis, verdict="not checked", why=why.rstrip("."), remedy=remedy, setpoint=setpoint)


def _by_command(
    record: FlightRecord,
    axis: Axis,
    controller: Callable[[float], RateController],
    setpoint: str,
    driven: Driven,
    *,
    least_derivative: float = 1.0,
    differences: int = 1,
) -> ControllerCheck:
    """By the logged command."""
    command = f"{axis}_command"
    try:
        relation = command_relation(record, axis, (command,), setpoint=setpoint, differences=differences)
    except InsufficientDataError as error:
        return _unchecked(axis, error.came, error.remedy or "", setpoint if setpoint in record.channel_names else "")
    measured, related = relation.signals[command], relation.related(command, _HIGHEST_RAD_S)
    if not related.any():
        why = f"Set-point and rate of {axis} explain too little of its command, whatever the gains"
        return _unchecked(axis, why, loop_advice(record, axis, relation.sample_rate_hz), setpoint)
    made = made_by_paths(record, relation, controller, driven=driven)
    of_rate = made_by_paths(record, replace(relation, setpoint=None), controller, driven=driven)
    noise = _noise(relation, command, related)
    checks = []
    step_s = controller(0.0).step_s if controller(0.0).late_angle else 0.0
    ways = [made] if step_s == 0.0 else [made, _earlier(relation, made, of_rate, step_s)]
    timings = [(way, late_s) for way in ways for late_s in (0.0, _late_s(relation, measured, way, of_rate, related))]
    for way, late_s in timings:
        paths = _later(relation, way, of_rate, late_s)
        ahead = paths.pop("f", np.zeros_like(measured))
        gains = path_gains(measured - ahead, paths, related)
        # What limits take back of the integral is no other gain.
        shares = {letter: min(max(gains[letter].slope, 0.0), 1.0) if letter == "i" else 1.0 for letter in paths}
        whole = sum((shares[letter] * path for letter, path in paths.items()), start=ahead)
        found = ControllerCheck(
            axis=axis,
            verdict="made",
            setpoint=setpoint,
            unexplained=float(np.sqrt(max(_left(measured, whole, related) ** 2 - noise**2, 0.0))),
            correlation=_correlation(measured, whole, related),
            paths=gains,
        )
        checks.append(_with_verdict(record, found, {"p": (1.0, 1.0), "i": (0.0, 1.0), "d": (least_derivative, 1.0)}))
    # A filter of the rate that the log does not have, stamps, or the step in which a firmware takes its set-point may
    # be off: gains are others only if they are at all of them.
    return min(checks, key=lambda check: _BEST_FIRST.index(check.verdict))


def _by_terms(
    record: FlightRecord, axis: Axis, controller: Callable[[float], RateController], *, least_derivative: float
) -> ControllerCheck:
    """Check by the logged terms of a blackbox: its command is limited by the motors."""
    setpoint = f"{RATE_OF[axis]}_setpoint"
    named = {letter: f"{axis}_{letter}_term" for letter in "pidf"}
    terms = {letter: name for letter, name in named.items() if name in record.channel_names}
    if "p" not in terms:
        found = _by_command(record, axis, controller, setpoint, "rate", least_derivative=least_derivative)
        if found.verdict != "not made":
            return found
        why = f"The terms of the {axis} controller, which move in flight, are not logged"
        return replace(found, verdict="not checked", why=why, remedy="log all fields of the PID controller")
    try:
        relation = command_relation(record, axis, (f"{axis}_command", *terms.values()), setpoint=setpoint)
    except InsufficientDataError as error:
        return _unchecked(axis, error.came, error.remedy or "", setpoint if setpoint in record.channel_names else "")
    made = made_by_paths(record, relation, controller)
    related = relation.related(terms["p"], _HIGHEST_RAD_S)
    if not related.any():
        why = f"Set-point and rate of {axis} explain too little of its P term, whatever the gains"
        return _unchecked(axis, why, loop_advice(record, axis, relation.sample_rate_hz), setpoint)
    paths = {
        letter: path_gains(relation.signals[terms[letter]], {letter: made[letter]}, related)[letter]
        for letter in made
        if letter in terms
    }
    measured = relation.signals[terms["p"]]
    whole = sum((relation.signals[name] for name in terms.values()), start=np.zeros_like(measured))
    found = ControllerCheck(
        axis=axis,
        verdict="made",
        setpoint=setpoint,
        unexplained=_left(measured, made["p"], related) if "p" in made else None,
        correlation=_correlation(relation.signals[f"{axis}_command"], whole, related),
        terms=paths,
    )
    if (found.correlation or 0.0) <= 0.0:
        why = f"The {axis} command computed from the motors does not follow the sum of the controller's terms"
        return replace(
            found, verdict="not made", why=why, remedy="check that this is a quadrotor with the usual motor order"
        )
    return _with_verdict(record, found, {"p": (1.0, 1.0), "d": (least_derivative, 1.0)})


def _with_verdict(
    record: FlightRecord, found: ControllerCheck, expected: Mapping[str, tuple[float, float]]
) -> ControllerCheck:
    """The check with a verdict from its paths, each of which may lie between two shares of its logged gain."""
    doubts = []
    for letter, (low, high) in expected.items():
        path = (found.terms or found.paths).get(letter)
        if path is None or max(path.slope, 1.0) * path.share < _LEAST_SHARE:
            continue
        beyond = max(low * (1.0 - SAME_GAIN) - path.slope, path.slope - high * (1.0 + SAME_GAIN))
        if beyond > 0.0:
            words = f"{with_error(path.slope, max(path.std, _LEAST_STD))} times their {letter.upper()}"
            doubts.append((beyond > _SURE * path.std, words))
    shown = " and ".join(words for _, words in doubts)
    unlike = f"The logged {found.axis} gains do not reproduce the logged {found.axis} command"
    if any(sure for sure, _ in doubts):
        why = f"{unlike}: the flight shows {shown}{_changed(record)}"
        return replace(found, verdict="not made", why=why, remedy=_REMEDY)
    if found.unexplained is not None and found.unexplained > EXPLAINED:
        share = f"{100.0 * found.unexplained:.0f} % of the command is unexplained, more than the"
        why = f"{unlike}: {share} {100.0 * EXPLAINED:.0f} %{_changed(record)}"
        return replace(found, verdict="not made", why=why, remedy=_REMEDY)
    if doubts:
        why = f"The flight shows the {found.axis} gains only roughly, {shown}"
        return replace(found, verdict="not checked", why=why, remedy="fly longer, or log faster")
    return found


def _later(
    relation: CommandRelation, made: Mapping[str, ComplexArray], of_rate: Mapping[str, ComplexArray], late_s: float
) -> dict[str, ComplexArray]:
    """Paths of a controller that takes the rate later than the log shows."""
    late = np.exp(-1j * relation.omega_rad_s * late_s) - 1.0
    return {letter: path + of_rate[letter] * late for letter, path in made.items()}


def _earlier(
    relation: CommandRelation, made: Mapping[str, ComplexArray], of_rate: Mapping[str, ComplexArray], step_s: float
) -> dict[str, ComplexArray]:
    """Paths of a controller that takes the set-point of this step instead of the step before."""
    earlier = np.exp(1j * relation.omega_rad_s * step_s) - 1.0
    return {letter: path + (path - of_rate.get(letter, 0.0 * path)) * earlier for letter, path in made.items()}


def _late_s(
    relation: CommandRelation,
    measured: ComplexArray,
    made: Mapping[str, ComplexArray],
    of_rate: Mapping[str, ComplexArray],
    related: BoolArray,
) -> float:
    """By how much later the controller takes the rate, within a sample of the log, as its paths fit best."""
    target = _stacked(measured[:, related]).ravel()

    def explained(late_s: float) -> float:
        paths = _later(relation, made, of_rate, late_s)
        columns = np.stack([_stacked(path[:, related]).ravel() for path in paths.values()], axis=-1)
        products = columns.T @ target
        return float(products @ _solved(columns.T @ columns, products))

    tried = [float(share) / relation.sample_rate_hz for share in np.linspace(-1.0, 1.0, _TRIED)]
    return max(tried, key=explained)


def _changed(record: FlightRecord) -> str:
    """End of a sentence if parameters changed during the log."""
    changed = any(finding.kind == "parameters_changed" for finding in record.findings)
    return "; parameters changed during the log" if changed else ""


def _stacked(values: ComplexArray) -> FloatArray:
    """Real and imaginary parts, shape ``(windows, 2 f)``."""
    return np.concatenate([values.real, values.imag], axis=1)


def path_gains(measured: ComplexArray, made: Mapping[str, ComplexArray], related: BoolArray) -> dict[str, PathGain]:
    r"""Real gains by least squares, with the standard deviation that leaving out groups of windows shows.

    .. math:: \sigma^2 = \frac{G - 1}{G} \sum_g (k_g - \bar k)^2
    """
    target = _stacked(measured[:, related])
    columns = np.stack([_stacked(path[:, related]) for path in made.values()], axis=-1)
    squares = np.einsum("wfi,wfj->wij", columns, columns)
    products = np.einsum("wfi,wf->wi", columns, target)
    whole = (squares.sum(axis=0), products.sum(axis=0))
    slopes = _solved(*whole)
    groups = np.array_split(np.arange(len(target)), min(_GROUPS, len(target)))
    parts = [(whole[0] - squares[group].sum(axis=0), whole[1] - products[group].sum(axis=0)) for group in groups]
    without = np.array([_solved(*part) for part in parts])
    count = len(groups)
    stds = np.sqrt((count - 1.0) / count * np.sum((without - without.mean(axis=0)) ** 2, axis=0))
    shares = np.sqrt(np.einsum("wfi,wfi->i", columns, columns) / np.sum(target**2))
    return {
        letter: PathGain(float(slope), float(std), float(share))
        for letter, slope, std, share in zip(made, slopes, stds, shares, strict=True)
    }


def _solved(squares: FloatArray, products: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.lstsq(squares, products, rcond=None)[0])


def _left(measured: ComplexArray, made: ComplexArray, related: BoolArray) -> float:
    """Part of a signal that a model does not explain, as rms over that of the signal."""
    return float(np.linalg.norm((measured - made)[:, related]) / np.linalg.norm(measured[:, related]))


def _noise(relation: CommandRelation, name: str, related: BoolArray) -> float:
    """Part that the best linear relation does not explain, corrected for two complex numbers at each frequency."""
    power = np.sum(np.abs(relation.signals[name]) ** 2, axis=0)[related]
    windows = len(relation.rate)
    share = float(np.sum(power * relation.unrelated(name)[related]) / power.sum())
    return float(np.sqrt(share * windows / max(windows - 2.0, 1.0)))


def _correlation(measured: ComplexArray, made: ComplexArray, related: BoolArray) -> float:
    x, y = measured[:, related], made[:, related]
    both = float(np.linalg.norm(x) * np.linalg.norm(y))
    return float(np.sum((y.conj() * x).real)) / both if both > 0.0 else 0.0
