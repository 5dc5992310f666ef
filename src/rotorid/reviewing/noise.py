"""Noise of a flight: vibration, clipping, filters and what reaches the motors, beside the spectra of its sensors.

Spectra and the causes of their peaks are those of :mod:`rotorid.reviewing.spectra`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from rotorid.autopilots.advice import absence, raw_gyro_advice, sensor_advice
from rotorid.autopilots.filters import combined_response
from rotorid.autopilots.registry import autopilot_of
from rotorid.data.axes import RATE_OF, RATES
from rotorid.data.display import capital, counted
from rotorid.data.findings import Finding, warn
from rotorid.data.quantities import QUANTITIES, VIBRATION_BANDS_HZ
from rotorid.data.quantity import TWO_SIDED_95, Quantity
from rotorid.data.record import FlightRecord, Intervals
from rotorid.flights.controllers import controllers_of
from rotorid.flights.sensor_samples import (
    LEAST_RATE_HZ,
    LINES_ABOVE_HZ,
    OF_RATE,
    Level,
    Sensor,
    level_of,
    samples_of,
    sensors_of,
)
from rotorid.reviewing.missing import Unavailable, section
from rotorid.reviewing.spectra import BINS, map_of, peaks_of, plotted_factor
from rotorid.reviewing.values import NoiseMap, NoisePeak, NoiseReview
from rotorid.signal.airborne import airborne, within
from rotorid.signal.autopilot_filters import filter_findings, known_filters
from rotorid.signal.dead_sensors import CHECK_SENSORS, dead_accelerometer, dead_gyro
from rotorid.spectral.noise import (
    OVERLAP,
    measured_delay,
    short_spectra,
    unexplained,
    unexplained_frequencies,
)
from rotorid.typing import Axis, FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

_VIBRATION_HZ = 10.0
"""Specific force that changes faster is vibration."""

_DELAY_BAND_HZ = (5.0, 80.0)
"""Where the delay of the filters is measured, as the slope of their phase."""

_DELAY_AT_HZ = 20.0
"""Where the phase delay of the configured filters is taken."""

_LINE_STD_DB = 1.0
"""Standard deviation of the height of a line, as that of a density over fifty windows."""

_HOT_HZ = 100.0
"""Noise above it moves nothing and heats the motors."""

_GYRO_END_RAD_S = tuple(math.radians(end) for end in (2000.0, 4000.0))
"""Ends of the ranges that gyros have."""

_ACCEL_END_M_S2 = tuple(STANDARD_GRAVITY_M_S2 * end for end in (8.0, 16.0, 32.0))
"""Ends of the ranges that accelerometers have."""

_SAME_RATE = 1.1
"""Ratio of two rates within which neither sensor folds more noise than the other."""


def noise(
    record: FlightRecord, *, bandwidths_rad_s: Mapping[str, float] | None = None
) -> tuple[NoiseReview, tuple[Unavailable, ...]]:
    r"""Noise of the sensors in the air and what of it reaches the motors.

    The heat map has windows of 0.3 s with three quarters of overlap in 25 bins of the mean motor output. Noise through
    P and D is the root of :math:`\int S (1 - \gamma^2) df` of the term, with the coherence to the set-point, above the
    larger of 30 Hz and twice the loop's bandwidth; where the terms are not logged, of the rate times the controller's
    response.

    Parameters
    ----------
    bandwidths_rad_s
        Of the closed rate loops ``p q r``, where they are known.

    Raises
    ------
    InsufficientDataError
        The vehicle never flew, or the log does not show whether it did.
    """
    flights = airborne(record).intervals
    sensors = tuple(sensors_of(record, flights))
    pictures: tuple[list[NoiseMap], list[NoisePeak]] = ([], [])
    (maps, found), missing = section("noise.maps", partial(_spectra, record, sensors), pictures)
    unavailable = [*missing]
    none: dict[str, Quantity] = {}
    numbers: dict[str, Quantity] = _rotor_lines(found)
    parts: dict[str, Callable[[FlightRecord, Sequence[Sensor], Intervals], NumbersAndGaps]] = {
        "vibration": _vibration,
        "clipping": _clipping,
        "filter_delay": _delays,
        "terms": _terms(bandwidths_rad_s or {}),
    }
    for name, part in parts.items():
        more, missing = section(f"noise.{name}", partial(part, record, sensors, flights), none)
        numbers |= more
        unavailable += missing
    attenuation, missing = section("noise.filter_attenuation", partial(_filter_attenuation, record, maps), none)
    numbers |= attenuation
    unavailable += missing
    return (
        NoiseReview(maps=tuple(maps), peaks=tuple(found), numbers=numbers, findings=tuple(_findings(numbers))),
        tuple(unavailable),
    )


def _filter_attenuation(record: FlightRecord, maps: Sequence[NoiseMap]) -> NumbersAndGaps:
    """What the filters take out of the noise, or why it is not known."""
    numbers, why = _attenuation(maps)
    what = "noise.filter_attenuation"
    return dict(numbers), [Unavailable(what=what, why=why, remedy=raw_gyro_advice(record))] if why else []


def _spectra(
    record: FlightRecord, sensors: Sequence[Sensor]
) -> tuple[tuple[list[NoiseMap], list[NoisePeak]], list[Unavailable]]:
    """Maps and peaks of all sensors, and which of them the log lacks."""
    level = level_of(record)
    maps: list[NoiseMap] = []
    found: list[NoisePeak] = []
    for sensor in sensors:
        spectra = short_spectra(sensor.time_s, sensor.values * plotted_factor(sensor.channel))
        if spectra is None:
            continue
        made = map_of(sensor, spectra, level)
        maps.append(made)
        if sensor.rate_hz >= LEAST_RATE_HZ and not any(peak.channel == sensor.channel for peak in found):
            found += peaks_of(record, sensor, spectra, made)
    return (maps, found), list(_unavailable(record, sensors, level))


NumbersAndGaps = tuple[dict[str, Quantity], list[Unavailable]]


def _vibration(record: FlightRecord, sensors: Sequence[Sensor], flights: Intervals) -> NumbersAndGaps:
    """Root mean square of the specific force above 10 Hz, or the autopilot's own measure of it."""
    if weightless := dead_accelerometer(record):
        return {}, [Unavailable(what="noise.vibration_m_s2", why=f"{weightless}.", remedy=CHECK_SENSORS)]
    cutoff_hz = autopilot_of(record).log.accelerometer_cutoff_hz(record)
    if 0.0 < cutoff_hz < LEAST_RATE_HZ / 2.0:
        why = f"The accelerometer is logged after a low-pass of {cutoff_hz:g} Hz, which removes the vibration."
        return {}, [Unavailable(what="noise.vibration_m_s2", why=why, remedy="set acc_lpf_hz = 0 for a test flight")]
    accelerometers = {sensor.channel: sensor for sensor in sensors if sensor.channel in ("ax", "ay", "az")}
    raw = [sensor for sensor in sensors if sensor.channel in accelerometers and sensor.stage == "before"]
    chosen = {**accelerometers, **{sensor.channel: sensor for sensor in raw}}
    if len(chosen) == 3 and min(sensor.rate_hz for sensor in chosen.values()) >= LEAST_RATE_HZ / 2.0:
        squares = []
        for sensor in chosen.values():
            spectra = short_spectra(sensor.time_s, sensor.values)
            if spectra is None:
                break
            above = spectra.frequency_hz >= _VIBRATION_HZ
            squares.append(spectra.density[:, above].sum(axis=1) * spectra.bin_hz)
        if len(squares) == 3:
            total = float(sum(np.mean(square) for square in squares))
            # Windows of one maneuver belong together: the means of tenths of the flight give the variance.
            variance = float(sum(_mean_variance(square) for square in squares))
            value = math.sqrt(total)
            std = 0.5 * math.sqrt(variance) / value if value > 0.0 else 0.0
            return {"vibration_m_s2": _positive(value, std, "m/s²"), **_bands(chosen)}, []
    if all(f"{name}_vibration" in record for name in ("ax", "ay", "az")):
        own = []
        for name in ("ax", "ay", "az"):
            track = record[f"{name}_vibration"]
            own.append(track.values[within(track.time_s, flights)])
        if own[0].size > 10:
            norm = np.sqrt(np.sum(np.square(own), axis=0))
            return {"vibration_m_s2": _positive(float(norm.mean()), math.sqrt(_mean_variance(norm)), "m/s²")}, []
    why = "The accelerometer is logged too slowly for vibration, or not at all."
    return {}, [Unavailable(what="noise.vibration_m_s2", why=why, remedy=_fast_sensors(record))]


def _bands(accelerometers: Mapping[str, Sensor]) -> dict[str, Quantity]:
    """Vibration of each axis in each band that the log reaches."""
    found = {}
    for channel, sensor in accelerometers.items():
        spectra = short_spectra(sensor.time_s, sensor.values)
        for low, high in VIBRATION_BANDS_HZ if spectra is not None else ():
            if spectra is None or spectra.frequency_hz[-1] < high:
                continue
            inside = (spectra.frequency_hz >= low) & (spectra.frequency_hz < high)
            squares = spectra.density[:, inside].sum(axis=1) * spectra.bin_hz
            value = math.sqrt(float(np.mean(squares)))
            std = 0.5 * math.sqrt(_mean_variance(squares)) / value if value > 0.0 else 0.0
            found[f"vibration_{channel}_{low}_{high}hz"] = _positive(value, std, "m/s²")
    return found


def _rotor_lines(peaks: Sequence[NoisePeak]) -> dict[str, Quantity]:
    """Height of the highest line of a rotor in each channel."""
    highest: dict[str, float] = {}
    for peak in peaks:
        if peak.source == "rotor":
            highest[peak.channel] = max(highest.get(peak.channel, 0.0), peak.height_db)
    named = {f"rotor_line_{channel.removesuffix('_raw')}_db": height for channel, height in highest.items()}
    return {name: Quantity.normal(height, _LINE_STD_DB, "dB") for name, height in named.items() if name in QUANTITIES}


def _mean_variance(values: FloatArray) -> float:
    """Variance of a mean, from means over up to ten parts."""
    parts = [float(np.mean(part)) for part in np.array_split(values, min(10, values.size)) if part.size]
    return float(np.var(parts, ddof=1)) / len(parts) if len(parts) > 1 else float(np.mean(values)) ** 2


def _positive(value: float, std: float, unit: str) -> Quantity:
    found = Quantity.normal(value, std, unit)
    return replace(found, lower=max(found.lower, 0.0))


def _clipping(record: FlightRecord, sensors: Sequence[Sensor], flights: Intervals) -> NumbersAndGaps:
    """Share of samples at the end of a sensor's range; the autopilot's own count where it keeps one."""
    numbers: dict[str, Quantity] = {}
    if "accel_clips" in record:
        track = record["accel_clips"]
        counts = track.values[within(track.time_s, flights)]
        if counts.size > 1:
            new = float(np.sum(np.maximum(np.diff(counts), 0.0)))
            numbers["clipping_count"] = Quantity(value=new, std=0.0, lower=new, upper=new, unit="1")
    shares = []
    for sensor in sensors:
        ends = _GYRO_END_RAD_S if sensor.channel in RATES else _ACCEL_END_M_S2
        size = np.abs(sensor.values)
        most = float(size.max())
        if any(abs(most / end - 1.0) < 0.005 for end in ends) or not numbers:
            at_end = [float(np.mean(np.abs(size / end - 1.0) < 0.002)) for end in ends if most < 1.01 * end]
            shares.append((max(at_end, default=0.0), size.size))
    if shares:
        share, count = max(shares)
        error = math.sqrt(max(share * (1.0 - share), 1.0 / count) / count)
        numbers["clipping_share"] = (
            Quantity(
                value=share,
                std=error,
                lower=max(share - TWO_SIDED_95 * error, 0.0),
                upper=share + 3.0 / count,
                unit="1",
            )
            if share == 0.0
            else _positive(share, error, "1")
        )
    if numbers:
        return numbers, []
    why = "Neither a fast sensor nor a count of clipped samples is logged."
    return {}, [Unavailable(what="noise.clipping_share", why=why, remedy=_fast_sensors(record))]


def _delays(record: FlightRecord, sensors: Sequence[Sensor], _: Intervals) -> NumbersAndGaps:
    """Delay of the gyro's filters, by the settings and by what passed them."""
    numbers: dict[str, Quantity] = {}
    unavailable: list[Unavailable] = []
    source = next((sensor.source for sensor in sensors if sensor.channel == "p" and sensor.stage == "after"), "")
    if source.startswith(("ISBD", "GYR")):
        source = "RATE.R"
    filters = known_filters(record, source) if source else ()
    findings = filter_findings(record, source) if source else ()
    doubts = [finding.message for finding in findings if finding.kind == "unknown_filter"]
    at = np.array([2.0 * math.pi * _DELAY_AT_HZ])
    if filters:
        delay = float(-np.angle(combined_response(filters, at))[0] / at[0])
        upper = math.inf if doubts else delay
        numbers["filter_delay_configured_s"] = Quantity(value=delay, std=0.0, lower=delay, upper=upper, unit="s")
    else:
        why = f"{capital(doubts[0])}." if doubts else "The log does not name the filters of the gyro."
        unavailable.append(Unavailable(what="noise.filter_delay_configured_s", why=why))
    before, after = (
        next((sensor for sensor in sensors if sensor.channel == "p" and sensor.stage == stage), None)
        for stage in ("before", "after")
    )
    what, remedy = "noise.filter_delay_measured_s", raw_gyro_advice(record)
    if before is None or after is None or before.topic == "sensor_combined":
        why = "The gyro is not logged both before and after its filters."
        return numbers, [*unavailable, Unavailable(what=what, why=why, remedy=remedy)]
    if before.rate_hz < 0.9 * after.rate_hz or after.rate_hz < 2.5 * _DELAY_AT_HZ:
        why = f"The filtered gyro is logged at only {after.rate_hz:.0f} Hz."
        return numbers, [*unavailable, Unavailable(what=what, why=why, remedy=_fast_sensors(record))]
    near = before.time_s[np.clip(np.searchsorted(before.time_s, after.time_s), 0, before.time_s.size - 1)]
    together = np.abs(near - after.time_s) <= 1.5 / before.rate_hz
    if np.mean(together) < 0.5:
        why = "The batches before and after the filters were not taken at the same time."
        has = "INS_RAW_LOG_OPT" in record.parameters
        both = "set INS_RAW_LOG_OPT = 9 to log GYR before and after the filters" if has else ""
        return numbers, [*unavailable, Unavailable(what=what, why=why, remedy=both)]
    raw = np.interp(after.time_s, before.time_s, before.values)
    measured = measured_delay(after.time_s, raw, after.values, band_hz=_DELAY_BAND_HZ)
    if measured is None:
        why = "The gyro was logged too briefly without gaps."
        return numbers, [*unavailable, Unavailable(what=what, why=why, remedy="fly for 20 s or more")]
    numbers["filter_delay_measured_s"] = Quantity.normal(measured.delay_s, max(measured.std_s, 2e-5), "s")
    return numbers, unavailable


def _attenuation(maps: Sequence[NoiseMap]) -> tuple[dict[str, Quantity], str]:
    r"""How much of the gyro's noise its filters take, or why that is not known.

    .. math:: a = \sqrt{\sum_{c, b} w_b \int S_{before} df \Big/ \sum_{c, b} w_b \int S_{after} df}

    over the axes :math:`c` and the bins :math:`b` of the throttle that were flown while either side was logged, with
    the fewer windows of the two as weight. The two need not have been logged at the same time: at one throttle the
    rotors make the same noise. The interval is that of a jackknife over the bins, at least that of as many windows.
    """
    pairs = [
        (before, after)
        for before in maps
        for after in maps
        if before.stage == "before" and after.stage == "after" and before.channel == after.channel
        if before.channel in RATES and before.against and after.against
    ]
    powers: dict[int, list[tuple[float, float, float]]] = {}
    for before, after in pairs:
        tops_hz = [float(made.frequency_hz[-1]) for made in (before, after)]
        if not 1.0 / _SAME_RATE < tops_hz[0] / tops_hz[1] < _SAME_RATE:
            slow, rate_hz = ("unfiltered", tops_hz[0]) if tops_hz[0] < tops_hz[1] else ("filtered", tops_hz[1])
            return {}, f"The {slow} gyro is logged at only {2.0 * rate_hz:.0f} Hz, where faster noise folds."
        unfiltered, filtered = (_powers(made, OF_RATE * 2.0 * min(tops_hz)) for made in (before, after))
        for place in unfiltered.keys() & filtered.keys():
            weight = min(unfiltered[place][1], filtered[place][1])
            powers.setdefault(place, []).append(
                (weight * unfiltered[place][0], weight * filtered[place][0], (1.0 - OVERLAP) * weight)
            )
    if not powers:
        return {}, "The gyro was logged before and after its filters at different throttles only." if pairs else ""
    by_bin = np.stack([np.sum(rows, axis=0) for rows in powers.values()])
    before_power, after_power, windows = by_bin.sum(axis=0)
    if not (before_power > 0.0 and after_power > 0.0):
        return {}, "The gyro shows no noise above 30 Hz."
    value, std = math.sqrt(before_power / after_power), 1.0 / math.sqrt(windows)
    if len(by_bin) > 1:
        rest = by_bin.sum(axis=0) - by_bin
        logs = 0.5 * np.log(rest[:, 0] / rest[:, 1])
        std = max(std, math.sqrt((len(logs) - 1) * float(np.var(logs))))
    return {"filter_attenuation": _positive(value, value * std, "1")}, ""


def _powers(made: NoiseMap, top_hz: float) -> dict[int, tuple[float, float]]:
    """Power of the noise in each bin of the throttle that was flown, and its windows."""
    band = (made.frequency_hz >= LINES_ABOVE_HZ) & (made.frequency_hz <= top_hz)
    if np.count_nonzero(band) < 2:
        return {}
    step_hz = float(made.frequency_hz[1] - made.frequency_hz[0])
    sums = step_hz * made.density[:, band].sum(axis=1)
    return {
        round(level * BINS - 0.5): (float(power), float(windows))
        for level, power, windows in zip(made.level, sums, made.windows, strict=True)
        if np.isfinite(power) and windows > 0.0
    }


def _terms(
    bandwidths_rad_s: Mapping[str, float],
) -> Callable[[FlightRecord, Sequence[Sensor], Intervals], NumbersAndGaps]:
    def terms_noise(record: FlightRecord, sensors: Sequence[Sensor], flights: Intervals) -> NumbersAndGaps:
        """Noise of P and D in the motors, by the terms as logged or by the rate times the controller."""
        numbers: dict[str, Quantity] = {}
        unavailable: list[Unavailable] = []
        for axis, rate in RATE_OF.items():
            low_hz = max(30.0, 2.0 * bandwidths_rad_s.get(rate, 0.0) / (2.0 * math.pi))
            made = _logged_terms(record, axis, rate, flights, low_hz) or _computed_terms(record, axis, sensors, low_hz)
            numbers |= made
            if not made:
                why = f"The log needs the terms of the {axis} controller, or its gains and the rate at 100 Hz."
                fast = record.rate_hz(rate) >= _needed_hz(low_hz)
                remedy = f"log the terms of the {axis} controller" if fast else _fast_sensors(record)
                unavailable.append(Unavailable(what=f"noise.{axis}_p_noise_share", why=why, remedy=remedy))
        return numbers, unavailable

    return terms_noise


def _logged_terms(record: FlightRecord, axis: str, rate: str, flights: Intervals, low_hz: float) -> dict[str, Quantity]:
    numbers: dict[str, Quantity] = {}
    for term in ("p", "d"):
        terms = samples_of(record, (f"{axis}_{term}_term",), rate, "after", flights)
        if terms is None or terms.rate_hz < 3.0 * low_hz or float(np.ptp(terms.values)) == 0.0:
            continue
        reference = None
        if f"{rate}_setpoint" in record:
            track = record[f"{rate}_setpoint"]
            reference = np.interp(terms.time_s, track.time_s, track.values)
        numbers |= _shares(f"{axis}_{term}", terms.time_s, terms.values, reference, low_hz)
    return numbers


def _needed_hz(low_hz: float) -> float:
    """Least rate of a log whose noise above a frequency makes the terms of a controller."""
    return max(3.0 * low_hz, 100.0)


def _computed_terms(record: FlightRecord, axis: Axis, sensors: Sequence[Sensor], low_hz: float) -> dict[str, Quantity]:
    rate = next((s for s in sensors if s.channel == RATE_OF[axis] and s.stage == "after"), None)
    if rate is None or rate.rate_hz < _needed_hz(low_hz):
        return {}
    logged = controllers_of(record).axis(axis)
    if logged is None:
        return {}
    controller = logged.controller
    window_s = min(0.5, 0.9 * _stretch_s(rate.time_s))
    omega = 2.0 * np.pi * np.maximum(unexplained_frequencies(rate.time_s, window_s=window_s), 0.1)
    numbers: dict[str, Quantity] = {}
    proportional_derivative = replace(controller, integral=0.0, angle_1_s=0.0)
    for term in ("p", "d"):
        kept = controller.derivative_s2 if term == "d" else controller.proportional_s
        if kept > 0.0:
            item = (
                replace(proportional_derivative, proportional_s=0.0)
                if term == "d"
                else replace(proportional_derivative, derivative_s2=0.0)
            )
            gain = np.abs(item.response(omega)) ** 2
            numbers |= _shares(f"{axis}_{term}", rate.time_s, rate.values, None, low_hz, gain, window_s)
    return numbers


def _stretch_s(time_s: FloatArray) -> float:
    """Length of the usual stretch without a gap."""
    from rotorid.spectral.noise import stretches

    return float(np.median([time_s[part][-1] - time_s[part][0] for part in stretches(time_s)] or [0.0]))


def _shares(
    name: str,
    time_s: FloatArray,
    values: FloatArray,
    reference: FloatArray | None,
    low_hz: float,
    gain: FloatArray | None = None,
    window_s: float = 0.5,
) -> dict[str, Quantity]:
    bands = {"": low_hz, "_above_100hz": max(low_hz, _HOT_HZ)}
    found = unexplained(
        time_s, values, reference, bands_hz=[(low, math.inf) for low in bands.values()], gain=gain, window_s=window_s
    )
    # The part that the set-point explains varies by about a tenth with windows and flight.
    return {
        f"{name}_noise_share{suffix}": _positive(part.rms, math.hypot(part.std, 0.05 * part.rms), "1")
        for suffix, part in zip(bands, found or (), strict=False)
    }


def _unavailable(record: FlightRecord, sensors: Sequence[Sensor], level: Level | None) -> Iterator[Unavailable]:
    gyro = [sensor for sensor in sensors if sensor.channel == "p"]
    if not gyro:
        how = "not logged in the air" if "p" in record else absence(record, "p")
        why = f"{dead_gyro(record) or f'Body rates are {how}'}."
        yield Unavailable(what="noise.maps", why=why, remedy=_fast_sensors(record))
        return
    if max(sensor.rate_hz for sensor in gyro) < LEAST_RATE_HZ:
        fastest = max(sensor.rate_hz for sensor in gyro)
        why = f"The gyro is logged at only {fastest:.0f} Hz, so rotor vibration aliases."
        yield Unavailable(what="noise.peaks", why=why, remedy=_fast_sensors(record))
    if not any(sensor.stage == "before" for sensor in gyro):
        why = f"The gyro before its filters is {absence(record, 'p_raw')}."
        yield Unavailable(what="noise.maps.before", why=why, remedy=raw_gyro_advice(record))
    if level is None:
        why = "Neither motors nor throttle are logged."
        yield Unavailable(what="noise.maps.throttle", why=why)


def _fast_sensors(record: FlightRecord) -> str:
    return sensor_advice(record, max((topic.sample_rate_hz for topic, _ in record.holding("p")), default=0.0))


def _findings(numbers: Mapping[str, Quantity]) -> Iterator[Finding]:
    share = numbers.get("clipping_share")
    if share is not None and share.value > QUANTITIES["clipping_share"].limit:
        worst = f"{100.0 * share.value:.2g} %"
        message = f"A sensor was at the end of its range in {worst} of the samples. Mount it more softly."
        yield warn("sensor_clipping", "sensors", message, share=share.value)
    count = numbers.get("clipping_count")
    if count is not None and count.value > 0.0:
        message = (
            f"The autopilot counted {counted(round(count.value), 'clipped sample')} of the accelerometer in the air."
        )
        yield warn("sensor_clipping", "accelerometer", message, samples=count.value)
