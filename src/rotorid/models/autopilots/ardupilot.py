r"""ArduPilot's rate and attitude controller of a multicopter.

.. math:: u = D_{mod} (P e_f + D F_D \dot e_f) + \int I e_f \, dt + FF \, t + D_{FF} \, \dot t, \qquad
    t = F_T r, \quad e_f = F_E (t - \omega)

with first-order filters ``FLTT``, ``FLTE`` and ``FLTD`` and notches on target and error. Before version 4 ``FILT`` was
the only filter, :math:`F_D` of roll and pitch and :math:`F_E` of yaw. The integral is used at once;
the rate loop runs before the attitude loop, so that its target is one step old. :math:`D_{mod}` is one as long as the
slew limiter (``SMAX``) rests, and ``PDMX`` limits the sum of both terms: where they act, the linear loop is not the
flown one.

References
----------
ArduPilot Copter parameter reference, ``ATC_`` and ``FILT``; ``libraries/AC_PID``, ``libraries/AC_AttitudeControl`` of
ArduPilot/ardupilot.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from rotorid.autopilots.ardupilot.autopilot import ARDUPILOT
from rotorid.models.autopilots.settings import AxisController, present
from rotorid.models.controller import RateController
from rotorid.models.loop_filter import LoopFilter
from rotorid.typing import Axis

NAME = ARDUPILOT.name

_AXES: Mapping[Axis, str] = MappingProxyType({"roll": "RLL", "pitch": "PIT", "yaw": "YAW"})
_GAINS = ("P", "I", "D", "FF", "D_FF", "IMAX", "SMAX", "PDMX")
_FILTERS = ("FLTT", "FLTE", "FILT", "FLTD", "NTF", "NEF")
_NOTCH, _DEEPEST_NOTCH_DB, _SLOWEST_HZ = 1, 120.0, 0.1


def read(
    parameters: Mapping[str, float], axis: Axis, *, firmware: str = "", loop_rate_hz: float | None = None
) -> AxisController | None:
    """The controller of an axis, or ``None`` where the parameters are not ArduPilot's, or none to fly with.

    Parameters
    ----------
    parameters, axis, firmware, loop_rate_hz
        As for :func:`rotorid.models.autopilots.reading.axis_controller`.
    """
    if axis not in _AXES:
        return None
    prefix, angle = f"ATC_RAT_{_AXES[axis]}_", f"ATC_ANG_{_AXES[axis]}_P"

    def value(name: str) -> float:
        return float(parameters.get(prefix + name, 0.0))

    # Before version 4 there was one filter: on the error of yaw, and on the derivative alone of roll and pitch.
    of_error, of_derivative = "FLTE", "FLTD"
    if f"{prefix}FILT" in parameters and f"{prefix}FLTE" not in parameters:
        of_error, of_derivative = ("FILT", "FLTD") if axis == "yaw" else ("FLTE", "FILT")
    error_hz, derivative_hz = value(of_error), value(of_derivative)
    numbers = (*(value(name) for name in ("P", "I", "D", "FF", "D_FF", "FLTT")), error_hz, derivative_hz)
    if not any(numbers[:3]) or min(*numbers, parameters.get(angle, 0.0)) < 0.0:
        return None
    rate_hz = parameters.get("SCHED_LOOP_RATE", 0.0) if loop_rate_hz is None else loop_rate_hz
    notches = {name: _notch(parameters, prefix + name) for name in ("NTF", "NEF")}
    controller = RateController(
        proportional_s=value("P"),
        integral=value("I"),
        derivative_s2=value("D"),
        angle_1_s=float(parameters.get(angle, 0.0)),
        feedforward=value("FF"),
        feedforward_derivative_s=value("D_FF"),
        derivative_of_error=True,
        derivative_cutoff_hz=derivative_hz,
        error_cutoff_hz=error_hz,
        target_cutoff_hz=value("FLTT"),
        target_filters=notches["NTF"],
        error_filters=notches["NEF"],
        step_s=1.0 / rate_hz if rate_hz > 0.0 else 0.0,
        late_angle=True,
    )
    used = [f"FILT{int(value(name))}" for name, notch in notches.items() if notch]
    own = [f"{item}_{name}" for item in used for name in ("TYPE", "NOTCH_FREQ", "NOTCH_Q", "NOTCH_ATT")]
    return AxisController(
        autopilot=NAME,
        firmware=firmware,
        axis=axis,
        controller=controller,
        gains=present(parameters, (*(prefix + name for name in _GAINS), angle)),
        filters=present(parameters, (*(prefix + name for name in _FILTERS), *own)),
        notes=tuple(_notes(parameters, prefix, notches)),
    )


def _notch(parameters: Mapping[str, float], which: str) -> tuple[LoopFilter, ...]:
    """The notch to whose number a parameter points."""
    number = parameters.get(which, 0.0)
    if not number >= 1.0:
        return ()
    prefix = f"FILT{int(number)}_"
    kind, center_hz, quality, attenuation_db = (
        parameters.get(prefix + name, 0.0) for name in ("TYPE", "NOTCH_FREQ", "NOTCH_Q", "NOTCH_ATT")
    )
    if int(kind) != _NOTCH or not (center_hz >= _SLOWEST_HZ and quality > 0.0):
        return ()
    if not 0.0 <= attenuation_db <= _DEEPEST_NOTCH_DB:
        return ()
    return (LoopFilter(kind="notch", frequency_hz=center_hz, quality=quality, floor=10.0 ** (-attenuation_db / 20.0)),)


def _notes(parameters: Mapping[str, float], prefix: str, notches: Mapping[str, tuple[LoopFilter, ...]]) -> list[str]:
    notes = []
    for name, notch in notches.items():
        number = parameters.get(prefix + name, 0.0)
        if number >= 1.0 and not notch:
            notes.append(f"{prefix}{name} = {number:g} asks for a filter that FILT{number:.0f}_ does not describe.")
    if parameters.get(f"{prefix}SMAX", 0.0) > 0.0:
        notes.append(f"{prefix}SMAX lowers P and D while the output slews, logged as Dmod below 1.")
    if parameters.get(f"{prefix}PDMX", 0.0) > 0.0:
        notes.append(f"{prefix}PDMX limits the sum of P and D.")
    if parameters.get("ATC_THR_G_BOOST", 0.0) > 0.0:
        notes.append("ATC_THR_G_BOOST raises P, D and the angle gain while the throttle moves.")
    return notes
