from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit.report.lua_autopilot import Autopilot
from tests.unit.report.plan_sample import (
    by_hand,
    chirp,
    facts,
    four_chirps,
    step,
    sweeps_then_doublets,
)

from rotorid.autopilots.ardupilot.system_id import SID_AXIS
from rotorid.data.flight_plan import Entry, FlightPlan, PlannedInput
from rotorid.errors import UsageError
from rotorid.io.ardupilot.dataflash import decode
from rotorid.io.ardupilot.system_id import ENTRIES
from rotorid.plans.ardupilot import SYSTEM_ID_DELAY_S, SystemId, ardupilot_files, log_bitmask, system_id
from rotorid.typing import Axis
from rotorid.units import parse_unit

SINGLE = 2.0**-24
"""Relative rounding of the single precision in which the autopilot keeps its parameters."""


def parameters(text: str, folder: Path) -> dict[str, float]:
    """A parameter file as pymavlink, and with it MAVProxy, loads it; it keeps single precision."""
    from pymavlink.mavparm import MAVParmDict

    path = folder / "file.param"
    path.write_text(text)
    loaded = MAVParmDict()
    assert loaded.load(str(path), use_excludes=False)
    return {name: float(np.float32(value)) for name, value in loaded.items()}


def settings_of(loaded: dict[str, float]) -> SystemId:
    return SystemId(
        axis=int(loaded["SID_AXIS"]),
        magnitude=loaded["SID_MAGNITUDE"],
        start_hz=loaded["SID_F_START_HZ"],
        stop_hz=loaded["SID_F_STOP_HZ"],
        fade_in_s=loaded["SID_T_FADE_IN"],
        record_s=loaded["SID_T_REC"],
        fade_out_s=loaded["SID_T_FADE_OUT"],
    )


def total_phase(settings: SystemId) -> float:
    rise = math.log(settings.stop_hz / settings.start_hz)
    swept_s = settings.record_s - settings.constant_s
    return 2.0 * math.pi * settings.start_hz * swept_s / rise * math.expm1(rise)


@pytest.mark.parametrize(
    ("planned", "entry"),
    [
        (chirp("roll"), 10),
        (chirp("pitch", amplitude=0.08, band_hz=(0.2, 15.0), duration_s=60.0, trim_s=3.0), 11),
        (chirp("yaw", amplitude=0.3, fade_in_s=0.0, fade_out_s=0.0), 12),
        (chirp("thrust", amplitude=0.08, band_hz=(1.0 / 3.0, 10.0)), 13),
        (chirp("roll", entry="rate_setpoint", amplitude=math.radians(40.0)), 7),
        (chirp("yaw", entry="rate_setpoint", amplitude=math.radians(30.0)), 9),
        (chirp("pitch", entry="attitude_setpoint", amplitude=math.radians(5.0)), 2),
    ],
    ids=lambda value: str(value) if isinstance(value, int) else "",
)
def test_the_file_makes_the_samples_of_the_plan(planned: PlannedInput, entry: int, tmp_path: Path) -> None:
    """Read back with the autopilot's precision and put through its chirp, in the unit of its injection point."""
    files = ardupilot_files(FlightPlan(name="one", inputs=(planned,)), facts())
    loaded = parameters(files[f"ardupilot-1-{planned.axis}.param"], tmp_path)
    assert loaded["SID_AXIS"] == entry
    # The reader of logs knows which axis and unit an entry has; a file that we write must mean the same.
    axis, unit = ENTRIES[entry]
    assert axis == planned.axis
    settings = settings_of(loaded)
    time_s = np.arange(planned.values.size) / planned.sample_rate_hz
    time_s -= 0.5 * (planned.values.size / planned.sample_rate_hz - settings.record_s)
    flown = parse_unit(unit).factor * settings.waveform(time_s)
    # Start, stop and length of the sweep are rounded; each moves the phase by no more than its share of the total.
    allowed = planned.amplitude * (6.0 * SINGLE * total_phase(settings) + 2.0 * SINGLE)
    assert np.abs(flown - planned.values).max() <= allowed


@pytest.mark.parametrize("trim_s", [0.0, 2.5])
def test_zeros_around_a_chirp_are_found_or_taken_from_its_settings(trim_s: float) -> None:
    fades = {"fade_in_s": 5.0, "fade_out_s": 2.0}
    told = chirp("roll", trim_s=trim_s, settings=fades | {"trim_s": trim_s})
    found = chirp("roll", trim_s=trim_s, settings=fades)
    assert system_id(told) == system_id(found)
    assert system_id(told).record_s == pytest.approx(90.0, abs=1e-9)


def test_the_waveform_is_that_of_real_firmware(unpacked: Callable[[str], Path]) -> None:
    """Settings from a planned sweep against ``SIDD.Targ`` of ArduPilot's own simulation."""
    tables = decode(unpacked("ardupilot_sitl/x_calm_roll.BIN").read_bytes(), ["SIDD"]).tables
    time_s, target = (np.asarray(column, np.float64) for column in tables["SIDD"].read("Time", "Targ").values())
    second = int(np.flatnonzero(np.diff(time_s) < 0.0)[0]) + 1
    runs = [
        (slice(0, second), chirp("roll")),
        (slice(second, None), chirp("roll", amplitude=0.08, band_hz=(0.2, 15.0), duration_s=60.0)),
    ]
    for run, planned in runs:
        settings = system_id(planned)
        flown = settings.waveform(time_s[run] - SYSTEM_ID_DELAY_S)
        # The firmware's clock and phase are single precision: half a step of each, and some operations on the phase.
        clock = 2.0 * math.pi * settings.stop_hz * np.spacing(np.float32(time_s[run].max()))
        allowed = settings.magnitude * (clock + 4.0 * SINGLE * total_phase(settings))
        assert np.abs(flown - target[run]).max() <= allowed
        assert np.abs(target[run]).max() > 0.9 * settings.magnitude


def test_a_plan_that_was_stored_is_flown_as_well(tmp_path: Path) -> None:
    """Stored samples keep nine decimals, so that the first ones of a fade are lost; doublets are the pilot's."""
    plan = sweeps_then_doublets()
    stored = FlightPlan(
        name=plan.name, inputs=tuple(replace(one, values=np.round(one.values, 9)) for one in plan.inputs)
    )
    files = ardupilot_files(stored, facts())
    assert files == ardupilot_files(plan, facts())
    assert sum(name.endswith(".param") for name in files) == 5
    loaded = parameters(files["ardupilot-4-thrust.param"], tmp_path)
    assert (loaded["SID_AXIS"], loaded["SID_T_REC"]) == (13.0, 60.0)
    assert int(loaded["LOG_BITMASK"]) >> 18 & 1  # doublets are flown outside of the mode that logs its own IMU
    script = Autopilot(files["sweeps-then-doublets-chirps.lua"])
    script.state.mode = STABILIZE
    script.run(3.0)
    script.state.switch = 2
    script.run(300.0)
    assert script.texts()[-1] == "rotorid: plan complete"


def test_every_run_has_its_file_and_all_log_every_loop(tmp_path: Path) -> None:
    files = ardupilot_files(four_chirps(), facts())
    runs = sorted(name for name in files if name[10].isdigit())
    assert runs == [f"ardupilot-{n}-{axis}.param" for n, axis in enumerate(("roll", "pitch", "yaw", "thrust"), start=1)]
    for name in runs:
        loaded = parameters(files[name], tmp_path)
        assert int(loaded["LOG_BITMASK"]) & 0b11 == 0b11
    after = parameters(files["ardupilot-after.param"], tmp_path)
    assert after["SID_AXIS"] == 0.0
    assert not any("FLTMODE6," in text for text in files.values())


def test_the_masks_are_the_default_and_named_bits() -> None:
    default = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 13, 15, 17}
    bits = {fast: {bit for bit in range(24) if log_bitmask(fast_imu=fast) >> bit & 1} for fast in (False, True)}
    assert bits == {False: default | {0}, True: default | {0, 18}}


def test_no_name_can_add_a_parameter(tmp_path: Path) -> None:
    plan = FlightPlan(name="x\nARMING_CHECK,0\n", inputs=(chirp("roll"),))
    files = ardupilot_files(plan, facts(vehicle="quad\r\nFS_THR_ENABLE,0\n]]--\nos.exit()"))
    for name, text in files.items():
        if name.endswith(".param"):
            assert not {"ARMING_CHECK", "FS_THR_ENABLE"} & set(parameters(text, tmp_path))
        else:
            assert not any(line.startswith("os.exit") for line in text.splitlines())


@pytest.mark.parametrize(
    ("inputs", "words"),
    [
        ((step("roll"),), "attitude set-points of roll, pitch and yaw"),
        ((chirp("roll", constant_s=0.0),), "two cycles at constant frequency"),
        ((chirp("roll", settings={}),), "two cycles at constant frequency"),
        ((chirp("yaw", entry="attitude_setpoint"),), "one of attitude setpoint of roll"),
        ((by_hand("roll"),), "no files for test inputs at the sticks"),
        ((chirp("roll"), chirp("pitch", start_s=80.0)), "one sweep after the other"),
        ((chirp("roll", duration_s=300.0),), "SID_T_REC would be 300"),
        ((chirp("roll", fade_in_s=25.0),), "SID_T_FADE_IN would be 25"),
        ((chirp("roll", band_hz=(0.1, 150.0)),), "SID_F_STOP_HZ would be 150"),
        ((step("thrust", entry="attitude_setpoint"),), "on thrust"),
    ],
)
def test_what_it_cannot_fly_is_refused(inputs: tuple[PlannedInput, ...], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        ardupilot_files(FlightPlan(name="no", inputs=inputs), facts())


# The Lua script that flies all chirps.

STABILIZE, ALT_HOLD, LOITER, SYSTEMID = 0, 2, 5, 25
VERSIONS = (45, 46, 47)


def chirp_script(plan: FlightPlan | None = None, *, version: int = 47) -> Autopilot:
    """The script of a plan in a vehicle that hovers in Stabilize, with its switch turned on."""
    plan = plan or four_chirps()
    name = "hover-four-axes-chirps.lua" if plan.name.startswith("Hover") else f"{plan.name}-chirps.lua"
    autopilot = Autopilot(ardupilot_files(plan, facts())[name])
    autopilot.state.mode, autopilot.state.version = STABILIZE, version
    autopilot.run(3.0)
    autopilot.state.switch = 2
    return autopilot


@pytest.mark.parametrize("version", VERSIONS)
def test_the_script_flies_every_chirp_with_its_settings(version: int) -> None:
    autopilot = chirp_script(version=version)
    autopilot.run(400.0)
    events = autopilot.events()
    modes = [(now, value) for now, name, value in events if name == "mode"]
    assert [mode for _, mode in modes] == [SYSTEMID, STABILIZE] * 4
    for (begin, _), (end, _), planned in zip(modes[::2], modes[1::2], four_chirps().inputs, strict=True):
        settings = {name: value for now, name, value in events if name != "mode" and now == begin}
        assert settings == pytest.approx(system_id(planned).parameters, rel=1e-8)
        # In the mode for its second of waiting, the chirp, and no more than a moment.
        assert 0.0 < (end - begin) / 1000.0 - SYSTEM_ID_DELAY_S - 90.0 < 1.0
    assert autopilot.texts()[-1] == "rotorid: plan complete"
    assert not any("ARM" in name for _, name, _ in events)


@pytest.mark.parametrize(
    ("change", "reason", "mode"),
    [
        ({"mode": LOITER}, "the pilot took over", LOITER),
        ({"mode": STABILIZE}, "the pilot took over", STABILIZE),
        ({"switch": 0}, "switched off", STABILIZE),
        ({"armed": False}, "disarmed", STABILIZE),
        ({"position": (9.0, 9.0, -20.0)}, "out of the room", LOITER),
        ({"position": (0.0, 0.0, -30.0)}, "height", LOITER),
        ({"position": (math.nan, 0.0, -20.0)}, "out of the room", LOITER),
        ({"position": None}, "no position", STABILIZE),
        ({"position": (9.0, 9.0, -20.0), "refuse_mode": LOITER}, "out of the room", STABILIZE),
    ],
)
def test_the_script_ends_at_once_and_for_good(change: dict[str, Any], reason: str, mode: int) -> None:
    autopilot = chirp_script()
    autopilot.run(120.0)  # in the second chirp
    assert autopilot.state.mode == SYSTEMID
    for name, value in change.items():
        autopilot.state[name] = autopilot.lua.table(*value) if isinstance(value, tuple) else value
    before = len(autopilot.events())
    autopilot.run(0.2)
    assert autopilot.texts()[-1] == f"rotorid: {reason}"
    assert autopilot.state.mode == mode
    autopilot.run(300.0)
    # What it did after the change is to leave the mode, and nothing else.
    assert [name for _, name, _ in autopilot.events()[before:]] in ([], ["mode"])


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"flying": False}, "not flying"),
        ({"armed": False}, "not flying"),
        ({"mode": LOITER}, "begin in STABILIZE"),
        ({"mode": ALT_HOLD}, "begin in STABILIZE"),
        ({"position": None}, "no position"),
        ({"home_down": -15.0}, "begin above 10 m"),
        ({"refuse_mode": SYSTEMID}, "SYSTEMID mode was refused"),
        ({"refuse_parameter": "SID_T_REC"}, "cannot set SID_T_REC"),
    ],
)
def test_the_script_does_not_begin_where_it_should_not(change: dict[str, Any], reason: str) -> None:
    autopilot = chirp_script()
    for name, value in change.items():
        autopilot.state[name] = value
    autopilot.run(60.0)
    assert autopilot.texts()[-1] == f"rotorid: {reason}"
    assert not [value for _, name, value in autopilot.events() if name == "mode"]


def test_a_switch_that_is_on_at_boot_starts_nothing() -> None:
    autopilot = Autopilot(ardupilot_files(four_chirps(), facts())["hover-four-axes-chirps.lua"])
    autopilot.state.mode = STABILIZE
    autopilot.state.switch = 2
    autopilot.run(60.0)
    assert not autopilot.events()
    autopilot.state.switch = 0
    autopilot.run(1.0)
    autopilot.state.switch = 2
    autopilot.run(1.0)
    assert autopilot.state.mode == SYSTEMID


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize(("entry", "axis"), list(SID_AXIS), ids="-".join)
def test_every_axis_is_entered_in_every_version(entry: Entry, axis: Axis, version: int) -> None:
    size = 0.1 if entry == "command" else 0.2
    autopilot = chirp_script(
        FlightPlan(name="one", inputs=(chirp(axis, entry=entry, amplitude=size),)), version=version
    )
    autopilot.run(1.0)
    assert autopilot.state.mode == SYSTEMID
    autopilot.run(120.0)
    assert autopilot.texts()[-1] == "rotorid: plan complete"
    assert autopilot.state.mode == STABILIZE


@pytest.mark.parametrize(("version", "taken"), [(45, True), (46, False), (47, False)])
def test_loiter_is_no_way_in_since_manual_throttle_is_asked_for(version: int, taken: bool) -> None:
    """The script of before, which began in Loiter, against the same firmware: so the fake refuses what the real did."""
    script = ardupilot_files(four_chirps(), facts())["hover-four-axes-chirps.lua"]
    autopilot = Autopilot(script.replace("START_MODES = { [0]", f"START_MODES = {{ [{LOITER}]"))
    autopilot.state.version = version
    autopilot.run(3.0)
    autopilot.state.switch = 2
    autopilot.run(60.0)
    assert (autopilot.state.mode == SYSTEMID) == taken
    assert ("Axis requires manual throttle" in autopilot.texts()) != taken


@pytest.mark.parametrize(("version", "changed"), [(47, {"mode": LOITER}), (46, {"refuse_mode": SYSTEMID})])
def test_a_rest_ends_the_plan_where_the_next_chirp_cannot_begin(version: int, changed: dict[str, Any]) -> None:
    autopilot = chirp_script(version=version)
    autopilot.run(93.0)
    assert autopilot.state.mode == STABILIZE  # the rest after the first chirp
    for name, value in changed.items():
        autopilot.state[name] = value
    autopilot.run(60.0)
    assert autopilot.state.mode == changed.get("mode", STABILIZE)
    reason = "the pilot took over" if "mode" in changed else "SYSTEMID mode was refused"
    assert autopilot.texts()[-1] == f"rotorid: {reason}"


def test_a_rest_waits_for_the_vehicle_to_come_back() -> None:
    autopilot = chirp_script()
    autopilot.run(93.0)
    assert autopilot.texts()[-1] == "rotorid: rest 9 s"
    autopilot.state.position = autopilot.lua.table(9.0, 9.0, -20.0)
    autopilot.run(60.0)
    assert autopilot.state.mode == STABILIZE
    assert autopilot.texts()[-1] == "rotorid: come back: out of the room"
    assert autopilot.texts().count("rotorid: come back: out of the room") == 1
    autopilot.state.position = autopilot.lua.table(0.0, 0.0, -20.0)
    autopilot.run(8.0)
    assert autopilot.state.mode == STABILIZE  # its rest is not cut short
    autopilot.run(2.0)
    assert autopilot.state.mode == SYSTEMID
    assert autopilot.texts()[-1] == "rotorid: chirp 2 of 4, pitch"


@pytest.mark.parametrize(
    ("firmware", "said", "limit"),
    [
        (
            "",
            'firmware 4.6 and later refuses other modes: "Axis requires manual throttle"',
            "from 4.7 on ATC_ANGLE_MAX",
        ),
        ("ArduCopter V4.5.7 (2a3dc4b7)", "there your hand is on the throttle already", "exceeds ANGLE_MAX."),
        ("ArduCopter V4.6.2 (3fc7011a)", "ArduCopter 4.6 refuses other modes", "exceeds ANGLE_MAX."),
        ("ArduCopter V4.7.0-dev (e4b2f4c6)", "ArduCopter 4.7 refuses other modes", "exceeds ATC_ANGLE_MAX."),
    ],
)
def test_every_file_says_from_where_and_who_works_the_throttle(firmware: str, said: str, limit: str) -> None:
    files = ardupilot_files(four_chirps(), facts(firmware=firmware))
    runs = [text for name, text in files.items() if name.endswith(".param") and "after" not in name]
    for text in runs:
        assert f"Enter System ID from Stabilize ({said}" in text
        assert "You control the throttle" in text
        assert limit in text
    assert f"Start in STABILIZE ({said}" in files["hover-four-axes-chirps.lua"]
    assert "pilot controls the throttle all the time" in files["hover-four-axes-chirps.lua"]
