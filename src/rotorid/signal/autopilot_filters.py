"""Which filters of the autopilot stand between the motion and a logged channel, from the parameters in the log.

A chain is known as far as the log carries its parameters. Not in any log, and not here: the sensor's own analog and
hardware filters, and the time between a sample and its stamp.

References
----------
PX4 User Guide, Parameter Reference (``IMU_*``) and *MC Filter Tuning & Control Latency*. ArduPilot Copter, *Complete
Parameter List* (``INS_*``), *Managing Gyro Noise with the Dynamic Harmonic Notch Filters* and *System Identification
Mode*. Betaflight wiki, *Gyro & Dterm filtering*, *4.2 Tuning Notes* and *4.3 Tuning Notes*. The digital forms, and what
is logged from where, are those of the published sources: PX4 ``LowPassFilter2p``, ``NotchFilter``,
``VehicleAngularVelocity``, ``VehicleIMU``; ArduPilot ``LowPassFilter2p``, ``NotchFilter``, ``HarmonicNotchFilter``,
``AP_InertialSensor_Backend``, ``ModeSystemId``; Betaflight ``common/filter.c``, ``sensors/gyro_init.c`` and, for the
names in the header, ``blackbox/blackbox.c``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import FlightRecord
from rotorid.errors import UsageError
from rotorid.signal.filters import (
    KnownFilter,
    butterworth_low_pass,
    cascaded_low_pass,
    integral_mean,
    moving_average,
    notch,
)

Parameters = Mapping[str, float]
Build = Callable[[tuple[float, ...], float], KnownFilter]

_BETAFLIGHT = "Betaflight"
_FAST_SENSOR_HZ = 8000.0
_ARDUPILOT_SENSOR_HZ = 1000.0
_SINGLE_NOTCH = "INS_NOTCH"
"""Of older firmware: without harmonics, and it does not move."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Passage:
    """Filters that a channel has passed.

    Parameters
    ----------
    filters
        Those that are known.
    doubts
        Why these are not, or perhaps not, all; each the rest of a sentence.
    """

    filters: tuple[KnownFilter, ...] = ()
    doubts: tuple[str, ...] = ()


def doubtful(doubt: str) -> Passage:
    """A passage of which only this is known."""
    return Passage(doubts=(doubt,))


def moving(setting: str, value: float) -> Passage:
    """A filter that follows the motors or a spectrum: no response that is constant in time undoes it."""
    return doubtful(f"a filter that moves in flight is on ({setting} = {value:g}); what it took cannot be given back")


def built(settings: str, make: Callable[[], KnownFilter]) -> Passage:
    """The filter that settings of a log ask for, or that they ask for none that can be."""
    try:
        return Passage(filters=(make(),))
    except UsageError as error:
        return doubtful(f"{settings} makes no filter: {error.came}")


def joined(passages: Iterable[Passage]) -> Passage:
    """One passage behind the other.

    Examples
    --------
    >>> joined([doubtful("a"), Passage(), doubtful("b")]).doubts
    ('a', 'b')
    """
    parts = tuple(passages)
    return Passage(
        filters=tuple(known for part in parts for known in part.filters),
        doubts=tuple(doubt for part in parts for doubt in part.doubts),
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class Stage:
    """One filter of a chain.

    Parameters
    ----------
    names
        Its parameters; the filter is off where the first is zero.
    build
        Makes it from their values and the rate.
    needed
        Whether a log without the parameters leaves the chain unknown. A notch that the firmware did not have yet is
        none.
    """

    names: tuple[str, ...]
    build: Build
    needed: bool = False


@dataclass(frozen=True, kw_only=True, slots=True)
class Chain:
    """What a source of a log has passed.

    Parameters
    ----------
    source
        Pattern of :attr:`rotorid.data.record.Channel.source`, matched from end to end.
    stages
        Filters with constant parameters.
    notches
        Prefixes of ArduPilot's harmonic notches.
    moving
        Parameters that switch on a filter which follows the motors' speed or a spectrum.
    nonlinear
        Parameters that, when positive, put something between channel and motor that is no linear filter.
    sensor_rate_hz
        Rate of the filters where nothing better is known.
    """

    source: str
    stages: tuple[Stage, ...] = ()
    notches: tuple[str, ...] = ()
    moving: tuple[str, ...] = ()
    nonlinear: tuple[str, ...] = ()
    sensor_rate_hz: float = _FAST_SENSOR_HZ


def _second_order(values: tuple[float, ...], rate_hz: float) -> KnownFilter:
    return butterworth_low_pass(values[0], rate_hz)


def _px4_notch(values: tuple[float, ...], rate_hz: float) -> KnownFilter:
    # Its damping is the tangent of the half bandwidth; sine over twice the quality is what `notch` makes of it.
    center_hz, bandwidth_hz = values
    if not (0.0 < center_hz < 0.5 * rate_hz and _NARROWEST * center_hz < bandwidth_hz < 0.5 * rate_hz):
        raise UsageError(
            f"a notch at {center_hz:g} Hz, {bandwidth_hz:g} Hz wide, came", needed="less than half of its rate"
        )
    quality = math.sin(2.0 * math.pi * center_hz / rate_hz) / (2.0 * math.tan(math.pi * bandwidth_hz / rate_hz))
    return notch(center_hz, quality, rate_hz)


def _px4_integral(values: tuple[float, ...], rate_hz: float) -> KnownFilter:
    if not 1.0 <= values[0] < math.inf:
        raise UsageError(f"{values[0]:g} integrals per second came", needed="one or more")
    # A whole number of samples, the one nearest to the interval asked for.
    return integral_mean(max(round(rate_hz / values[0]), 1) / rate_hz, rate_hz)


def _loop_integral(values: tuple[float, ...], rate_hz: float) -> KnownFilter:
    return integral_mean(1.0 / values[0], rate_hz)


def _loop_mean(values: tuple[float, ...], rate_hz: float) -> KnownFilter:
    return moving_average(1.0 / values[0], rate_hz)


def _stage(names: str, build: Build, *, needed: bool = False) -> Stage:
    return Stage(names=tuple(names.split()), build=build, needed=needed)


_PX4_SLEW = ("MOT_SLEW_MAX", *(f"CA_R{index}_SLEW" for index in range(12)))
_PX4_GYRO_NOTCHES = (
    _stage("IMU_GYRO_NF0_FRQ IMU_GYRO_NF0_BW", _px4_notch),
    _stage("IMU_GYRO_NF1_FRQ IMU_GYRO_NF1_BW", _px4_notch),
    _stage("IMU_GYRO_NF_FREQ IMU_GYRO_NF_BW", _px4_notch),
)

CHAINS: Mapping[str, tuple[Chain, ...]] = {
    "PX4": (
        Chain(
            source=r"vehicle_angular_velocity\.xyz\[\d\]",
            stages=(_stage("IMU_GYRO_CUTOFF", _second_order, needed=True), *_PX4_GYRO_NOTCHES),
            moving=("IMU_GYRO_DNF_EN", "IMU_GYRO_DYN_NF"),
        ),
        Chain(
            source=r"vehicle_acceleration\.xyz\[\d\]",
            stages=(_stage("IMU_ACCEL_CUTOFF", _second_order, needed=True),),
        ),
        Chain(
            source=r"sensor_combined\.(gyro_rad|accelerometer_m_s2)\[\d\]",
            stages=(_stage("IMU_INTEG_RATE", _px4_integral, needed=True),),
        ),
        Chain(
            source=r"(vehicle_torque_setpoint|vehicle_thrust_setpoint|actuator_controls_0|actuator_motors)\..*",
            nonlinear=("THR_MDL_FAC", *_PX4_SLEW),
        ),
    ),
    "ArduPilot": (
        Chain(
            source=r"RATE\.(R|P|Y|Rll|Pit|Yaw)|IMU\.Gyr[XYZ]",
            stages=(_stage("INS_GYRO_FILTER", _second_order, needed=True),),
            notches=("INS_HNTCH", "INS_HNTC2", _SINGLE_NOTCH),
            sensor_rate_hz=_ARDUPILOT_SENSOR_HZ,
        ),
        Chain(
            source=r"IMU\.Acc[XYZ]",
            stages=(_stage("INS_ACCEL_FILTER", _second_order, needed=True),),
            sensor_rate_hz=_ARDUPILOT_SENSOR_HZ,
        ),
        Chain(
            source=r"SIDD\.G[xyz]",
            stages=(_stage("SCHED_LOOP_RATE", _loop_integral, needed=True),),
            sensor_rate_hz=_ARDUPILOT_SENSOR_HZ,
        ),
        Chain(
            source=r"SIDD\.A[xyz]",
            stages=(_stage("SCHED_LOOP_RATE", _loop_mean, needed=True),),
            sensor_rate_hz=_ARDUPILOT_SENSOR_HZ,
        ),
        Chain(
            source=r"RATE\.(\w*Out)|CTUN\.Th\w+|RCOU\.C\d+",
            nonlinear=("MOT_SLEW_UP_TIME", "MOT_SLEW_DN_TIME"),
        ),
    ),
}
"""Autopilot, as the format of the log begins, to the chains of its sources."""

_WORTH_SAYING_S = 5e-5
_GYRO_RATES = {0: 1.0, 1: 2.0, 2: 4.0, 3: 8.0}
_DEEPEST_NOTCH_DB = 120.0
_NARROWEST = 1e-5
"""Bandwidth over center below which a notch is none in single precision."""
_FIXED, _THROTTLE = 0.0, 1.0
_COMPOSITE = 1 | 2 | 16 | 64
"""Options of a harmonic notch that make several of one: double, one for each source, triple, quintuple."""


def known_filters(record: FlightRecord, source: str, *, sensor_rate_hz: float | None = None) -> tuple[KnownFilter, ...]:
    """Linear filters that a channel of a log has passed, as far as the log says.

    Empty where there are none and where none is known: :func:`filter_findings` tells these apart.

    Parameters
    ----------
    record
        With the autopilot's parameters.
    source
        Where the channel comes from: ``Channel.source``.
    sensor_rate_hz
        Samples per second of the sensor. When not given: for PX4, whose filters work on the raw samples of a fast
        sensor, 8 kHz; for ArduPilot 1 kHz, times what ``INS_GYRO_RATE`` says; for Betaflight the header says it.
        Simulators are slower, and a slow filter delays less: at 250 Hz a low-pass of 40 Hz delays 5.1 instead of
        5.6 ms.

    Raises
    ------
    UsageError
        ``sensor_rate_hz`` is not positive.

    Examples
    --------
    >>> from rotorid.data.record import Source
    >>> record = FlightRecord(
    ...     source=Source(name="log.ulg", format="PX4 ULog", sha256=""), topics=(),
    ...     parameters={"IMU_GYRO_CUTOFF": 40.0, "IMU_GYRO_NF0_FRQ": 0.0, "IMU_GYRO_NF0_BW": 20.0},
    ... )
    >>> [known.name for known in known_filters(record, "vehicle_angular_velocity.xyz[0]")]
    ['second-order low-pass at 40 Hz']
    """
    return _passage(record, source, sensor_rate_hz).filters


_CONTROLLERS_OWN = {"PX4": "vehicle_angular_velocity.xyz[0]", "ArduPilot": "RATE.R", _BETAFLIGHT: "gyroADC[0]"}
"""Autopilot to the source of the rate that its controller sees."""


def controller_filters(record: FlightRecord) -> tuple[KnownFilter, ...]:
    """Linear filters between the motion and the rate controller of the autopilot, as far as the log says.

    The rate passes them, the attitude does not: it comes from the unfiltered sensor.
    """
    own = [source for name, source in _CONTROLLERS_OWN.items() if record.source.format.startswith(name)]
    return known_filters(record, own[0]) if own else ()


def filter_findings(record: FlightRecord, source: str, *, sensor_rate_hz: float | None = None) -> tuple[Finding, ...]:
    """What is known of the filters in front of a channel, and what is not.

    Parameters
    ----------
    record, source, sensor_rate_hz
        As for :func:`known_filters`.

    Returns
    -------
    tuple of Finding
        ``known_filter`` with the delay at low frequency, and ``unknown_filter`` for every reason why the chain is not,
        or not wholly, known.

    Raises
    ------
    UsageError
        ``sensor_rate_hz`` is not positive.
    """
    passage = _passage(record, source, sensor_rate_hz)
    # Betaflight's header gives the rate.
    assumed = sensor_rate_hz is None and not record.source.format.startswith(_BETAFLIGHT)
    return (*_known(record, source, passage, assumed), *(_unknown(source, doubt) for doubt in passage.doubts))


def _passage(record: FlightRecord, source: str, sensor_rate_hz: float | None) -> Passage:
    if sensor_rate_hz is not None and not 0.0 < sensor_rate_hz < math.inf:
        raise UsageError(f"a sensor rate of {sensor_rate_hz:g} Hz came", needed="a positive rate")
    if record.source.format.startswith(_BETAFLIGHT):
        return betaflight_passage(record, source, sensor_rate_hz)
    chains = next((chains for name, chains in CHAINS.items() if record.source.format.startswith(name)), ())
    chain = next((chain for chain in chains if re.fullmatch(chain.source, source)), None)
    if chain is None:
        return doubtful("it is not known which filters it has passed")
    parameters = record.parameters
    rate_hz = sensor_rate_hz or chain.sensor_rate_hz * _oversampling(parameters)
    active = [f"{name} = {parameters[name]:g}" for name in chain.nonlinear if parameters.get(name, 0.0) > 0.0]
    return joined(
        (
            *(_built(stage, parameters, rate_hz) for stage in chain.stages),
            *(_harmonic_notches(prefix, parameters, rate_hz) for prefix in chain.notches),
            *(moving(name, parameters[name]) for name in chain.moving if parameters.get(name, 0.0) != 0.0),
            *([doubtful(f"what follows it is not linear ({', '.join(active)})")] if active else []),
        )
    )


def _oversampling(parameters: Parameters) -> float:
    """Factor by which ArduPilot reads the first sensor faster; other autopilots know no such parameter."""
    fast = int(parameters.get("INS_FAST_SAMPLE", 0.0)) & 1
    return _GYRO_RATES.get(int(parameters.get("INS_GYRO_RATE", 0.0)), 1.0) if fast else 1.0


def _built(stage: Stage, parameters: Parameters, rate_hz: float) -> Passage:
    missing = [name for name in stage.names if name not in parameters]
    if missing:
        return doubtful(f"the log does not carry {', '.join(missing)}") if stage.needed else Passage()
    values = tuple(parameters[name] for name in stage.names)
    if not values[0] > 0.0:
        return Passage()
    said = ", ".join(f"{name} = {parameters[name]:g}" for name in stage.names)
    return built(said, partial(stage.build, values, rate_hz))


def _harmonic_notches(prefix: str, parameters: Parameters, rate_hz: float) -> Passage:
    r"""ArduPilot's notches of constant frequency.

    .. math:: Q = \frac{\sqrt{2^b}}{2^b - 1}, \qquad b = 2 \log_2 \frac{f_0}{f_0 - B / 2}, \qquad
        d = 10^{-A / 20}

    with quality and depth of the base frequency for all harmonics, bandwidth :math:`B`, and attenuation :math:`A` in
    dB.
    """
    if parameters.get(f"{prefix}_ENABLE", 0.0) == 0.0:
        return Passage()
    harmonic = prefix != _SINGLE_NOTCH
    names = [f"{prefix}_{name}" for name in ("FREQ", "BW", "ATT")]
    also = [f"{prefix}_{name}" for name in ("HMNCS", "REF")] if harmonic else []
    missing = [name for name in (*names, *also) if name not in parameters]
    if missing:
        return doubtful(f"{prefix}_ENABLE is set, and the log does not carry {', '.join(missing)}")
    # A reference of zero keeps the notch where it is whatever the mode; the first firmware had no other mode.
    if harmonic and parameters.get(f"{prefix}_MODE", _THROTTLE) != _FIXED and parameters[f"{prefix}_REF"] != 0.0:
        return moving(f"{prefix}_REF", parameters[f"{prefix}_REF"])
    options = int(parameters.get(f"{prefix}_OPTS", 0.0))
    if options & _COMPOSITE:
        return doubtful(f"a composite notch is on ({prefix}_OPTS = {options}), which is not modeled")
    center_hz, bandwidth_hz, attenuation_db = (parameters[name] for name in names)
    said = ", ".join(f"{name} = {parameters[name]:g}" for name in names)
    if not (center_hz > 0.52 * bandwidth_hz > _NARROWEST * center_hz and 0.0 <= attenuation_db <= _DEEPEST_NOTCH_DB):
        return doubtful(f"{said} make no notch")
    octaves = 2.0 * math.log2(center_hz / (center_hz - 0.5 * bandwidth_hz))
    quality = math.sqrt(2.0**octaves) / (2.0**octaves - 1.0)
    floor = 10.0 ** (-attenuation_db / 20.0)
    harmonics = int(parameters.get(f"{prefix}_HMNCS", 1.0))
    centers = [center_hz * number for number in range(1, 17) if harmonics >> (number - 1) & 1]
    # The autopilot leaves out what would lie too near to half of its rate.
    kept = [center for center in centers if center < 0.48 * rate_hz]
    return joined(built(said, partial(notch, center, quality, rate_hz, floor=floor)) for center in kept)


def _known(record: FlightRecord, source: str, passage: Passage, assumed: bool) -> Iterator[Finding]:
    if not passage.filters:
        return
    delay_s = sum(known.delay_s for known in passage.filters)
    numbers = {"delay_s": delay_s, "rate_hz": min(known.rate_hz for known in passage.filters)}
    message = (
        f"{source} has passed {', '.join(known.name for known in passage.filters)}: {1e3 * delay_s:.2f} ms of delay at "
        "low frequency"
    )
    slow = _at_logged_rate(record, source) if assumed else None
    if slow is not None and abs(slow[1] - delay_s) > _WORTH_SAYING_S:
        rate_hz, slow_s = slow
        numbers |= {"logged_rate_hz": rate_hz, "delay_at_logged_rate_s": slow_s}
        message += (
            f", if the filters work at {numbers['rate_hz']:g} Hz, which the log does not say; at the rate of the log, "
            f"{rate_hz:.0f} Hz, it would be {1e3 * slow_s:.2f} ms"
        )
    yield remark("known_filter", source, message, **numbers)


def _at_logged_rate(record: FlightRecord, source: str) -> tuple[float, float] | None:
    """Rate of the topic, below which no filter works, and the delay of the same chain there."""
    rates = [topic.sample_rate_hz for topic in record.topics if any(c.source == source for c in topic.channels)]
    if not rates or not 0.0 < max(rates) < math.inf:
        return None
    slow = _passage(record, source, max(rates))
    return None if slow.doubts else (max(rates), sum(known.delay_s for known in slow.filters))


def _unknown(source: str, doubt: str) -> Finding:
    return warn("unknown_filter", source, f"the filters of {source} are not, or not wholly, known: {doubt}")


_GYRO = r"gyroADC\[\d\]"
_COMMANDS = r"motor mix|motor\[\d\]"
_VERSION = re.compile(r"Betaflight\D{0,40}(\d{1,4})\.(\d{1,4})")
_SPLIT = (4, 2)
"""From this version on the sensor is read at its own rate and filtered, but for low-pass 2, at that of the PID loop."""
_PT1, _BIQUAD = 0, 1
_CASCADES = {2: 2, 3: 3}
"""Type to order of the low-passes PT2 and PT3."""
_CASCADES_SINCE = (4, 3)
"""Before, these types meant other things."""
_DYNAMIC_FEATURE = 1 << 29
_LARGEST_DENOMINATOR = 255.0


class _LowPass(NamedTuple):
    """Names of the settings of a low-pass, newest first."""

    cutoff: tuple[str, ...]
    kind: tuple[str, ...]
    moving: tuple[str, ...]
    at_sensor_rate: bool


_LOW_PASSES = (
    _LowPass(
        ("gyro_lpf1_static_hz", "gyro_lowpass_hz"),
        ("gyro_lpf1_type", "gyro_lowpass_type", "gyro_soft_type"),
        ("gyro_lpf1_dyn_hz_0", "gyro_lowpass_dyn_hz_0"),
        at_sensor_rate=False,
    ),
    _LowPass(
        ("gyro_lpf2_static_hz", "gyro_lowpass2_hz"),
        ("gyro_lpf2_type", "gyro_lowpass2_type", "gyro_soft2_type"),
        (),
        at_sensor_rate=True,
    ),
)
_SPEED_NOTCHES = ("rpm_filter_harmonics", "gyro_rpm_notch_harmonics")


def betaflight_passage(record: FlightRecord, source: str, sensor_rate_hz: float | None) -> Passage:
    """What a channel of a blackbox log has passed.

    Parameters
    ----------
    record
        With the settings of the header as its parameters.
    source
        Field of the log.
    sensor_rate_hz
        In place of the one that the header gives.
    """
    settings = record.parameters
    if re.fullmatch(_COMMANDS, source):
        curved = settings.get("thrust_linear", 0.0) > 0.0
        return doubtful("a thrust curve (thrust_linear) stands in it") if curved else Passage()
    if not re.fullmatch(_GYRO, source):
        return doubtful("it is not known which filters it has passed")
    named = _VERSION.search(record.source.firmware)
    if named is None:
        return doubtful("the log names no version of Betaflight, without which its settings mean nothing")
    if not settings.get("looptime", 0.0) > 0.0:
        return doubtful("the log does not carry looptime, the period of the sensor")
    denominator = settings.get("pid_process_denom", 1.0)
    if not 1.0 <= denominator <= _LARGEST_DENOMINATOR:
        return doubtful(f"pid_process_denom = {denominator:g} cannot be")
    version = (int(named[1]), int(named[2]))
    sensor_hz = sensor_rate_hz or 1e6 / settings["looptime"]
    loop_hz = sensor_hz / denominator if version >= _SPLIT else sensor_hz
    return joined(
        (
            *(
                _betaflight_low_pass(row, settings, version, sensor_hz if row.at_sensor_rate else loop_hz)
                for row in _LOW_PASSES
            ),
            _decimation(settings, sensor_hz, loop_hz),
            *_notches(settings, loop_hz),
            *_moving_notches(settings),
        )
    )


def _betaflight_low_pass(
    row: _LowPass, settings: Mapping[str, float], version: tuple[int, int], rate_hz: float
) -> Passage:
    followed = _first(row.moving, settings)
    if followed is not None and settings[followed] > 0.0:
        return moving(followed, settings[followed])
    cutoff, kind = _first(row.cutoff, settings), _first(row.kind, settings)
    if cutoff is None:
        # Old firmware has no second low-pass; the first one was always there.
        return Passage() if row.at_sensor_rate else doubtful(f"the log does not carry {' or '.join(row.cutoff)}")
    # The firmware leaves out a low-pass beyond half of its rate.
    if not 0.0 < settings[cutoff] < 0.5 * rate_hz:
        return Passage()
    if kind is None:
        return doubtful(f"{cutoff} = {settings[cutoff]:g}, and the log does not carry {' or '.join(row.kind)}")
    code, said = int(settings[kind]), f"{cutoff} = {settings[cutoff]:g}"
    if code == _BIQUAD:
        return built(said, partial(butterworth_low_pass, settings[cutoff], rate_hz))
    if code == _PT1 or (code in _CASCADES and version >= _CASCADES_SINCE):
        return built(said, partial(cascaded_low_pass, _CASCADES.get(code, 1), settings[cutoff], rate_hz))
    return doubtful(f"a low-pass of a kind that is not modeled is on ({kind} = {code})")


def _decimation(settings: Mapping[str, float], sensor_hz: float, loop_hz: float) -> Passage:
    """Where no second low-pass stands before it, the loop takes the mean of the samples since the last one."""
    cutoff = _first(_LOW_PASSES[1].cutoff, settings)
    if loop_hz == sensor_hz or (cutoff is not None and settings[cutoff] > 0.0):
        return Passage()
    return Passage(filters=(moving_average(1.0 / loop_hz, sensor_hz),))


def _notches(settings: Mapping[str, float], rate_hz: float) -> Iterator[Passage]:
    r"""Notches from center :math:`f_0` and lower cutoff :math:`f_1`: :math:`Q = f_0 f_1 / (f_0^2 - f_1^2)`."""
    for index in range(2):
        names = (f"gyro_notch_hz_{index}", f"gyro_notch_cutoff_{index}")
        if not all(settings.get(name, 0.0) > 0.0 for name in names):
            continue
        center_hz, cutoff_hz = (settings[name] for name in names)
        said = " and ".join(f"{name} = {settings[name]:g}" for name in names)
        # Whole numbers of hertz: what is less is damage.
        if 1.0 <= cutoff_hz < center_hz < 0.5 * rate_hz:
            quality = center_hz * cutoff_hz / (center_hz**2 - cutoff_hz**2)
            yield built(said, partial(notch, center_hz, quality, rate_hz))
        else:
            yield doubtful(f"{said} make no notch at {rate_hz:g} Hz")


def _moving_notches(settings: Mapping[str, float]) -> Iterator[Passage]:
    if int(settings.get("features", 0.0)) & _DYNAMIC_FEATURE:
        yield moving("dynamic notch in features", settings["features"])
    # Without telemetry from the motors they have nothing to follow.
    if settings.get("dshot_bidir", 1.0) > 0.0:
        for name in _SPEED_NOTCHES:
            if settings.get(name, 0.0) > 0.0:
                yield moving(name, settings[name])


def _first(names: tuple[str, ...], settings: Mapping[str, float]) -> str | None:
    return next((name for name in names if name in settings), None)
