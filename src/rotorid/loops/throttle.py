r"""The plant of an axis at the throttle of hover, from a flight whose throttle was chopped and pushed.

Thrust that grows with the square of the output has a slope that grows with the throttle, and so has the torque of a
command. With throttle :math:`\delta` relative to hover,

.. math:: \dot p = g\,(1 + \kappa \delta)\, u, \qquad \delta = T / T_0 - 1

A response averages that: while the throttle is cut, the loop is weak and its commands are large, so that vehicles
without linear thrust read up to 15 % weak. Two inputs, :math:`u` and :math:`\delta u`, with two instruments, the stick
and :math:`\delta` times the stick, give both gains; their first one over that of :math:`u` alone corrects the response.

A gain that moves around its mean by a relative :math:`\sigma` also bends the response, since the loop :math:`L` makes
larger commands while it is weak. To second order, and slowly for the loop,

.. math:: \frac{E[g / (1 + g L)]}{E[1 / (1 + g L)]} = 1 - \sigma^2 \frac{L}{1 + L}

a lead where the closed loop lags. It is taken out where the controller is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.data.axes import RATE_OF
from rotorid.data.record import LOWEST_RATE_HZ, FlightRecord, TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.flights.controllers import controller_as_logged, controllers_of
from rotorid.flights.segments import cut
from rotorid.flights.selection import by_stick
from rotorid.flights.whole_flights import FlightData
from rotorid.loops.plants import MeasuredPlant, identified_plant
from rotorid.signal.excitations import rich_excitations
from rotorid.signal.motors import logged_outputs
from rotorid.typing import Axis, ComplexArray, FloatArray, IntArray

_THROTTLE = "thrust_command"
_STEADY = 0.05
"""Standard deviation of the throttle over its median below which a response is that of the hover."""

_WINDOW_S, _OVERLAP = 3.0, 4
_FROM_RAD_S, _TO_RAD_S = 5.0, 40.0
"""Where gains are compared: speed modes and leakage of short windows lie below, noise above."""

_FEWEST_LINES, _GROUPS = 4, 8
_UNSURE = 0.5
"""Share of a correction that counts as its error: rotors at their limits and asymmetric lags are not in the model."""

_LARGEST = 0.3
"""Largest correction that is believed, and largest variance of the gain for which two terms of its series are enough.
"""


class _Spectra(NamedTuple):
    """Windows by lines of the two instruments, the two inputs and the output over the measured response."""

    instruments: ComplexArray
    inputs: ComplexArray
    output: ComplexArray


def plant_at_hover(axis: Axis, records: Sequence[FlightRecord]) -> MeasuredPlant | None:
    """The plant as ``identify`` measures it, at the throttle of hover: the one that is reviewed, judged and tuned.

    Parameters
    ----------
    axis, records
        As for :func:`rotorid.loops.plants.identified_plant`, which may give ``None``.

    Raises
    ------
    InsufficientDataError
        The flights show too little.
    """
    plant = identified_plant(axis, records)
    return plant and at_hover_throttle(plant, records)


def at_hover_throttle(
    plant: MeasuredPlant, records: Sequence[FlightRecord], *, flight: FlightData | None = None
) -> MeasuredPlant:
    """The plant with the gain that it has at the median throttle; as it was where sweeps show it, or nothing else can.

    Parameters
    ----------
    plant
        Measured over the parts in which the stick moves, or over a whole flight.
    records
        Its logs.
    flight
        The flight, where the plant was measured over all of it.

    Returns
    -------
    MeasuredPlant
        With ``gain_error``: the random error of the correction, and half of the correction; of a whole flight whose
        throttle moves and that cannot be corrected, the largest correction. With ``bend_error``, half of what was
        taken out of its shape.
    """
    throttle = _throttle(records)
    if not throttle or (flight is None and any(rich_excitations(record, plant.axis) for record in records)):
        return plant
    try:
        histories = _histories(plant, records, throttle, flight)
    except InsufficientDataError:
        return plant
    levels = [np.mean([history[name] for name in throttle], axis=0) for history in histories]
    every = np.concatenate(levels)
    hover = float(np.median(every))
    if hover <= 0.0 or not np.std(every) > _STEADY * hover:
        return plant
    apart = [level / hover - 1.0 for level in levels]
    spectra = _spectra(plant, histories, apart)
    if spectra is None:
        return plant if flight is None else replace(plant, gain_error=_LARGEST)
    ratio = _hover_over_mean(spectra)
    groups = np.array_split(np.arange(spectra.output.shape[0]), _GROUPS)
    without = [_hover_over_mean(_left_out(spectra, group)) for group in groups]
    random = float(np.sqrt((_GROUPS - 1) / _GROUPS * np.sum((np.array(without) - np.mean(without)) ** 2)))
    if not abs(ratio - 1.0) <= _LARGEST or not random < _LARGEST:
        return replace(plant, gain_error=_LARGEST)
    bend = _bend(plant, records[0], _variance(spectra, np.concatenate(apart)))
    values = plant.response.values * ratio / bend
    error = float(np.hypot(random, _UNSURE * (ratio - 1.0)))
    response = replace(plant.response, values=values)
    return replace(
        plant, response=response, gain_error=error, bend_error=np.asarray(_UNSURE * np.log(bend), dtype=np.complex128)
    )


def _variance(spectra: _Spectra, apart: FloatArray) -> float:
    """Relative variance of the gain, by its slope over the throttle; zero where that is too large to be believed."""
    here, slope = _gains(spectra)
    mean = here + slope * float(np.mean(apart))
    variance = float(np.var(apart)) * (slope / mean) ** 2 if mean > 0.0 else np.inf
    return variance if variance < _LARGEST else 0.0


def _bend(plant: MeasuredPlant, record: FlightRecord, variance: float) -> ComplexArray:
    """What a moving gain does to the shape of the response, shape ``(f,)``; one where the controller is not known.

    Its mean size where gains are compared is one: the gain is corrected for itself.
    """
    omega = plant.response.omega_rad_s
    known = controllers_of(record).axis(plant.axis)
    if known is None or variance == 0.0:
        return np.ones(omega.size, dtype=np.complex128)
    acting = controller_as_logged(record, known.controller.rate_loop, source=plant.source)
    loop = plant.response.values[0, 0] * acting.response(omega)
    bend = 1.0 - variance * loop / (1.0 + loop)
    compared = (omega >= _FROM_RAD_S) & (omega <= _TO_RAD_S)
    size = np.exp(np.mean(np.log(np.abs(bend[compared])))) if compared.any() else 1.0
    return np.asarray(bend / size)


def _throttle(records: Sequence[FlightRecord]) -> tuple[str, ...]:
    """Channels whose mean is the throttle in every log: motors, since mixers move it away from its command."""
    motors = {_fast_motors(record) for record in records}
    if len(motors) == 1 and (found := motors.pop()):
        return found
    return (_THROTTLE,) if all(_THROTTLE in record.channel_names for record in records) else ()


def _fast_motors(record: FlightRecord) -> tuple[str, ...]:
    """Outputs of all motors, where they are logged as fast as a rate loop needs."""
    try:
        outputs = logged_outputs(record)
    except InsufficientDataError:
        return ()
    return outputs.names if outputs.sample_rate_hz >= LOWEST_RATE_HZ else ()


def _histories(
    plant: MeasuredPlant, records: Sequence[FlightRecord], throttle: tuple[str, ...], flight: FlightData | None
) -> Sequence[TimeHistory]:
    """Instrument, command, rate and throttle on one clock, of the parts over which the plant was measured."""
    command, rate = f"{plant.axis}_command", RATE_OF[plant.axis]
    if flight is not None:
        during = flight.during(plant.instrument)
        return flight.histories((command, rate), sampled=(plant.channel, *throttle), intervals=during)
    segments, _ = cut(by_stick(records, (plant.axis,)), channels=(plant.channel, command, rate, *throttle))
    return [segment.history for segment in segments]


def _spectra(plant: MeasuredPlant, histories: Sequence[TimeHistory], apart: Sequence[FloatArray]) -> _Spectra | None:
    """Spectra of all windows, with the throttle relative to hover; ``None`` where the flight or its band is short."""
    command, rate = f"{plant.axis}_command", RATE_OF[plant.axis]
    sample_s = 1.0 / histories[0].sample_rate_hz
    count = round(_WINDOW_S / sample_s)
    omega = np.asarray(2.0 * np.pi * np.fft.rfftfreq(count, sample_s))
    low, high = plant.band_rad_s
    lines = np.flatnonzero((omega >= max(low, _FROM_RAD_S)) & (omega <= min(high, _TO_RAD_S)))
    if lines.size < _FEWEST_LINES:
        return None
    found: list[list[ComplexArray]] = [[] for _ in range(5)]
    for history, moved in zip(histories, apart, strict=True):
        stick, asked = history[plant.channel], history[command]
        for rows, values in zip(found, (stick, moved * stick, asked, moved * asked, history[rate]), strict=True):
            rows.append(_windows(values, count)[:, lines])
    rows = [np.concatenate(row) for row in found]
    if len(rows[0]) < 2 * _GROUPS:
        return None
    response = _between(plant, omega[lines])
    return _Spectra(np.array(rows[:2]), np.array(rows[2:4]), rows[4] / response)


def _windows(values: FloatArray, count: int) -> ComplexArray:
    taper = np.hanning(count)
    starts = range(0, values.size - count + 1, count // _OVERLAP)
    parts = np.array([values[start : start + count] for start in starts]).reshape(-1, count)
    return np.asarray(np.fft.rfft(taper * (parts - parts.mean(axis=1, keepdims=True)), axis=1))


def _between(plant: MeasuredPlant, omega_rad_s: FloatArray) -> ComplexArray:
    """The measured response at lines inside its band."""
    at, values = np.log(plant.response.omega_rad_s), plant.response.values[0, 0]
    size = np.interp(np.log(omega_rad_s), at, np.log(np.abs(values)))
    phase = np.interp(np.log(omega_rad_s), at, np.unwrap(np.angle(values)))
    return np.asarray(np.exp(size + 1j * phase))


def _left_out(spectra: _Spectra, group: IntArray) -> _Spectra:
    kept = np.setdiff1d(np.arange(spectra.output.shape[0]), group)
    return _Spectra(spectra.instruments[:, kept], spectra.inputs[:, kept], spectra.output[kept])


def _hover_over_mean(spectra: _Spectra) -> float:
    """Gain of the command at hover over that of the command alone, over all lines, the coherent ones first."""
    rows, right = _equations(spectra)
    alone = np.sum(rows[0, 0].conj() * right[0]).real / np.sum(np.abs(rows[0, 0]) ** 2)
    return float(_solved(rows, right)[0] / alone)


def _gains(spectra: _Spectra) -> tuple[float, float]:
    """Gain at hover, and its slope over the throttle, relative to the measured response."""
    here, slope = _solved(*_equations(spectra))
    return float(here), float(slope)


def _solved(rows: ComplexArray, right: ComplexArray) -> FloatArray:
    normal = np.einsum("ijl,ikl->jk", rows.conj(), rows).real
    return np.asarray(np.linalg.solve(normal, np.einsum("ijl,il->j", rows.conj(), right).real))


def _equations(spectra: _Spectra) -> tuple[ComplexArray, ComplexArray]:
    """Equations of both gains, ``(2, 2, lines)`` and ``(2, lines)``, each line by its coherence."""
    z, u, y = spectra
    power = np.mean(np.abs(z) ** 2, axis=1)
    cross = np.einsum("iwl,jwl->ijl", z.conj(), u) / len(y)
    answer = np.einsum("iwl,wl->il", z.conj(), y) / len(y)
    command = np.mean(np.abs(u[0]) ** 2, axis=0)
    coherent = np.abs(cross[0, 0]) ** 2 / (power[0] * command)
    # Equations of each instrument by its own power and the command's, so that every line counts by its coherence.
    weight = np.sqrt(coherent / (power * command))
    return cross * weight[:, None], answer * weight
