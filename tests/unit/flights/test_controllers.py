"""Which firmware flew is decided by what its controller made, whatever the log calls it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.flights.controller_check import controller_findings
from rotorid.flights.controllers import LoggedFirmware, controllers_of, flown_firmware
from rotorid.models.autopilots.reading import axis_controller
from rotorid.models.autopilots.versions import firmware_candidates
from rotorid.typing import FloatArray

RATE_HZ, LENGTH_S = 250.0, 60.0
OLD, NEW = "PX4 1.11.3", "PX4 1.14.0"
PX4 = {
    **{
        f"MC_{axis}RATE_{letter}": value
        for axis in ("ROLL", "PITCH")
        for letter, value in zip("PID", (0.15, 0.2, 0.003), strict=True)
    },
    "IMU_DGYRO_CUTOFF": 30.0,
    "IMU_GYRO_RATEMAX": RATE_HZ,
}
BETAFLIGHT = {
    "rollPID_P": 45.0,
    "rollPID_I": 80.0,
    "rollPID_D": 30.0,
    "pitchPID_P": 47.0,
    "pitchPID_I": 84.0,
    "pitchPID_D": 34.0,
    "dterm_lpf1_type": 0.0,
    "dterm_lpf1_dyn_hz_0": 75.0,
    "dterm_lpf1_dyn_hz_1": 150.0,
    "dterm_lpf2_type": 3.0,  # a PT3: only since 4.3 it means one
    "dterm_lpf2_static_hz": 100.0,
    "looptime": 1e6 / 1000.0,
    "pid_process_denom": 1.0,
}


def flight(
    parameters: Mapping[str, float],
    *,
    flew: str,
    declared: str,
    gain: float = 1.0,
    noise: float = 0.02,
    terms: bool = False,
    rate_hz: float = RATE_HZ,
    kind: str = "PX4 ULog",
) -> FlightRecord:
    """A flight of two axes whose commands a firmware made, exactly but for some noise."""
    count, rng = int(LENGTH_S * rate_hz), np.random.default_rng(3)
    omega = 2.0 * np.pi * np.fft.rfftfreq(count, 1.0 / rate_hz)
    omega[0] = 1e-3

    def motion(corner_rad_s: float) -> FloatArray:
        raw = np.fft.rfft(rng.standard_normal(count)) / (1.0 + 1j * omega / corner_rad_s)
        return np.asarray(np.fft.irfft(raw, count))

    columns: dict[str, FloatArray] = {"thrust_command": np.full(count, 0.5), "thrust_stick": np.full(count, 0.5)}
    for axis, rate in (("roll", "p"), ("pitch", "q")):
        found = axis_controller(parameters, axis, firmware=flew, loop_rate_hz=rate_hz, throttle=0.5)  # type: ignore[arg-type]
        assert found is not None
        own = found.controller.rate_loop
        setpoint, measured = motion(10.0), motion(60.0)
        r, y = np.fft.rfft(setpoint), np.fft.rfft(measured)
        made = gain * np.fft.irfft(own.setpoint_response(omega) * r - own.response(omega) * y, count)
        columns |= {rate: measured, f"{rate}_setpoint": setpoint}
        columns[f"{axis}_command"] = made + noise * made.std() * rng.standard_normal(count)
        if terms:
            alone = {
                "p": replace(own, integral=0.0, derivative_s2=0.0),
                "i": replace(own, proportional_s=0.0, derivative_s2=0.0),
            }
            columns |= {
                f"{axis}_{letter}_term": gain * np.fft.irfft(part.response(omega) * (r - y), count)
                for letter, part in alone.items()
            }
            columns[f"{axis}_d_term"] = -np.fft.irfft(own.derivative_response(omega) * y, count)
    channels = tuple(
        Channel(name=name, unit=STANDARD_UNITS.get(name, "1"), source=f"anything.{name}") for name in columns
    )
    topic = Topic(
        name="all", time_s=np.arange(count) / rate_hz, channels=channels, values=np.stack(list(columns.values()))
    )
    source = Source(name="log", format=kind, sha256="0", firmware=declared)
    return FlightRecord(source=source, topics=(topic,), parameters=dict(parameters))


def kinds(found: LoggedFirmware) -> list[str]:
    return [finding.kind for finding in found.findings]


@pytest.mark.parametrize("declared", ["PX4 1.8.0 (beta)", OLD, NEW, "PX4", ""])
@pytest.mark.parametrize("flew", [OLD, NEW])
def test_the_commands_say_which_filter_the_derivative_had(flew: str, declared: str) -> None:
    record = flight(PX4, flew=flew, declared=declared)
    found = flown_firmware(record)
    axis = controllers_of(record).axis("roll")
    expected = axis_controller(PX4, "roll", firmware=flew)
    assert axis is not None
    assert expected is not None
    assert bool(axis.controller.derivative_filters) == bool(expected.controller.derivative_filters) == (flew == OLD)
    assert min(found.unexplained.values()) < 0.05 < 0.2 < max(found.unexplained.values())
    # 1.8 had no IMU_DGYRO_CUTOFF, whatever it did to the derivative.
    alike = declared != "PX4 1.8.0 (beta)" and (declared != OLD) == (flew == NEW)
    assert kinds(found) == ([] if alike else ["firmware_contradicted"])
    assert (found.name == declared) == alike


def test_a_log_that_names_no_firmware_calls_it_nothing() -> None:
    (finding,) = flown_firmware(flight(PX4, flew=OLD, declared="")).findings
    assert finding.message.startswith("The log does not name its firmware; PX4 1.11 or older flew and was used: ")
    assert "the newest version" in finding.message


@pytest.mark.parametrize("declared", [OLD, NEW])
def test_a_tie_goes_to_the_declared_version(declared: str) -> None:
    none = PX4 | {"MC_ROLLRATE_D": 0.0, "MC_PITCHRATE_D": 1e-6}
    found = flown_firmware(flight(none, flew=NEW, declared=declared))
    assert (found.name, kinds(found)) == (declared, [])


def test_what_a_log_holds_goes_before_its_name_where_the_commands_do_not_decide() -> None:
    none = PX4 | {"MC_ROLLRATE_D": 0.0, "MC_PITCHRATE_D": 1e-6, "MC_YAW_TQ_CUTOFF": 2.0}
    found = flown_firmware(flight(none, flew=NEW, declared="PX4 1.8.0 (beta)"))
    assert found.name == "PX4 1.16 or newer"
    assert kinds(found) == ["firmware_contradicted"]
    assert "1.8.0" in found.findings[0].message


def test_commands_that_no_candidate_makes_are_a_finding() -> None:
    record = flight(PX4, flew=NEW, declared=NEW, gain=2.0)
    assert (flown_firmware(record).name, kinds(flown_firmware(record))) == (NEW, [])
    assert [(one.kind, one.where) for one in controller_findings(record)] == [
        ("controller_unexplained", "roll"),
        ("controller_unexplained", "pitch"),
    ]


def test_a_log_that_shows_no_commands_leaves_the_controller_unchecked() -> None:
    record = flight(PX4, flew=OLD, declared=NEW)
    (topic,) = record.topics
    rows = [row for row, channel in enumerate(topic.channels) if not channel.name.endswith("_setpoint")]
    less = replace(topic, channels=tuple(topic.channels[row] for row in rows), values=topic.values[rows])
    found = flown_firmware(replace(record, topics=(less,)))
    assert (found.name, found.unexplained, kinds(found)) == (NEW, {}, ["controller_unchecked"])


def test_other_filters_that_are_to_be_flown_do_not_change_which_firmware_flew() -> None:
    record = flight(PX4, flew=OLD, declared=NEW)
    axis = controllers_of(record).with_parameters(PX4 | {"IMU_DGYRO_CUTOFF": 60.0}).axis("roll")
    assert axis is not None
    assert [one.frequency_hz for one in axis.controller.derivative_filters] == [60.0]


@pytest.mark.parametrize("declared", ["Betaflight 4.1.2", "Betaflight 4.2.9", "Betaflight 4.3.1"])
def test_the_logged_derivative_of_a_blackbox_says_which_version_filtered_it(declared: str) -> None:
    """A cutoff by the curve of 4.1 at half throttle is 103 Hz and not 122 Hz, and its filter of type 3 is none."""
    record = flight(
        BETAFLIGHT,
        flew="Betaflight 4.3.0",
        declared=declared,
        terms=True,
        rate_hz=1000.0,
        kind="Betaflight blackbox",
    )
    found = flown_firmware(record)
    assert found.name == (declared if declared == "Betaflight 4.3.1" else "Betaflight 4.3 or newer")
    assert kinds(found) == ([] if declared == "Betaflight 4.3.1" else ["firmware_contradicted"])


def test_the_old_betaflight_is_taken_where_its_terms_say_so() -> None:
    old = {name.replace("lpf1", "lowpass").replace("lpf2", "lowpass2"): value for name, value in BETAFLIGHT.items()}
    old = {"dterm_filter_type" if name == "dterm_lowpass_type" else name: value for name, value in old.items()}
    old |= {"dterm_lowpass_dyn_hz_1": 300.0, "dterm_lowpass2_static_hz": 0.0}
    record = flight(
        old,
        flew="Betaflight 4.1.0",
        declared="Betaflight 4.2.0",
        terms=True,
        rate_hz=1000.0,
        kind="Betaflight blackbox",
    )
    assert flown_firmware(record).name == "Betaflight 4.1 or older"


def test_candidates_begin_with_the_declared_version_unless_the_log_cannot_be_of_it() -> None:
    assert firmware_candidates(PX4, firmware="PX4 1.12.3") == ("PX4 1.12.3", "PX4 1.11 or older")
    assert firmware_candidates(PX4, firmware="PX4 1.8.0") == ("PX4 1.11 or newer", "PX4 1.12 or newer")
    torque = ("vehicle_torque_setpoint.xyz",)
    assert firmware_candidates(PX4, firmware="PX4 1.8.0", names=torque) == ("PX4 1.12 or newer", "PX4 1.8.0")
    assert firmware_candidates(PX4 | {"MC_DTERM_CUTOFF": 30.0}, firmware="PX4 1.14") == (
        "PX4 1.14",
        "PX4 1.11 or older",
    )
    assert firmware_candidates({"ATC_RAT_RLL_P": 0.1}, firmware="ArduCopter V4.6") == ("ArduCopter V4.6",)
