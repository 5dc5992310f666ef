"""What a value's ``plot`` is: ``record.plot()``, ``history.plot("p")``, ``response.plot.bode()``.

The values say that they have pictures, and ``rotorid/__init__.py`` that they are these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from rotorid.data.record import FlightRecord, TimeHistory, Track
from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.plot.figure import INPUT, MEASURED, Figure, Panel, quantity, stacked
from rotorid.plot.frequency import bode
from rotorid.plot.loops import s_plane
from rotorid.plot.time import TIME_AXIS, line, verification
from rotorid.typing import BoolArray, ComplexArray, FloatArray
from rotorid.verification.verification import Verification

USUAL = ("command", "p", "q", "r", "ax", "ay", "az")
"""Channels that are drawn unasked, where there are any: commands, rates and specific forces."""

_PANEL_PX = 110.0
_DRIVING = ("_command", "_stick", "_excitation", "_setpoint")


@dataclass(frozen=True)
class RecordPictures:
    """Pictures of a record: called, it draws channels over time."""

    record: FlightRecord

    def __call__(self, *channels: str) -> Figure:
        """Channels over the log's own clock, a panel each, as they were logged; declared maneuvers are shaded.

        Parameters
        ----------
        *channels
            By default commands, rates and specific forces, or everything where none of these is there.

        Raises
        ------
        UsageError
            A channel is not in the record.
        """
        names = _chosen(channels, self.record.channel_names, self.record.source.name)
        shaded = [(maneuver.start_s, maneuver.stop_s) for maneuver in self.record.declared]
        tracks = [self.record[name] for name in names]
        return stacked([_panel(t.time_s, t.values, t.name, shaded) for t in tracks], x_axis=TIME_AXIS)


@dataclass(frozen=True)
class HistoryPictures:
    """Pictures of a time history: called, it draws channels over time."""

    history: TimeHistory

    def __call__(self, *channels: str) -> Figure:
        """Channels over time, a panel each.

        Parameters
        ----------
        *channels
            By default commands, rates and specific forces, or everything where none of these is there.

        Raises
        ------
        UsageError
            A channel is not in the history.
        """
        names = _chosen(channels, self.history.names, "the history")
        time_s = self.history.time_s
        return stacked([_panel(time_s, self.history[name], name, ()) for name in names], x_axis=TIME_AXIS)


@dataclass(frozen=True)
class TrackPictures:
    """The picture of one channel."""

    track: Track

    def __call__(self) -> Figure:
        """Its samples over the log's own clock."""
        return stacked([_panel(self.track.time_s, self.track.values, self.track.name, ())], x_axis=TIME_AXIS)


@dataclass(frozen=True)
class ResponsePictures:
    """Pictures of a frequency response: called, it draws the Bode plot of its first pair."""

    response: FrequencyResponse

    def __call__(self, output: str | None = None, input: str | None = None, **how: Any) -> Figure:
        """The same as :meth:`bode`."""
        return self.bode(output, input, **how)

    def bode(self, output: str | None = None, input: str | None = None, **how: Any) -> Figure:
        """Magnitude, phase and coherence of one pair.

        Parameters
        ----------
        output, input
            Which of its pairs; by default the first.
        **how
            What :func:`rotorid.bode` takes: ``model``, ``fitted``, ``frequency="Hz"``, ``magnitude="linear"``.

        Raises
        ------
        UsageError
            The response does not hold the pair.
        """
        y = _known(output or self.response.outputs[0], self.response.outputs, "output")
        u = _known(input or self.response.inputs[0], self.response.inputs, "input")
        return bode(self.response, output=y, input=u, **how)


class Fitted(Protocol):
    """Data of a model: what was measured, what the model makes of it, what was fitted."""

    @property
    def response(self) -> FrequencyResponse: ...

    @property
    def direct(self) -> FrequencyResponse | None: ...

    @property
    def model_response(self) -> ComplexArray: ...

    @property
    def used(self) -> BoolArray: ...

    @property
    def least_coherence(self) -> float: ...


class Checks(Protocol):
    """Flights that a model had not seen."""

    @property
    def maneuvers(self) -> Sequence[Verification]: ...


class Pole(Protocol):
    """A pole with the covariance of its real and imaginary part."""

    @property
    def value(self) -> complex: ...

    @property
    def covariance(self) -> FloatArray | None: ...


class Model(Protocol):
    """An identified model, of which ``rotorid.identify`` makes one."""

    @property
    def data(self) -> Fitted: ...

    @property
    def verifications(self) -> Checks: ...

    @property
    def poles(self) -> Sequence[Pole]: ...


@dataclass(frozen=True)
class ModelPictures:
    """Pictures of an identified model: called, it draws the Bode plot of the pair with most fitted points."""

    model: Model

    def __call__(self) -> Figure:
        """The same as :meth:`bode` without a pair."""
        return self.bode()

    def bode(self, output: str | None = None, input: str | None = None, **how: Any) -> Figure:
        """Measured response of one pair with its errors, and the model over it.

        Parameters
        ----------
        output, input
            Which of the fitted pairs; by default the one with most fitted points.
        **how
            More arguments of :func:`rotorid.bode`: ``frequency="Hz"``, ``magnitude="linear"``.

        Raises
        ------
        UsageError
            The pair was not measured.
        """
        data = self.model.data
        if not data.response.omega_rad_s.size:
            raise UsageError("this model has no measured response", needed="a model with a fitted or measured response")
        y, u = np.unravel_index(int(data.used.sum(axis=2).argmax()), data.used.shape[:2])
        return bode(
            data.response,
            output=_known(output or data.response.outputs[y], data.response.outputs, "output"),
            input=_known(input or data.response.inputs[u], data.response.inputs, "input"),
            model=data.model_response,
            beside=data.direct,
            fitted=data.used,
            least_coherence=data.least_coherence,
            **how,
        )

    def poles(self) -> Figure:
        """Poles of the model with ellipses of two standard deviations."""
        poles = {complex(value): pole for pole in self.model.poles for value in (pole.value, np.conj(pole.value))}
        return s_plane(np.array(list(poles)), std=np.array([_std(pole.covariance) for pole in poles.values()]))

    def unseen(self, number: int = 0) -> Figure:
        """Measured and predicted outputs of an unseen maneuver.

        Parameters
        ----------
        number
            Which one, from zero.

        Raises
        ------
        UsageError
            There is no such maneuver: none was flown, or the model was loaded from a file, which does not hold signals.
        """
        checks = self.model.verifications.maneuvers
        if not 0 <= number < len(checks):
            raise UsageError(f"there is no unseen maneuver {number}", needed=f"a number below {len(checks)}")
        return verification(checks[number])


def _std(covariance: FloatArray | None) -> complex:
    if covariance is None:
        return complex(np.nan, np.nan)
    real, imag = np.sqrt(np.diag(covariance)).tolist()
    return complex(real, imag)


def _chosen(asked: Sequence[str], there: Sequence[str], where: str) -> list[str]:
    for name in asked:
        if name not in there:
            raise UsageError(f"{where} has no {name}", needed=f"one of {', '.join(there) or 'none'}")
    usual = [name for name in there if name.rpartition("_")[2] in USUAL]
    return list(asked or usual or there)


def _known(name: str, there: Sequence[str], kind: str) -> str:
    if name not in there:
        raise UsageError(f"unknown {kind} {name}", needed=f"one of {', '.join(there)}")
    return name


def _panel(time_s: FloatArray, values: FloatArray, name: str, shaded: Sequence[tuple[float, float]]) -> Panel:
    color = INPUT if name.endswith(_DRIVING) or name.startswith("motor_") else MEASURED
    trace = line(time_s, values, name, words=name, color=color, width=1.0)
    return Panel(label=quantity(name).label, traces=(trace,), height_px=_PANEL_PX, shaded=shaded)
