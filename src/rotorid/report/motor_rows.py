"""Rows of what a fit of ``physical.motors`` found: the vehicle, its excitation, unseen stretches."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from rotorid.pipeline.document import ParameterDocument, ResultDocument
from rotorid.pipeline.motor_document import ExcitationDocument, MotorsDocument
from rotorid.pipeline.score_document import ScoreDocument
from rotorid.plot.quantity import quantity
from rotorid.report.motor_words import AXIS_WORDS, FULL_OUTPUT, no_lag
from rotorid.report.numbers import MISSING, milliseconds, significant, unit, with_error
from rotorid.report.wording import Verdict, fit_verdict, prediction_verdict

_NAMES = {"m": "Mass", "I_xx": "Roll inertia", "I_yy": "Pitch inertia", "I_zz": "Yaw inertia"}
_STATUS = {"fixed": "given", "tied": "follows from the others", "free": ""}
_CHANNELS = {"az": "az", "p": "p_dot", "q": "q_dot", "r": "r_dot"}


@dataclass(frozen=True, kw_only=True, slots=True)
class VehicleRow:
    """A property of the vehicle; quiet where it was not told."""

    words: str
    symbol: str
    value: str
    unit: str
    note: str = ""
    known: bool = True


@dataclass(frozen=True, kw_only=True, slots=True)
class ExcitationRow:
    """A stretch: when, how fast, and each axis as correlation and as share of its motion that is explained."""

    record: str
    interval: str
    rate: str
    axes: tuple[tuple[str, Verdict | None], ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class UnseenRow:
    """A channel of an unseen stretch."""

    where: str
    channel: str
    verdict: Verdict
    tic: str
    fit: str
    rms: str


def vehicle_rows(document: ResultDocument, motors: MotorsDocument) -> tuple[VehicleRow, ...]:
    """Mass, inertia, thrust, lag and torque, with deviations and units, and whether each was given or found."""
    return (
        *_body(document, motors),
        *_thrust(motors),
        *_lag(document, motors),
        *_torque(document),
    )


def _body(document: ResultDocument, motors: MotorsDocument) -> Iterator[VehicleRow]:
    axes = {"I_xx": "p", "I_yy": "q", "I_zz": "r"}
    for name, words in _NAMES.items():
        found = document.parameters.get(name)
        if found is None:
            yield VehicleRow(
                words=words, symbol=name, value=MISSING, unit="", note=_missing(motors, axes[name]), known=False
            )
        elif name == "m" and motors.scale is None:
            yield VehicleRow(
                words=words, symbol=name, value="1", unit="kg", note="assumed: multiply thrust and inertia"
            )
        else:
            note = _STATUS.get(found.status, found.status)
            per = name in ("I_xx", "I_yy") and motors.arm_m is None
            yield _row(words, name, found, note=note or ("for an arm of 1 m" if per else ""))


def _missing(motors: MotorsDocument, axis: str) -> str:
    if any(axis in one.counted for one in motors.excitation):
        return "kappa over I_zz alone is told"
    return f"{AXIS_WORDS[axis]} was not excited"


def _row(words: str, symbol: str, found: ParameterDocument, *, note: str = "") -> VehicleRow:
    return VehicleRow(
        words=words, symbol=symbol, value=with_error(found.value, found.std), unit=unit(found.unit), note=note
    )


def _thrust(motors: MotorsDocument) -> Iterator[VehicleRow]:
    speed = motors.outputs == "speed"
    hover = f"{significant(motors.hover_output)}{' rad/s' if speed else ''}"
    highest = motors.flown_outputs[1]
    beyond = f"extrapolated, flown up to {significant(highest, digits=2)}" if highest < FULL_OUTPUT else ""
    told = {
        "thrust_hover": ("Thrust of a rotor near hover", f"at the mean output, {hover}"),
        "thrust_slope": ("Its slope there", "by the speed" if speed else "by the output from 0 to 1"),
        "thrust_full": ("Thrust of a rotor at full output", beyond),
        "thrust_to_weight": ("Thrust to weight", beyond),
    }
    for name, (words, note) in told.items():
        if (found := motors.derived.get(name)) is not None:
            value = with_error(found.value, found.std)
            yield VehicleRow(words=words, symbol="", value=value, unit=unit(found.unit), note=note)


def _lag(document: ResultDocument, motors: MotorsDocument) -> Iterator[VehicleRow]:
    lag = document.parameters.get("T_motor")
    if lag is not None:
        value = milliseconds(lag.value, lag.std)
        note = _STATUS.get(lag.status, lag.status)
        yield VehicleRow(words="Motor lag", symbol="T_motor", value=value, unit="ms", note=note)
    elif motors.outputs != "speed":
        yield VehicleRow(
            words="Motor lag", symbol="T_motor", value=MISSING, unit="", note=no_lag(document), known=False
        )


def _torque(document: ResultDocument) -> Iterator[VehicleRow]:
    found = document.parameters
    if "kappa" in found:
        note = _STATUS.get(found["kappa"].status, found["kappa"].status)
        yield _row("Torque of a rotor by its thrust", "kappa", found["kappa"], note=note)
    elif "kappa_per_I_zz" in found:
        yield _row("Torque by thrust, over yaw inertia", "kappa_per_I_zz", found["kappa_per_I_zz"])


def excitation_rows(document: ResultDocument, motors: MotorsDocument) -> tuple[ExcitationRow, ...]:
    """Every stretch; an axis that counts has a verdict with the share of its slow motion that the motors explain."""
    records = document.records
    return tuple(
        ExcitationRow(
            record=one.record,
            interval=f"{one.start_s:.1f} to {one.stop_s:.1f} s",
            rate=f"{significant(one.sample_rate_hz, digits=4)} Hz",
            axes=tuple(_axis(one, axis, records[row].fit_percent) for axis in AXIS_WORDS),
        )
        for row, one in enumerate(motors.excitation)
    )


def _axis(one: ExcitationDocument, axis: str, percents: Mapping[str, float]) -> tuple[str, Verdict | None]:
    percent = percents.get(_CHANNELS[axis])
    counted = axis in one.counted and percent is not None
    correlation = f"{one.correlation[axis]:.2f}" if axis in one.correlation else MISSING
    return correlation, fit_verdict(percent) if counted and percent is not None else None


def unseen_rows(records: Mapping[str, Mapping[str, ScoreDocument]]) -> tuple[UnseenRow, ...]:
    """Every channel of every unseen stretch, in the units of paper."""
    return tuple(
        UnseenRow(
            where=where,
            channel=quantity(name).words,
            verdict=prediction_verdict(one.tic, one.nrmse_fit_percent),
            tic=significant(one.tic, digits=2),
            fit=significant(one.nrmse_fit_percent),
            rms=f"{significant(quantity(name).factor * one.rms)} {quantity(name).unit}",
        )
        for where, record in records.items()
        for name, one in record.items()
    )
