"""The writer of ArduPilot logs: a flight comes back through our reader and through pymavlink as it was flown."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rotorid.data.flight_plan import SimulatedFlight
from rotorid.data.record import AXES, FlightRecord, Kind, Maneuver, Topic
from rotorid.errors import UsageError
from rotorid.excitation.sweep import logarithmic_sweep
from rotorid.io.ardupilot.dataflash import decode
from rotorid.io.ardupilot.writer import Logged, lift_values, rate_values, waveform_settings, write_ardupilot
from rotorid.io.registry import read
from rotorid.reviewing.inspection import inspect
from rotorid.simulation.hover_flight import STEP_RATE_HZ, Excitation, fly
from rotorid.typing import Axis, FloatArray
from rotorid.vehicles import s500

LOOP_HZ = 400.0
START_S = 60.0
BAND_RAD_S = (2.0 * math.pi * 1.0, 2.0 * math.pi * 20.0)
SINGLE = float(np.finfo(np.float32).eps)
"""A single-precision number is known to half of this part of itself; conversion of units rounds once more."""

ANGLES = frozenset({"psi", "psi_setpoint"})
STEPS = {"RCOU": 1e-3, "RCIN": 2e-3, "XKF1": 0.0}
"""Message to the step of what it counts: microseconds of a pulse of 1000, or of 500 to either side."""


def sweep(axis: Axis, start_s: float, stop_s: float, **changes: Any) -> Maneuver:
    return replace(
        Maneuver(
            axis=axis,
            kind="sweep",
            start_s=start_s,
            stop_s=stop_s,
            band_rad_s=BAND_RAD_S,
            origin="declared",
            signal=f"{axis}_excitation",
        ),
        **changes,
    )


def chirp(duration_s: float, amplitude: float = 0.1) -> FloatArray:
    return logarithmic_sweep(
        amplitude=amplitude,
        band_rad_s=BAND_RAD_S,
        duration_s=duration_s,
        sample_rate_hz=LOOP_HZ,
        constant_s=1.0,
        fade_in_s=1.0,
        fade_out_s=0.5,
        trim_s=0.0,
    )


def flight(
    duration_s: float, maneuvers: tuple[Maneuver, ...] = (), parameters: dict[str, float] | None = None
) -> SimulatedFlight:
    """Noise of the right size in every column, and the chirps of the maneuvers."""
    rng = np.random.default_rng(8)
    time_s = np.arange(round(duration_s * LOOP_HZ)) / LOOP_HZ
    sizes = dict.fromkeys("p q r p_setpoint q_setpoint r_setpoint".split(), 0.5)  # noqa: SIM905
    sizes |= dict.fromkeys("phi theta phi_setpoint theta_setpoint".split(), 0.2)  # noqa: SIM905
    sizes |= dict.fromkeys("psi psi_setpoint".split(), 1.0)  # noqa: SIM905
    sizes |= dict.fromkeys("ax ay az velocity_north velocity_east velocity_down north east down".split(), 2.0)  # noqa: SIM905
    sizes |= {f"{axis}_command": 0.1 for axis in AXES} | {f"{axis}_stick": 0.3 for axis in AXES}
    columns = {name: size * rng.uniform(-1.0, 1.0, time_s.size) for name, size in sizes.items()}
    columns |= {f"motor_{number}": rng.uniform(0.0, 1.0, time_s.size) for number in range(1, 5)}
    columns["battery_voltage"] = np.linspace(12.6, 11.1, time_s.size)
    for axis in AXES:
        columns[f"{axis}_excitation"] = np.zeros(time_s.size)
    for maneuver in maneuvers:
        first = round(maneuver.start_s * LOOP_HZ)
        values = chirp(maneuver.duration_s)
        columns[f"{maneuver.axis}_excitation"][first : first + values.size] += values
    raw = {name: columns[name] + 0.1 * rng.standard_normal(time_s.size) for name in ("p", "q", "r", "ax", "ay", "az")}
    return SimulatedFlight(
        vehicle="demo",
        autopilot="ardupilot",
        sample_rate_hz=LOOP_HZ,
        time_s=time_s,
        columns=columns,
        raw=raw,
        maneuvers=maneuvers,
        parameters=parameters or {"MOT_THST_EXPO": 0.65, "INS_GYRO_FILTER": 20.0},
    )


RUNS = tuple(sweep(axis, 1.0 + 5.0 * place, 5.0 + 5.0 * place) for place, axis in enumerate(AXES))


@pytest.fixture(scope="module")
def flown() -> SimulatedFlight:
    return flight(22.0, RUNS)


@pytest.fixture(scope="module")
def written(flown: SimulatedFlight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "flight.BIN"
    write_ardupilot(path, flown, start_s=START_S)
    return path


@pytest.fixture(scope="module")
def record(written: Path) -> FlightRecord:
    return read(written)


def samples_of(topic: Topic, flown: SimulatedFlight) -> Any:
    """Samples of the flight that a topic holds; every stamp is within half a microsecond of one."""
    samples = np.rint((topic.time_s - START_S) * LOOP_HZ).astype(np.int64)
    assert np.abs(topic.time_s - START_S - flown.time_s[samples]).max() < 0.5e-6
    return samples


def one_loop_earlier(values: FloatArray) -> FloatArray:
    """A test signal as the firmware logs it: one loop before the mixer receives it."""
    return np.append(values[1:], 0.0)


def test_every_channel_comes_back_to_the_rounding_of_its_field(record: FlightRecord, flown: SimulatedFlight) -> None:
    seen = set()
    for topic in record.topics:
        source = {**flown.columns, **flown.raw} if topic.name.startswith("SIDD") else flown.columns
        for channel, values in zip(topic.channels, topic.values, strict=True):
            if channel.name in ("hover_thrust", "battery_current"):
                # Constants of the writer; the flight has no such channels.
                continue
            seen.add(channel.name)
            expected = source[channel.name][samples_of(topic, flown)]
            if channel.name.endswith("_excitation"):
                expected = one_loop_earlier(expected)
            error = values - expected
            if channel.name in ANGLES:
                error = np.remainder(error + math.pi, 2.0 * math.pi) - math.pi
            # A heading is stored as up to 360 degrees, whatever its size.
            size = 2.0 * math.pi if channel.name in ANGLES else np.abs(expected).max()
            assert np.abs(error).max() <= SINGLE * size + 0.5 * STEPS.get(topic.name, 0.0) + 1e-12, channel
    assert seen == set(flown.columns)


def test_fast_messages_hold_every_turn_of_the_loop_and_slow_ones_their_own_rate(record: FlightRecord) -> None:
    rates = {topic.name: round(topic.sample_rate_hz, 6) for topic in record.topics}

    assert {rates[name] for name in ("RATE", "IMU", "ANG", "SIDD run 1", "SIDD run 4")} == {400.0}
    assert rates["XKF1"] == 25.0
    assert {rates[name] for name in ("ATT", "CTUN", "BAT", "RCIN", "RCOU")} == {10.0}


def test_pymavlink_reads_every_value_that_we_read(written: Path) -> None:
    reader = pytest.importorskip("pymavlink.DFReader")
    log = reader.DFReader_binary(str(written))
    theirs: dict[str, dict[str, list[Any]]] = defaultdict(lambda: defaultdict(list))
    while (message := log.recv_msg()) is not None:
        for name in message.get_fieldnames():
            theirs[message.get_type()][name].append(getattr(message, name))
    ours = decode(written.read_bytes()).tables

    assert set(theirs) == set(ours)
    for kind, table in ours.items():
        assert set(table.columns) == set(theirs[kind])
        for name, values in theirs[kind].items():
            column = table.column(name)
            assert np.array_equal(column, np.array(values), equal_nan=column.dtype.kind == "f"), (kind, name)
    units = {
        layout.name: dict(zip(layout.columns, layout.units or (), strict=False)) for layout in log.formats.values()
    }
    log.close()
    assert all({key: unit for key, unit in units[kind].items() if unit} == dict(ours[kind].units) for kind in units)


def test_sweeps_come_back_as_declared_maneuvers(record: FlightRecord) -> None:
    assert [one.axis for one in record.declared] == list(AXES)
    for one, planned in zip(record.declared, RUNS, strict=True):
        assert (one.kind, one.signal, one.origin) == (planned.kind, planned.signal, "declared")
        # A stamp is a whole microsecond.
        assert one.start_s == pytest.approx(START_S + planned.start_s, abs=1e-6)
        assert one.stop_s == pytest.approx(START_S + planned.stop_s, abs=1e-6)
        assert one.band_rad_s == pytest.approx(BAND_RAD_S, rel=SINGLE)
    assert {axis: names[0] for axis, names in record.instruments.items()} == {
        axis: f"{axis}_excitation" for axis in AXES
    }


def test_settings_of_a_run_are_those_of_its_waveform(written: Path) -> None:
    settings = decode(written.read_bytes(), ("SIDS",)).tables["SIDS"]

    assert settings.column("Ax").tolist() == [10, 11, 12, 13]
    read_off = {name: settings.column(name).astype(float) for name in ("FSt", "FSp", "TR")}
    assert np.allclose(read_off["FSt"], 1.0, rtol=SINGLE)
    assert np.allclose(read_off["FSp"], 20.0, rtol=SINGLE)
    assert np.allclose(read_off["TR"], 4.0, rtol=SINGLE)


@pytest.mark.parametrize(
    ("low_hz", "high_hz", "duration_s", "constant_s", "fade_in_s", "fade_out_s"),
    [(0.1, 20.0, 90.0, 20.0, 15.0, 2.0), (0.2, 15.0, 60.0, 10.0, 5.0, 2.0), (0.5, 10.0, 60.0, 0.0, 8.0, 0.0)],
)
def test_times_of_a_chirp_are_read_off_its_half_waves(
    low_hz: float, high_hz: float, duration_s: float, constant_s: float, fade_in_s: float, fade_out_s: float
) -> None:
    values = logarithmic_sweep(
        amplitude=0.15,
        band_rad_s=(2.0 * math.pi * low_hz, 2.0 * math.pi * high_hz),
        duration_s=duration_s,
        sample_rate_hz=LOOP_HZ,
        constant_s=constant_s,
        fade_in_s=fade_in_s,
        fade_out_s=fade_out_s,
        trim_s=0.0,
    )

    magnitude, fade_in, constant, fade_out = waveform_settings(values, np.arange(values.size) / LOOP_HZ, low_hz)

    assert magnitude == pytest.approx(0.15, rel=1e-3)
    # Crossings are known to one sample, and so is the middle of the median half wave; it divides by about one half. Of
    # a chirp without a fade the last half wave is cut off.
    assert fade_in == pytest.approx(fade_in_s, abs=2.0 / LOOP_HZ)
    assert fade_out == pytest.approx(fade_out_s, abs=2.0 / LOOP_HZ if fade_out_s else 0.5 / high_hz)
    assert constant == pytest.approx(constant_s, abs=1.5 / LOOP_HZ)


def test_modes_say_when_a_sweep_was_injected(written: Path) -> None:
    modes = decode(written.read_bytes(), ("MODE",)).tables["MODE"]

    assert modes.column("Mode").tolist() == [0] + [25, 0] * 4
    stamps_us = modes.column("TimeUS").astype(int).tolist()
    assert stamps_us[1:3] == [61_000_000, 65_002_500]


def test_a_pilot_without_a_throttle_stick_holds_the_altitude(tmp_path: Path, flown: SimulatedFlight) -> None:
    columns = {name: values for name, values in flown.columns.items() if not name.endswith("_stick")}
    write_ardupilot(tmp_path / "log.bin", replace(flown, columns=columns))
    tables = decode((tmp_path / "log.bin").read_bytes()).tables

    assert tables["MODE"].column("Mode").tolist() == [2] + [25, 2] * 4
    assert "RCIN" not in tables


def test_parameters_are_those_of_the_flight_and_what_the_log_needs(record: FlightRecord) -> None:
    assert record.parameters["INS_GYRO_FILTER"] == 20.0
    assert record.parameters["MOT_THST_EXPO"] == pytest.approx(0.65, rel=SINGLE)
    assert record.parameters["SCHED_LOOP_RATE"] == LOOP_HZ
    assert record.parameters["SID_AXIS"] == 13.0
    assert int(record.parameters["LOG_BITMASK"]) & 1
    assert record.parameters["SERVO4_FUNCTION"] == 36.0
    assert record.source.firmware.startswith("ArduCopter V4.5")


def test_parameters_of_the_flight_stand_above_the_usual_ones(tmp_path: Path, flown: SimulatedFlight) -> None:
    given = {
        "MOT_PWM_MIN": 1100.0,
        "MOT_PWM_MAX": 1900.0,
        "LOG_BITMASK": 5.0,
        **{f"SERVO{channel}_FUNCTION": 33.0 + motor for motor, channel in enumerate((5, 6, 7, 8))},
        "RCMAP_ROLL": 2.0,
        "RCMAP_PITCH": 1.0,
        "RC2_MIN": 982.0,
        "RC2_MAX": 2006.0,
        "RC2_TRIM": 1494.0,
        "RC2_REVERSED": 1.0,
    }
    write_ardupilot(tmp_path / "log.bin", replace(flown, parameters=given), start_s=START_S)
    outputs = decode((tmp_path / "log.bin").read_bytes(), ("RCOU",)).tables["RCOU"]
    back = read(tmp_path / "log.bin")

    assert back.parameters["LOG_BITMASK"] == 5.0
    assert not outputs.column("C1").any()
    for name, step in (("motor_1", 1.0 / 800.0), ("roll_stick", 2.0 / 1024.0), ("pitch_stick", 2e-3)):
        topic, row = next(back.holding(name))
        error = topic.values[row] - flown.columns[name][samples_of(topic, flown)]
        assert np.abs(error).max() <= 0.5 * step + 1e-9, name


def test_an_entry_that_the_parameters_name_is_kept_with_its_unit(tmp_path: Path) -> None:
    flown = flight(6.0, (sweep("pitch", 1.0, 5.0),), {"SID_AXIS": 8.0})
    write_ardupilot(tmp_path / "log.bin", flown, start_s=START_S)
    tables = decode((tmp_path / "log.bin").read_bytes()).tables
    topic, row = next(read(tmp_path / "log.bin").holding("pitch_excitation"))

    assert tables["SIDS"].column("Ax").tolist() == [8]
    # The entry takes degrees per second.
    assert np.abs(tables["SIDD"].column("Targ")).max() == pytest.approx(math.degrees(0.1), rel=1e-3)
    planned = flown.columns["pitch_excitation"][samples_of(topic, flown)]
    assert np.allclose(topic.values[row], one_loop_earlier(planned), atol=0.1 * SINGLE)


@pytest.mark.parametrize("kind", ["doublet", "multistep", "random_binary", "other"])
def test_what_the_mode_cannot_inject_is_not_declared(kind: Kind, tmp_path: Path) -> None:
    flown = flight(6.0, (sweep("roll", 1.0, 5.0, kind=kind),))
    write_ardupilot(tmp_path / "log.bin", flown)
    back = read(tmp_path / "log.bin")

    assert back.declared == ()
    assert not {"SIDD", "SIDS"} & set(decode((tmp_path / "log.bin").read_bytes()).tables)
    assert next(back.holding("roll_command"))


def test_sweeps_one_right_after_the_other_are_two_runs(tmp_path: Path) -> None:
    flown = flight(10.0, (sweep("roll", 1.0, 5.0), sweep("pitch", 5.0, 9.0)))
    write_ardupilot(tmp_path / "log.bin", flown)
    back = read(tmp_path / "log.bin")

    assert [(one.axis, round(one.start_s, 6), round(one.stop_s, 6)) for one in back.declared] == [
        ("roll", 61.0, 64.9975),
        ("pitch", 65.0, 69.0),
    ]


def test_sweeps_at_the_same_time_are_refused(tmp_path: Path) -> None:
    flown = flight(10.0, (sweep("roll", 1.0, 5.0), sweep("pitch", 4.0, 8.0)))

    with pytest.raises(UsageError, match=r"roll until 5 s and of pitch from 4 s on overlap"):
        write_ardupilot(tmp_path / "log.bin", flown)
    assert not list(tmp_path.iterdir())


def test_slower_messages_keep_the_stamps_of_rates_and_injection_together(
    tmp_path: Path, flown: SimulatedFlight
) -> None:
    write_ardupilot(tmp_path / "log.bin", flown, rates_hz={"RATE": 150.0, "SIDD": 150.0, "BAT": 1.0})
    tables = decode((tmp_path / "log.bin").read_bytes()).tables
    rate, injected = (set(tables[name].column("TimeUS").tolist()) for name in ("RATE", "SIDD"))

    assert injected < rate
    assert len(tables["RATE"]) == 22 * 150
    assert len(tables["BAT"]) == 22


@pytest.mark.parametrize(
    ("rates_hz", "said"),
    [
        ({"RATES": 100.0}, "did you mean RATE"),
        ({"RATE": 401.0}, "at most the loop's 400"),
        ({"IMU": 0.0}, "more than zero"),
        ({"IMU": math.nan}, "more than zero"),
    ],
)
def test_impossible_rates_are_refused(
    rates_hz: dict[str, float], said: str, flown: SimulatedFlight, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match=said):
        write_ardupilot(tmp_path / "log.bin", flown, rates_hz=rates_hz)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
@pytest.mark.parametrize(("where", "name"), [("columns", "theta"), ("columns", "motor_3"), ("raw", "az")])
def test_a_flight_that_diverged_is_refused_and_nothing_is_written(
    where: str, name: str, bad: float, flown: SimulatedFlight, tmp_path: Path
) -> None:
    values = getattr(flown, where)[name].copy()
    values[800:] = bad
    broken = replace(flown, **{where: {**getattr(flown, where), name: values}})  # type: ignore[arg-type]
    path = tmp_path / "log.bin"
    path.write_bytes(b"before")

    with pytest.raises(UsageError, match=rf"{name} of the flight's {where} is not finite .* the first at 2 s"):
        write_ardupilot(path, broken)

    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]


def test_values_beyond_their_fields_are_refused(flown: SimulatedFlight, tmp_path: Path) -> None:
    wild = {**flown.columns, "motor_2": np.full(flown.samples, 100.0)}

    with pytest.raises(UsageError, match=r"RCOU\.C2 reaches"):
        write_ardupilot(tmp_path / "log.bin", replace(flown, columns=wild))
    with pytest.raises(UsageError, match="no samples"):
        write_ardupilot(
            tmp_path / "log.bin",
            SimulatedFlight(vehicle="none", autopilot="ardupilot", sample_rate_hz=1.0, time_s=[], columns={}),
        )
    assert not list(tmp_path.iterdir())


def test_motors_beyond_what_the_autopilot_numbers_are_refused(flown: SimulatedFlight, tmp_path: Path) -> None:
    many = {**flown.columns, **{f"motor_{number}": np.zeros(flown.samples) for number in range(1, 14)}}

    with pytest.raises(UsageError, match="13 motors"):
        write_ardupilot(tmp_path / "log.bin", replace(flown, columns=many))


def test_messages_need_their_columns(flown: SimulatedFlight, tmp_path: Path) -> None:
    few = {name: flown.columns[name] for name in ("p", "q", "r", "ax", "ay", "az")}
    write_ardupilot(tmp_path / "log.bin", replace(flown, columns=few, maneuvers=()))
    tables = decode((tmp_path / "log.bin").read_bytes()).tables

    assert set(tables) == {"FMT", "UNIT", "MULT", "FMTU", "PARM", "MSG", "ARM", "EV", "MODE", "IMU"}


def test_equal_flights_give_equal_bytes(flown: SimulatedFlight, written: Path, tmp_path: Path) -> None:
    write_ardupilot(tmp_path / "again.BIN", flight(22.0, RUNS), start_s=START_S)

    assert (tmp_path / "again.BIN").read_bytes() == written.read_bytes()


def test_eight_minutes_are_written(tmp_path: Path) -> None:
    flown = flight(
        480.0, tuple(sweep(axis, 10.0 + 100.0 * place, 100.0 + 100.0 * place) for place, axis in enumerate(AXES))
    )

    write_ardupilot(tmp_path / "long.BIN", flown)

    assert len(decode((tmp_path / "long.BIN").read_bytes(), ("RATE",)).tables["RATE"]) == 192_000


def test_climb_and_lift_are_reckoned_as_the_firmware_does(unpacked: Callable[[str], Path]) -> None:
    """``RATE.A`` and ``MOTB.LiftMax`` of a real flight stack, from its own accelerations, attitude and voltage."""
    tables = decode(
        unpacked("ardupilot_sitl/x_calm_roll.BIN").read_bytes(), ("RATE", "IMU", "ANG", "XKF2", "MOTB")
    ).tables
    rate, imu, angles, estimate, lift = (tables[name].read() for name in ("RATE", "IMU", "ANG", "XKF2", "MOTB"))
    stamps = np.intersect1d(np.intersect1d(rate["TimeUS"], imu["TimeUS"]), angles["TimeUS"])
    rows = {id(table): np.isin(table["TimeUS"], stamps) for table in (rate, imu, angles)}
    held = {f"a{axis}": imu[f"Acc{axis.upper()}"][rows[id(imu)]] for axis in "xyz"}
    held |= {
        name: np.radians(angles[column][rows[id(angles)]], dtype=np.float64)
        for name, column in (("phi", "Roll"), ("theta", "Pitch"))
    }
    ours = rate_values(logged_of(held))["A"]

    # The firmware takes off the bias that its estimator has found, which the log holds in steps of 0.01 m/s².
    bias = np.interp(stamps.astype(float), estimate["TimeUS"].astype(float), estimate["AZ"])
    error = np.asarray(ours) + 100.0 * bias - rate["A"][rows[id(rate)]]
    assert np.abs(error).max() <= 0.5

    part = lift["BatVolt"].astype(np.float64)
    volts = logged_of({"battery_voltage": 12.8 * part}, {"MOT_BAT_VOLT_MAX": 12.8, "MOT_BAT_VOLT_MIN": 9.6})
    assert np.allclose(lift_values(volts)["LiftMax"], lift["LiftMax"], atol=4.0 * SINGLE)


def logged_of(columns: dict[str, Any], parameters: dict[str, float] | None = None) -> Logged:
    count = next(iter(columns.values())).size
    flown = SimulatedFlight(
        vehicle="sitl",
        autopilot="ardupilot",
        sample_rate_hz=LOOP_HZ,
        time_s=np.arange(count) / LOOP_HZ,
        columns=columns,
    )
    return Logged(flight=flown, samples=np.arange(count), parameters=parameters or {})


def test_a_closed_loop_flight_is_inspected_like_a_log_of_the_mode(tmp_path: Path) -> None:
    maneuver = sweep("roll", 3.0, 33.0, band_rad_s=(2.0 * math.pi * 0.3, 2.0 * math.pi * 8.0))
    values = logarithmic_sweep(
        amplitude=0.04,
        band_rad_s=(2.0 * math.pi * 0.3, 2.0 * math.pi * 8.0),
        duration_s=30.0,
        sample_rate_hz=STEP_RATE_HZ,
        trim_s=0.0,
    )
    plan = (Excitation(maneuver=maneuver, values=values, sample_rate_hz=STEP_RATE_HZ),)
    flew = fly(s500.vehicle(), plan, sample_rate_hz=200.0, rng=np.random.default_rng(3))
    flown = SimulatedFlight(
        vehicle=flew.vehicle,
        autopilot="ardupilot",
        sample_rate_hz=flew.sample_rate_hz,
        time_s=flew.time_s,
        columns=flew.columns,
        # Of the rates the mode logs means over one turn of the loop.
        raw={name: 0.5 * (flew.columns[name] + np.roll(flew.columns[name], 1)) for name in ("p", "q", "r")},
        maneuvers=flew.maneuvers,
        parameters={"INS_GYRO_FILTER": 0.0, "INS_ACCEL_FILTER": 0.0},
    )
    write_ardupilot(tmp_path / "s500.BIN", flown, start_s=START_S)
    document = inspect(read(tmp_path / "s500.BIN"))

    assert [(one.axis, one.origin, one.signal) for one in document.excitations] == [
        ("roll", "declared", "roll_excitation")
    ]
    assert document.supports["rate.roll"].possible
    assert "joint estimate with roll_excitation" in document.supports["rate.roll"].because
    assert "SID_AXIS 11" in document.supports["rate.pitch"].remedy
    assert document.settings["SID_AXIS"] == 10.0
    assert {one.severity for one in document.findings} == {"info"}
    # The reader takes those means for what they are. A turn of the loop is 5 ms, and a mean of two samples lags by half
    # of it; a straight line between samples is not quite the motion.
    skews = [one for one in document.skews if one.channel == "p" and one.reference == "SIDD run 1"]
    assert {one.delayed for one in skews} == {"RATE", "IMU"}
    assert all(one.seconds == pytest.approx(one.known_s[0], abs=1e-4) for one in skews)
