"""The loop around an axis as the same flight shows it: the broken loop with its margins, sensitivity, attitude."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

from rotorid.data.record import FlightRecord, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError
from rotorid.pipeline.preparation.controllers import logged_controllers
from rotorid.pipeline.preparation.flights import Flight
from rotorid.pipeline.preparation.measure import Measured
from rotorid.pipeline.preparation.segments import histories
from rotorid.spectral.derived import Estimated, selected, with_model_error
from rotorid.spectral.estimate import frequency_response
from rotorid.spectral.loops import injected_loop, sensitivity, series
from rotorid.spectral.margins import (
    AttitudeBandwidth,
    DisturbanceRejection,
    LoopMargins,
    attitude_bandwidth,
    disturbance_rejection,
    loop_margins,
)
from rotorid.typing import Axis

ATTITUDE: Mapping[Axis, str] = {"roll": "phi", "pitch": "theta", "yaw": "psi"}
MODEL_ERROR = 0.007
"""Share of a measured loop that it errs by whatever the length of the flight, alike over an octave."""

_RATE: Mapping[Axis, str] = {"roll": "p", "pitch": "q", "yaw": "r"}


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisLoop:
    """What a flight shows of the loop around one axis.

    Parameters
    ----------
    method
        How the broken loop was found, in words.
    loop
        The broken-loop response, or ``None``.
    margins, rejection
        What follows from it.
    attitude
        Bandwidth of the attitude's answer to its command.
    """

    method: str
    loop: FrequencyResponse | None
    margins: LoopMargins | None
    rejection: DisturbanceRejection | None
    attitude: AttitudeBandwidth | None

    @property
    def band_rad_s(self) -> tuple[float, float] | None:
        """Lowest and highest frequency of the broken loop; ``None`` where it was not seen."""
        return None if self.loop is None else (float(self.loop.omega_rad_s[0]), float(self.loop.omega_rad_s[-1]))

    @property
    def numbers(self) -> dict[str, Estimated]:
        """What was seen, by names that hold their units: margins, rejection of disturbances, bandwidths."""
        found = {
            _public_name(part, item.name): value
            for part in self._parts
            for item in fields(part)
            if isinstance(value := getattr(part, item.name), Estimated)
        }
        if self.margins is not None and self.margins.gain_crossovers:
            found["crossover_rad_s"] = self.margins.gain_crossovers[-1].omega_rad_s
        return found

    @property
    def not_seen(self) -> dict[str, str]:
        """Names of what was not seen, to the reason."""
        return {_public_name(part, name): reason for part in self._parts for name, reason in part.not_seen.items()}

    @property
    def _parts(self) -> tuple[LoopMargins | DisturbanceRejection | AttitudeBandwidth, ...]:
        return tuple(part for part in (self.margins, self.rejection, self.attitude) if part is not None)


def _public_name(part: LoopMargins | DisturbanceRejection | AttitudeBandwidth, name: str) -> str:
    """Names of different parts next to each other."""
    if isinstance(part, DisturbanceRejection):
        return f"disturbance_rejection_{name}"
    return f"attitude_{name}" if isinstance(part, AttitudeBandwidth) else name


def axis_loop(axis: Axis, measured: Measured, flown: Sequence[Flight]) -> AxisLoop | None:
    """The loop around an axis, from whatever the flight offers; ``None`` where it offers nothing.

    An injection at the mixer gives the broken loop directly. Otherwise the measured rate response times the gains in
    the log, of the rate loop alone. The attitude's answer is that to its instrument, the stick or the set-point.

    Parameters
    ----------
    axis
        The axis.
    measured
        Responses of a command of this axis, and the data behind them.
    flown
        Records and maneuvers behind them.
    """
    records = histories(measured.segments)
    loop, method = _injected(axis, measured, flown, records) or _computed(axis, measured, flown) or (None, "")
    loop = loop and with_model_error(loop, MODEL_ERROR)
    attitude = _attitude(axis, measured, records)
    if loop is None and attitude is None:
        return None
    return AxisLoop(
        method=method or "no injection at the mixer and no gains in the log: no broken loop",
        loop=loop,
        margins=loop_margins(loop) if loop else None,
        rejection=disturbance_rejection(sensitivity(loop)) if loop else None,
        attitude=attitude,
    )


def _injected(
    axis: Axis, measured: Measured, flown: Sequence[Flight], records: Sequence[TimeHistory]
) -> tuple[FrequencyResponse, str] | None:
    excitation, response = f"{axis}_excitation", measured.response
    if excitation not in response.instruments:
        return None
    # What the system identification mode of ArduPilot logs enters the mixer one loop later.
    rates_hz = {_loop_rate_hz(record) for record, _ in flown}
    delay_s = 1.0 / rates_hz.pop() if len(rates_hz) == 1 and all(rates_hz) else 0.0
    loop = injected_loop(
        records,
        command=f"{axis}_command",
        excitation=excitation,
        omega_rad_s=response.omega_rad_s,
        windows_s=response.windows_s,
        injection_delay_s=delay_s,
    )
    return loop, f"measured with {excitation}, all loops closed"


def _loop_rate_hz(record: FlightRecord) -> float:
    return record.parameters.get("SCHED_LOOP_RATE", 0.0) if "SID_AXIS" in record.parameters else 0.0


def _computed(axis: Axis, measured: Measured, flown: Sequence[Flight]) -> tuple[FrequencyResponse, str] | None:
    response, rate = measured.response, _RATE.get(axis, "")
    if rate not in response.outputs or response.estimate != "joint" or len(response.inputs) > 1:
        return None
    parameters = flown[0][0].parameters
    controllers = logged_controllers(flown, measured, f"{axis}_command", rate)
    if len(controllers) != 1 or any(record.parameters != parameters for record, _ in flown):
        return None
    plant = selected(response, outputs=[rate], inputs=[f"{axis}_command"])
    gains = controllers[0].rate_loop.response(response.omega_rad_s)
    return series(plant, gains), "measured vehicle times the gains in the log, rate loop alone"


def _attitude(axis: Axis, measured: Measured, records: Sequence[TimeHistory]) -> AttitudeBandwidth | None:
    response, angle = measured.response, ATTITUDE.get(axis, "")
    commands = [name for name in response.instruments if name in (f"{axis}_stick", f"{angle}_setpoint")]
    if not commands or not all(angle in record.names for record in records):
        return None
    try:
        answer = frequency_response(
            records,
            inputs=commands[:1],
            outputs=[angle],
            omega_rad_s=response.omega_rad_s,
            windows_s=response.windows_s,
        )
    except InsufficientDataError:
        # A command that rests, or an attitude that does: the flight has no answer to show.
        return None
    return attitude_bandwidth(with_model_error(answer, MODEL_ERROR))
