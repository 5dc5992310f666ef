"""Parameters of autopilots that a record keeps: what the dynamics, the loops and the logging follow from, nothing else.

An autopilot has a thousand parameters. Among them are the place where it took off, the numbers of its board and of each
of its sensors, the name of a radio network and the number of a pilot; new firmware brings new ones. So what is kept is
listed, and not what is left out:

==============  ======================================================================================================
PX4             gains and limits (``MC_*``, ``MPC_*``), mixing (``CA_*``), filters (``IMU_*``), motors (``MOT_*``,
                ``THR_MDL_FAC``), what is logged (``SDLOG_*``), frames of sensors, simulated vehicle, airframe
ArduPilot       gains (``ATC_*``, ``PSC_*``), frame (``FRAME_*``), motors (``MOT_*``), filters (``INS_*``), outputs
                (``SERVOn_FUNCTION``), sticks (``RCn_*``, ``RCMAP_*``), test inputs (``SID_*``), what is logged
                (``LOG_*``)
Betaflight      every number of the header by its lower-case name but for those of the radio link and of positions
==============  ======================================================================================================

Of these, too, a name that ends like the number of a device (``_ID``, ``_SERIAL``) or says a place (``_LAT``,
``_HOME``) is left out.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from rotorid.data.findings import Finding, warn

_PREFIXES = (
    *("ACCEL_Z_", "ACRO_", "ANGLE_", "ATC_", "AUTOTUNE_", "CA_", "CH7_", "EK2_", "EK3_", "EKF2_", "FFT_"),
    *("FLTMODE", "FRAME", "H_", "IM_", "LOG_", "LOIT_", "MC_", "MIS_YAW", "MOT_", "MPC_", "PHLD_", "PILOT_", "POS_XY_"),
    *("POS_Z_", "PSC_", "PWM_", "RATE_", "RCMAP_", "SCHED_", "SDLOG_", "SENS_BOARD_", "SENS_EN_", "SID_", "SIH_"),
    *("SIM_", "STB_", "THR_", "TKOFF_", "VEL_XY_", "VEL_Z_", "VT_", "WPNAV_", "WP_YAW", "Q_", "DSHOT_", "HIL_ACT_"),
    *("IMU_GYRO_", "IMU_ACCEL_", "IMU_DGYRO_", "IMU_INTEG_", "TRIM_"),
)
"""Beginnings of names of which all are kept."""

_NAMES = (
    r"AHRS_(?:ORIENTATION|TRIM_[XYZ]|EKF_TYPE)|ARMING_CHECK|ARMING_SKIPCHK|THR_MDL_FAC|MAV_TYPE|SYS_(?:AUTOSTART|HITL|"
    r"CTRL_ALLOC|MC_EST_GROUP|VEHICLE_RESP)|FW_(?:USE_AIRSPD|ARSP_MODE)|NAV_(?:LOITER_RAD|ACC_RAD)|COM_(?:FLTMODE\d|"
    r"RC_IN_MODE|ARM_EKF_\w{1,8}|SPOOLUP_TIME|DISARM_LAND|DISARM_PRFLT)|"
    r"BAT\d?_(?:CAPACITY|N_CELLS|V_CHARGED|V_EMPTY|V_LOAD_DROP|R_INTERNAL|SOURCE|V_DIV)|"
    r"BATT\d?_(?:CAPACITY|MONITOR|VOLT_MULT|ARM_VOLT|LOW_VOLT|CRT_VOLT|AMP_PERVLT)|"
    r"INS_(?:ACCEL_FILTER|GYRO_FILTER|GYRO_RATE|FAST_SAMPLE|ENABLE_MASK|USE\d?|MPU6K_FILTER|POS\d_[XYZ]|HNTCH_\w{1,12}|"
    r"HNTC2_\w{1,12}|NOTCH_\w{1,12}|NOTC2_\w{1,12}|LOG_BAT_\w{1,8}|RAW_LOG_OPT|STILL_THRESH)|FILT\d_\w{1,12}|"
    r"RC\d{1,2}_(?:MIN|MAX|TRIM|DZ|REV|REVERSED|OPTION)|RC_MAP_\w{1,16}|RC_SPEED|"
    r"SERVO\d{1,2}_(?:FUNCTION|MIN|MAX|TRIM|REVERSED)|SERVO_(?:RATE|DSHOT_RATE|DSHOT_ESC|BLH_\w{1,8})|"
    r"SR\d_\w{1,12}|MAV\d_(?:EXTRA\d|RAW_SENS|RC_CHAN)|ESC_\w{1,12}|SYSID_(?:ENFORCE|SW_MREV)|FORMAT_VERSION|"
    r"I interval|P interval|P ratio|Data version"
)
_UPPER = re.compile(rf"(?:{'|'.join(_PREFIXES)})\w{{0,40}}|FRAME|{_NAMES}")
_LOWER = re.compile(r"(?!serialrx|gps|home|nav_?(?:lat|lon)|vtx|telemetry|msp|osd)[a-z]\w{0,80}")

_DEVICE = re.compile(
    r"(?:^|_)(?:DEVID|UUID|UID|SSID|PASS|PASSWORD|KEY|SERIAL|SERIAL_NUM|CALLSIGN)\d{0,2}(?:_|$)"
    r"|(?:^|_)(?:ID|DEV_ID|SERIAL_NUM)\d{0,2}$|(?:^|_)(?:ACC|GYR|MAG|BARO|PILOT|DEV)\d?_?ID\d?$",
    re.IGNORECASE,
)
_PLACE = re.compile(
    r"(^|_)(LAT|LON|LNG|LATITUDE|LONGITUDE|OPOS|ORIG|ORIGIN|HOME|LOC)\d*(_|$)|(^|_)MAG_DECL(_|$)", re.IGNORECASE
)


def kept_parameters(parameters: Mapping[str, float]) -> dict[str, float]:
    """The parameters that say how the vehicle flies and logs, and neither where, nor whose it is.

    Parameters
    ----------
    parameters
        Name to value, as any autopilot names them.

    Examples
    --------
    >>> kept_parameters({"SIH_LOC_LAT0": 47.4, "INS_GYR_ID": 3.0, "WIFI_SSID1": 1.0, "MOT_THST_EXPO": 0.65})
    {'MOT_THST_EXPO': 0.65}
    """
    return {name: value for name, value in parameters.items() if _is_kept(name)}


_OF_LOOPS = re.compile(
    r"(?:ATC_(?:RAT|ANG)|MC_|RATE_|STB_|IMU_D?GYRO_|INS_(?:GYRO_FILTER|HNTCH|HNTC2|NOTCH|NOTC2)|FILT\d_|THR_MDL_FAC|"
    r"MOT_(?:THST_EXPO|SPIN_|PWM_|BAT_VOLT_))\w{0,40}|SCHED_LOOP_RATE"
)
"""Gains, filters and the curve of thrust; not what an autopilot learns or counts as it flies."""

_NAMED = 8


def changed_in(statements: Iterable[tuple[str, float]]) -> dict[str, tuple[float, float]]:
    """First and last value of each gain, filter or number of the thrust curve that a log states with several.

    Parameters
    ----------
    statements
        Names and values in the order of the log.

    Examples
    --------
    >>> changed_in([("MC_ROLLRATE_P", 0.15), ("MC_YAW_P", 2.8), ("MC_ROLLRATE_P", 0.2), ("MC_YAW_P", 2.8)])
    {'MC_ROLLRATE_P': (0.15, 0.2)}
    """
    ends: dict[str, tuple[float, float]] = {}
    several: set[str] = set()
    for name, value in statements:
        if not _OF_LOOPS.fullmatch(name):
            continue
        first, last = ends.get(name, (value, value))
        if value != last:
            several.add(name)
        ends[name] = first, value
    return {name: ends[name] for name in ends if name in several}


def parameters_changed(
    changes: Mapping[str, tuple[float, float]], why: str, *, taken: str = "the last values"
) -> Finding:
    """The warning that a log was flown with other parameters than those that are taken.

    Parameters
    ----------
    changes
        Name to what was, and what is taken.
    why
        How that is known, as the beginning of a sentence.
    taken
        Which values the analysis uses.
    """
    listed = [f"{name} {was:g} to {now:g}" for name, (was, now) in sorted(changes.items())]
    more = f" and {len(listed) - _NAMED} more" if len(listed) > _NAMED else ""
    return warn(
        "parameters_changed",
        "parameters",
        f"{why}: {', '.join(listed[:_NAMED])}{more}. The whole log is analyzed with {taken}, and no loop is computed; "
        "log each set of gains by itself.",
        parameters=len(listed),
    )


def _is_kept(name: str) -> bool:
    listed = _UPPER.fullmatch(name) or _LOWER.fullmatch(name)
    return bool(listed) and not _DEVICE.search(name) and not _PLACE.search(name)
