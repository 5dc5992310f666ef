"""Loops of a review, by records of a known second-order loop that a stick drives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.findings import refusal
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Status, Topic
from rotorid.errors import InsufficientDataError
from rotorid.excitation.sticks import everyday_stick
from rotorid.flights.whole_flights import flown, loop_response, with_floor
from rotorid.results.model import Refused
from rotorid.results.provenance import Provenance
from rotorid.reviewing.assembly import _refusals
from rotorid.reviewing.loops import LOOPS, loop_of, loops
from rotorid.typing import FloatArray

RATE_HZ, LENGTH_S = 250.0, 60.0
NATURAL, DAMPING = 20.0, 0.7
BANDWIDTH_90DEG = NATURAL


def second_order(values: FloatArray, natural: float = NATURAL) -> FloatArray:
    from scipy.signal import bilinear, lfilter

    numerator, denominator = bilinear([natural**2], [1.0, 2.0 * DAMPING * natural, natural**2], fs=RATE_HZ)
    return np.asarray(lfilter(numerator, denominator, values))


def topic(name: str, stride: int, columns: dict[str, FloatArray], delay: int = 0) -> Topic:
    rows = {key: values[delay::stride] for key, values in columns.items()}
    samples = next(iter(rows.values())).size
    return Topic(
        name=name,
        time_s=(delay + stride * np.arange(samples)) / RATE_HZ,
        channels=tuple(Channel(name=key, unit=STANDARD_UNITS[key]) for key in rows),
        values=np.stack(list(rows.values())),
    )


def record(
    *,
    stick_hz: float = 250.0,
    log_hz: float = 250.0,
    level: float = 0.5,
    natural: float = NATURAL,
    direct: bool = False,
    without: tuple[str, ...] = (),
    motors: FloatArray | None = None,
    parameters: dict[str, float] | None = None,
    in_air: tuple[tuple[float, float], ...] = ((0.0, LENGTH_S),),
    scale: FloatArray | float = 1.0,
    feedback: bool = True,
    length_s: float = LENGTH_S,
) -> FlightRecord:
    """A roll rate that follows its set-point, gusts on it, and a slow loop that puts them into the set-point."""
    rng = np.random.default_rng(3)
    stick = scale * everyday_stick(level=level, duration_s=length_s, sample_rate_hz=RATE_HZ, rng=rng)
    gusts = second_order(0.3 * rng.standard_normal(stick.size), 6.0)
    wanted = 3.0 * stick
    # Feedback of the gusts' part of the rate through an integral, as an attitude loop has it.
    answer = gusts if feedback else 0.0 * gusts
    setpoint = wanted - 2.0 * np.cumsum(answer - answer.mean()) / RATE_HZ
    rate = second_order(setpoint, natural) + answer + 0.002 * rng.standard_normal(stick.size)
    columns = {"p": rate, "p_setpoint": setpoint}
    if motors is not None:
        columns["motor_1"] = motors
    columns = {name: values for name, values in columns.items() if name not in without}
    topics = [topic("loops", round(RATE_HZ / log_hz), columns)]
    if "roll_stick" not in without:
        topics.append(
            topic("sticks", round(RATE_HZ / stick_hz), {"roll_stick": stick}, delay=1 if stick_hz < 250 else 0)
        )
    status = Status(armed=in_air, in_air=in_air, flagged_in="flags", direct_rates=in_air if direct else ())
    return FlightRecord(
        source=Source(name="flight", format="twin", sha256=""),
        topics=tuple(topics),
        status=status,
        parameters=parameters or {},
    )


@pytest.mark.parametrize("stick_hz", [250.0, 50.0, 10.0])
def test_a_slow_stick_is_held_up_to_the_gyro(stick_hz: float) -> None:
    flight = flown(record(stick_hz=stick_hz))
    (history,) = flight.histories(("p_setpoint", "p"), sampled=("roll_stick",))
    assert history.sample_rate_hz == pytest.approx(RATE_HZ)
    found, _ = loop_of(flight, LOOPS[0])
    assert found is not None
    assert found.instrument == "stick"
    crossing = found.numbers["bandwidth_90deg_rad_s"]
    assert crossing.value == pytest.approx(BANDWIDTH_90DEG, rel=0.05)
    assert crossing.lower <= BANDWIDTH_90DEG <= crossing.upper


def test_joint_is_told_where_direct_would_be_biased() -> None:
    flight = flown(record(level=0.03, length_s=120.0, in_air=((0.0, 120.0),)))
    omega = np.array([2.0, 4.0])
    stated = []
    for instrument in ("roll_stick", ""):
        response = loop_response(flight, reference="p_setpoint", answer="p", instrument=instrument)
        values = np.interp(omega, response.omega_rad_s, response.values[0, 0])
        error = np.interp(omega, response.omega_rad_s, response.random_error[0, 0])
        truth = NATURAL**2 / (NATURAL**2 - omega**2 + 2j * DAMPING * NATURAL * omega)
        stated.append(float((np.abs(values / truth - 1.0) / error).max()))
    # 39 % off with 5 % stated, where the joint one knows that it knows little.
    assert stated[0] < 3.0
    assert stated[1] > 5.0


def test_acro_needs_no_stick() -> None:
    found, _ = loop_of(flown(record(direct=True, feedback=False, without=("roll_stick",))), LOOPS[0])
    assert found is not None
    assert found.instrument == "direct"
    assert found.step is not None
    assert found.step.lower[20] <= found.step.value[20] <= found.step.upper[20]
    assert found.numbers["overshoot_percent"].value == pytest.approx(4.6, abs=2.0)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"level": 0.004}, "did not move"),
        ({"without": ("roll_stick",)}, "roll stick is not logged"),
        ({"without": ("p_setpoint",)}, "roll rate set-point is not logged"),
        ({"in_air": ((0.0, 9.0),)}, "moved for"),
    ],
)
def test_what_cannot_be_told_says_why_and_what_would_tell(options: dict[str, object], words: str) -> None:
    found, untold = loops(flown(record(**options)))  # type: ignore[arg-type]
    assert "p" not in found
    (why,) = [one for one in untold if one.what == "loops.p"]
    assert words in why.why
    assert why.remedy


@pytest.mark.parametrize(
    ("log_hz", "told", "missing"),
    [(50.0, {"bandwidth_90deg_rad_s", "delay_s"}, "loops.p.step"), (25.0, set(), "loops.p")],
)
def test_a_slow_log_tells_as_much_as_it_carries(log_hz: float, told: set[str], missing: str) -> None:
    """A loop of 25 rad/s: 2.5 times that is 62 Hz, 1.25 times 31 Hz."""
    found, untold = loop_of(flown(record(log_hz=log_hz, natural=25.0, stick_hz=25.0)), LOOPS[0])
    assert set(found.numbers if found else ()) == told
    (why,) = untold
    assert why.what == missing
    assert f"at only {log_hz:.0f} Hz" in why.why
    assert why.remedy.endswith("Hz or more")


def test_a_slow_log_of_an_autopilot_names_the_setting_that_makes_it_fast() -> None:
    log = record(log_hz=50.0, natural=25.0, stick_hz=25.0, parameters={"LOG_BITMASK": 176126.0})
    log = replace(log, source=replace(log.source, format="ArduPilot DataFlash", firmware="ArduCopter V4.6.2"))
    _, (why,) = loop_of(flown(log), LOOPS[0])
    assert why.remedy.startswith("set LOG_BITMASK = 438271")


def test_half_a_sample_of_a_slow_log_is_in_the_interval_of_its_delay() -> None:
    fast, slow = (loop_of(flown(record(log_hz=log_hz)), LOOPS[0])[0] for log_hz in (250.0, 50.0))
    assert fast is not None
    assert slow is not None
    widths = [found.numbers["delay_s"].upper - found.numbers["delay_s"].lower for found in (fast, slow)]
    assert widths[1] > widths[0] + 0.015


def test_feedforward_and_saturation_are_said() -> None:
    motors = 0.5 + 0.05 * np.random.default_rng(0).standard_normal(round(LENGTH_S * RATE_HZ))
    motors[::5] = 1.0
    found, _ = loops(flown(record(motors=motors, parameters={"MC_ROLLRATE_FF": 0.02})))
    assert {"feedforward", "saturation"} <= {finding.kind for finding in found["p"].findings}


def test_small_and_large_setpoints_stand_beside_each_other() -> None:
    length_s = 160.0
    clock = np.arange(round(length_s * RATE_HZ)) / RATE_HZ
    scale = np.where(clock % 40.0 < 20.0, 1.0, 0.2)
    plain = record(scale=scale, direct=True, feedback=False, length_s=length_s, in_air=((0.0, length_s),))
    found, _ = loop_of(flown(plain), LOOPS[0])
    assert found is not None
    assert set(found.by_size) == {"small set-points", "large set-points"}
    for part in found.by_size.values():
        assert part.numbers["bandwidth_90deg_rad_s"].value == pytest.approx(BANDWIDTH_90DEG, rel=0.05)


def test_who_never_flew_has_no_loops() -> None:
    with pytest.raises(InsufficientDataError):
        flown(record(in_air=()))


def test_two_flights_count_together() -> None:
    flight = flown(record(in_air=((1.0, 25.0), (30.0, 58.0))))
    histories = flight.histories(("p_setpoint", "p"), sampled=("roll_stick",))
    assert [round(history.start_s) for history in histories] == [1, 30]
    found, _ = loop_of(flight, LOOPS[0])
    assert found is not None
    assert found.numbers["bandwidth_90deg_rad_s"].value == pytest.approx(BANDWIDTH_90DEG, rel=0.05)


def test_the_floor_is_shared_by_neighbors() -> None:
    plain = loop_response(flown(record()), reference="p_setpoint", answer="p", instrument="roll_stick")
    more = with_floor(plain, independent=0.01, shared=0.02)
    values = plain.values[0, 0]
    added = (more.covariance - plain.covariance)[0, 0]
    assert np.allclose(np.diag(added), (0.01**2 + 0.02**2) * np.abs(values) ** 2)
    ratio = np.log(plain.omega_rad_s[1] / plain.omega_rad_s[0])
    assert added[0, 1] == pytest.approx(0.02**2 * values[0] * values[1].conj() * np.exp(-ratio / 0.5))
    assert np.all(more.random_error > plain.random_error)


@pytest.mark.parametrize(("sharp", "shortest_s"), [(True, 2.0), (False, 1.0)])
def test_short_windows_are_left_out_where_a_steep_spectrum_runs_over(sharp: bool, shortest_s: float) -> None:
    """Motion that ends at 3 Hz as if cut off fills windows of 1 s up to 5 Hz, and the response with it."""
    rng = np.random.default_rng(5)
    count = round(LENGTH_S * RATE_HZ)
    frequency_hz = np.fft.rfftfreq(count, 1.0 / RATE_HZ)
    fall = np.where(frequency_hz < 3.0, 1.0, 0.05) if sharp else 1.0 / np.sqrt(1.0 + (frequency_hz / 3.0) ** 4)
    setpoint = np.fft.irfft(fall * np.fft.rfft(rng.standard_normal(count)), count)
    rate = second_order(setpoint) + 1e-4 * rng.standard_normal(count)
    flown_s = ((0.0, LENGTH_S),)
    acro = FlightRecord(
        source=Source(name="flight", format="twin", sha256=""),
        topics=(topic("loops", 1, {"p": rate, "p_setpoint": setpoint}),),
        status=Status(armed=flown_s, in_air=flown_s, flagged_in="flags", direct_rates=flown_s),
    )
    response = loop_response(flown(acro), reference="p_setpoint", answer="p")
    assert min(response.windows_s) == pytest.approx(shortest_s, rel=0.05)
    omega = response.omega_rad_s
    truth = NATURAL**2 / (NATURAL**2 - omega**2 + 2j * DAMPING * NATURAL * omega)
    near = (omega > 25.0) & (omega < 40.0)
    error = np.abs(response.values[0, 0] / truth - 1.0)[near] / response.random_error[0, 0][near]
    assert float(np.sqrt(np.mean(error**2))) < 3.0


@pytest.mark.parametrize(
    ("kind", "remedy"),
    [("low_coherence", "sweep the roll stick, slow to fast, for a minute or more"), ("missing_channel", "")],
)
def test_a_sweep_is_advised_where_it_would_help(kind: str, remedy: str) -> None:
    finding = refusal(kind, "p/roll_command", "Too little.")
    answer = Refused(name="rate.roll", structure=None, findings=(finding,), provenance=Provenance())
    source = Source(name="flight.ulg", format="PX4 ULog", sha256="")
    (told,) = _refusals({"rate.roll": answer}, FlightRecord(source=source, topics=()))
    assert (told.why, told.remedy) == ("Too little.", remedy)
