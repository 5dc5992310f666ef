"""Excitations in signals: found where they are, as what they are, and nothing where there is none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Maneuver, Source, Status, Topic
from rotorid.excitation.sticks import everyday_stick
from rotorid.excitation.sweep import logarithmic_sweep, pilot_sweep
from rotorid.excitation.switching import doublet, three_two_one_one
from rotorid.signal.excitations import (
    candidate_excitations,
    classify,
    excitation_signals,
    find_excitations,
    rich_excitations,
    verifying_excitations,
)
from rotorid.typing import Axis, FloatArray

RATE_HZ = 100.0
BAND = (2.0 * math.pi * 0.15, 2.0 * math.pi * 5.0)


def rest(duration_s: float) -> FloatArray:
    return np.zeros(round(duration_s * RATE_HZ))


def record(
    channels: dict[str, FloatArray], declared: Sequence[Maneuver] = (), **instruments: tuple[str, ...]
) -> FlightRecord:
    values = np.stack(list(channels.values()))
    topic = Topic(
        name="t",
        time_s=200.0 + np.arange(values.shape[1]) / RATE_HZ,
        channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in channels),
        values=values,
    )
    return FlightRecord(
        source=Source(name="a.ulg", format="ulog", sha256="0" * 64),
        topics=(topic,),
        declared=tuple(declared),
        instruments=instruments,
    )


def find(values: FloatArray, axis: Axis = "roll", channel: str | None = None) -> tuple[Maneuver, ...]:
    return find_excitations(record({channel or f"{axis}_command": values}), axis)


def pilot(amplitude: float = 0.1, duration_s: float = 40.0) -> FloatArray:
    return pilot_sweep(
        amplitude=amplitude, band_rad_s=BAND, duration_s=duration_s, sample_rate_hz=RATE_HZ, slow_cycles=2.0
    )


def chirp(amplitude: float = 0.1, duration_s: float = 60.0) -> FloatArray:
    return logarithmic_sweep(
        amplitude=amplitude, band_rad_s=BAND, duration_s=duration_s, sample_rate_hz=RATE_HZ, constant_s=5.0
    )


def random_binary(amplitude: float = 0.1, duration_s: float = 30.0, seed: int = 0) -> FloatArray:
    levels = np.random.default_rng(seed).choice([-amplitude, amplitude], round(duration_s / 0.2))
    return np.repeat(levels, round(0.2 * RATE_HZ))


def embedded(*parts: FloatArray, noise: float = 0.0) -> FloatArray:
    values = np.concatenate([rest(10.0), *(np.concatenate([part, rest(6.0)]) for part in parts)])
    return values + noise * np.random.default_rng(9).standard_normal(values.size)


@pytest.mark.parametrize("make", [pilot, chirp], ids=["pilot", "logarithmic"])
@pytest.mark.parametrize("turn", [1, -1], ids=["upward", "downward"])
@pytest.mark.parametrize("noise", [0.0, 0.0003], ids=["clean", "noisy"])
def test_sweeps_are_found_with_their_band(make: object, turn: int, noise: float) -> None:
    motion = make()[::turn]  # type: ignore[operator]
    (found,) = find(embedded(motion, noise=noise))
    assert (found.kind, found.axis, found.signal, found.origin) == ("sweep", "roll", "roll_command", "found")
    # The sweep has 3 s of rest on both sides; its fades of 1 s may fall to either.
    assert found.start_s == pytest.approx(213.0, abs=1.5)
    assert found.stop_s == pytest.approx(210.0 + motion.size / RATE_HZ - 3.0, abs=1.5)
    # Whole half periods at the slow end are exact but for the fade; at the fast end a half period of ten samples is
    # known to one sample, and the fade takes the last second of the sweep, at worst an eighth of the band.
    assert found.band_rad_s is not None
    assert found.band_rad_s[0] == pytest.approx(BAND[0], rel=0.1)
    assert found.band_rad_s[1] == pytest.approx(BAND[1], rel=0.225)


def test_a_random_binary_signal_is_one() -> None:
    (found,) = find(embedded(random_binary()))
    assert found.kind == "random_binary"
    assert found.start_s == pytest.approx(210.0, abs=0.05)
    assert found.duration_s == pytest.approx(30.0, abs=0.1)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_short_maneuvers_are_told_apart(sign: float) -> None:
    pair = sign * doublet(amplitude=0.1, pulse_s=0.5, sample_rate_hz=RATE_HZ)
    steps = sign * three_two_one_one(amplitude=0.1, unit_s=0.4, sample_rate_hz=RATE_HZ)
    first, second = find(embedded(pair, steps))
    assert (first.kind, second.kind) == ("doublet", "multistep")
    assert first.start_s == pytest.approx(211.0, abs=0.05)
    assert first.duration_s == pytest.approx(1.0, abs=0.1)
    assert second.duration_s == pytest.approx(2.8, abs=0.1)


@pytest.mark.parametrize("duration_s", [3.0, 10.0, 100.0])
@pytest.mark.parametrize("seed", range(3))
def test_noise_is_no_excitation(duration_s: float, seed: int) -> None:
    noise = 0.05 * np.random.default_rng(seed).standard_normal(round(duration_s * RATE_HZ))
    assert find(noise) == ()
    assert find(np.concatenate([rest(20.0), noise, rest(20.0)])) == ()


def test_what_is_too_small_is_taken_for_corrections() -> None:
    assert find(embedded(pilot(amplitude=0.015))) == ()
    assert find(embedded(pilot(amplitude=0.025)))


def test_rest_and_silence_hold_nothing() -> None:
    assert find(rest(60.0)) == ()
    assert find(np.full(100, np.nan)) == ()
    assert find(rest(0.05)) == ()


def test_a_take_off_beside_a_sweep_is_left_out() -> None:
    climb = np.concatenate([rest(8.0), np.linspace(0.0, 0.5, 300), np.full(500, 0.5)])
    values = np.concatenate([climb, 0.5 + embedded(pilot(amplitude=0.12)), np.linspace(0.5, 0.0, 200), rest(4.0)])
    found = find(values, axis="thrust")
    assert [maneuver.kind for maneuver in found] == ["sweep"]
    start = 200.0 + climb.size / RATE_HZ + 13.0
    assert found[0].start_s == pytest.approx(start, abs=1.5)
    assert found[0].stop_s == pytest.approx(start + 40.0, abs=1.5)


@pytest.mark.parametrize("ratio", [0.4, 1.0, 2.5])
def test_two_sweeps_of_other_amplitude_are_two(ratio: float) -> None:
    found = find(embedded(pilot(), pilot(amplitude=0.1 * ratio)))
    assert [maneuver.kind for maneuver in found] == ["sweep", "sweep"]
    assert found[1].start_s - found[0].start_s == pytest.approx(52.0, abs=1.5)


def test_missing_samples_do_not_hide_a_sweep() -> None:
    values = embedded(pilot())
    values[::7] = np.nan
    assert [maneuver.kind for maneuver in find(values)] == ["sweep"]


def test_what_the_log_declares_goes_first() -> None:
    said = Maneuver(axis="roll", kind="sweep", start_s=205.0, stop_s=215.0, origin="declared")
    flight = record({"roll_command": embedded(pilot())}, declared=[said])
    assert find_excitations(flight, "roll") == (said,)
    assert find_excitations(flight, "pitch") == ()


def test_signals_are_looked_at_from_the_outside_in() -> None:
    quiet = rest(78.0)[: embedded(pilot()).size]
    names = {"roll_command": quiet, "p": quiet, "phi_setpoint": quiet, "v_setpoint": quiet, "roll_stick": quiet}
    expected = ("roll_stick", "v_setpoint", "phi_setpoint", "roll_command")
    assert excitation_signals(record(names), "roll") == expected
    known = record(names, roll=("phi_setpoint",))
    assert excitation_signals(known, "roll") == ("phi_setpoint", "roll_command")


def test_the_first_signal_that_moves_is_taken() -> None:
    sweep = embedded(pilot())
    flight = record({"roll_command": 2.0 * sweep, "phi_setpoint": sweep, "v_setpoint": 0.0 * sweep})
    assert [maneuver.signal for maneuver in find_excitations(flight, "roll")] == ["phi_setpoint"]


def test_a_single_push_is_no_maneuver() -> None:
    time_s = np.arange(0.0, 3.0, 0.01)
    assert classify(time_s, np.ones(time_s.size)) == ("other", None)


def test_a_maneuver_ends_where_the_clock_jumps() -> None:
    """A square signal that never rests, half of it 2.3 days later: no clock is laid over the days between."""
    time_s = np.arange(0.0, 60.0, 0.01)
    time_s[3000:] += 2e5
    values = 0.1 * np.sign(np.sin(0.3 * np.arange(time_s.size))) + 0.05 * np.sin(0.11 * np.arange(time_s.size))
    channel = Channel(name="roll_command", unit="1")
    log = Topic(name="t", time_s=time_s, channels=(channel,), values=values[None])
    made = FlightRecord(source=Source(name="a", format="", sha256=""), topics=(log,))
    for one in (*find_excitations(made, "roll"), *candidate_excitations(made, "roll")):
        assert one.duration_s < 31.0


def test_stick_motion_after_landing_is_no_part_of_a_maneuver() -> None:
    steps = three_two_one_one(amplitude=0.1, unit_s=1.0, sample_rate_hz=RATE_HZ)
    whole = record({"yaw_command": np.concatenate([rest(10.0), steps, rest(10.0)])})
    (found,) = find_excitations(whole, "yaw")
    landed_s = found.stop_s - 0.3 * found.duration_s
    (flown,) = find_excitations(replace(whole, status=Status(in_air=((190.0, landed_s),))), "yaw")
    assert (flown.start_s, flown.stop_s) == (found.start_s, landed_s)


DECLARED = Maneuver(axis="roll", kind="sweep", start_s=203.0, stop_s=250.0, origin="declared", signal="roll_excitation")


def after_the_card(landed_s: float = 40.0) -> FloatArray:
    """The stick of a pilot in wind who flies doublets on his trim, corrects the drift, and lets go to land."""
    trims = [0.258, 0.4, 0.34, 0.4, 0.366, 0.4, 0.35, 0.4, 0.342]
    pieces = [np.full(round(3.0 * RATE_HZ), trims[0])]
    for number, trim in enumerate(trims[1:]):
        pulses = (0.9, -0.9) if number in (0, 2) else ()
        pieces += [np.full(round(0.3 * RATE_HZ), pulse) for pulse in pulses]
        pieces += [np.zeros(round(1.6 * RATE_HZ)), np.linspace(trim, trim - 0.05, round(3.0 * RATE_HZ))]
    return np.concatenate([*pieces, np.zeros(round(landed_s * RATE_HZ))])


def test_doublets_corrections_and_landing_are_no_random_binary_signal() -> None:
    stick = np.concatenate([np.full(round(120.0 * RATE_HZ), 0.258), after_the_card()])
    kinds = [maneuver.kind for maneuver in find(stick, channel="roll_stick")]
    assert "random_binary" not in kinds
    assert "sweep" not in kinds


@pytest.mark.parametrize("seed", range(5))
def test_one_octave_of_half_periods_is_not_rich(seed: int) -> None:
    """Two levels without a trend, as a pilot weaves between two trees."""
    halves = np.random.default_rng(seed).uniform(1.0, 1.9, 20)
    levels = np.repeat((-1.0) ** np.arange(halves.size), np.round(halves * RATE_HZ).astype(int))
    time_s = np.arange(levels.size) / RATE_HZ
    assert classify(time_s, levels)[0] == "other"
    slower = np.concatenate([levels, -np.ones(round(4.0 * RATE_HZ)), np.ones(round(0.5 * RATE_HZ)), -levels])
    assert classify(np.arange(slower.size) / RATE_HZ, slower)[0] == "random_binary"


def test_beside_what_the_log_declares_the_rest_verifies() -> None:
    swept, after = embedded(chirp()), embedded(random_binary(amplitude=0.3))
    injected, stick = np.concatenate([swept, 0.0 * after]), np.concatenate([0.0 * swept, after])
    named = record(
        {"roll_excitation": injected, "roll_stick": stick}, [DECLARED], roll=("roll_excitation", "roll_stick")
    )
    found = [maneuver for maneuver in find_excitations(named, "roll") if maneuver.origin == "found"]
    assert [maneuver.kind for maneuver in found] == ["random_binary"]
    assert rich_excitations(named, "roll") == (DECLARED,)
    assert list(verifying_excitations(named, "roll")) == found
    silent = replace(named, declared=())
    assert [m.kind for m in rich_excitations(silent, "roll")] == ["sweep"]


def test_doublets_on_a_trim_verify_what_the_log_declares() -> None:
    """The pilot leans against the wind, flies doublets about that, and lets go of the stick to land."""
    injected = np.concatenate([embedded(chirp()), rest(60.0)])
    stick = np.concatenate([np.full(injected.size - round(60.0 * RATE_HZ), 0.258), after_the_card()])[: injected.size]
    card = record(
        {"roll_excitation": injected, "roll_stick": stick}, [DECLARED], roll=("roll_excitation", "roll_stick")
    )
    found = verifying_excitations(card, "roll")
    assert {maneuver.kind for maneuver in found} <= {"doublet", "multistep"}
    begin_s = 200.0 + (injected.size - round(60.0 * RATE_HZ)) / RATE_HZ
    first, second = begin_s + 3.3, begin_s + 13.1
    assert all(any(m.start_s <= at_s <= m.stop_s for m in found) for at_s in (first, second))


def test_loops_of_position_move_an_attitude_and_excite_nothing() -> None:
    steps = three_two_one_one(amplitude=0.1, unit_s=1.0, sample_rate_hz=RATE_HZ)
    whole = record({"phi_setpoint": np.concatenate([rest(10.0), steps, rest(10.0)])})
    assert [m.kind for m in find_excitations(whole, "roll")] == ["multistep"]
    flown = {mode: Status(modes=((mode, 190.0, 290.0),)) for mode in ("position", "stabilized")}
    assert find_excitations(replace(whole, status=flown["position"]), "roll") == ()
    assert len(find_excitations(replace(whole, status=flown["stabilized"]), "roll")) == 1


def test_twitches_of_an_autopilot_that_tunes_itself_are_no_excitation() -> None:
    whole = record({"roll_command": embedded(random_binary())})
    assert [m.kind for m in find_excitations(whole, "roll")] == ["random_binary"]
    tuning = replace(whole, status=Status(modes=(("autotune", 190.0, 290.0),)))
    assert find_excitations(tuning, "roll") == ()


def multisine(duration_s: float, noise: float, seed: int = 0) -> FloatArray:
    """A period of 20 s of odd lines, with drift and what smoothing leaves, of the size of its lines."""
    rng, time_s = np.random.default_rng(seed), np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    lines = sum(np.sin(2.0 * np.pi * k * time_s / 20.0 + rng.uniform(0.0, 6.28)) for k in range(3, 80, 2))
    smooth = np.convolve(rng.standard_normal(time_s.size), np.hanning(31), "same")
    return 0.02 * (np.asarray(lines) + noise * float(np.std(lines)) * smooth / smooth.std())


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("noise", [0.0, 0.8])
def test_a_plan_of_attitudes_is_found_as_it_flew(seed: int, noise: float) -> None:
    flown = np.concatenate([rest(30.0), multisine(48.0, noise, seed), rest(20.0)])
    quiet = record({"phi_setpoint": flown, "roll_stick": 0.0 * flown}, roll=("roll_stick",))
    assert find_excitations(quiet, "roll") == ()
    planned = replace(quiet, status=Status(planned=((229.5, 278.5),), modes=(("guided", 220.0, 290.0),)))
    (found,) = rich_excitations(planned, "roll")
    assert (found.kind, found.signal, found.origin) == ("multisine", "phi_setpoint", "declared")
    assert found.band_rad_s is not None
    line_rad_s = 2.0 * math.pi / 20.0
    # Noise may hide lines at either end, and adds hardly any.
    assert 2.0 * line_rad_s < found.band_rad_s[0] < 8.0 * line_rad_s
    assert 60.0 * line_rad_s < found.band_rad_s[1] < 90.0 * line_rad_s
    assert excitation_signals(planned, "roll", within=(found.start_s, found.stop_s))[0] == "phi_setpoint"
    # Without the word of the log only a clean copy is a program's.
    guided = replace(quiet, status=Status(modes=(("guided", 229.0, 279.0),)))
    kinds = [maneuver.kind for maneuver in find_excitations(guided, "roll")]
    assert kinds == (["multisine"] if noise == 0.0 else [])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("turn", [1, -1])
def test_a_sweep_on_a_drift_is_found(seed: int, turn: int) -> None:
    """What keeps the place in wind is as large as the sweep, and slower."""
    sweep = embedded(chirp())[::turn]
    rng = np.random.default_rng(seed)
    slow = np.convolve(rng.standard_normal(sweep.size + 1200), np.hanning(1201), "valid")[: sweep.size]
    (found,) = [m for m in find(sweep + 0.08 * slow / slow.std(), channel="phi_setpoint") if m.kind == "sweep"]
    assert found.band_rad_s is not None
    # Below a period of some 4 s the sweep goes with the drift.
    assert found.band_rad_s[0] < 3.0
    assert found.band_rad_s[1] == pytest.approx(BAND[1], rel=0.225)
    assert found.duration_s > 30.0


def test_loops_that_answer_the_sweep_of_another_axis_are_no_excitation() -> None:
    """The sweep of roll turns the vehicle in yaw, and the loop of the heading asks for rates against that."""
    sweep = embedded(chirp())
    answer = np.convolve(sweep, np.exp(-np.arange(100) / 30.0))[: sweep.size]
    logged = {"roll_setpoint_excitation": sweep, "psi_setpoint": 0.0 * sweep, "r_setpoint": 0.4 * answer}
    assert [m.axis for m in find_excitations(record(logged), "roll")] == ["roll"]
    assert find_excitations(record(logged), "yaw") == ()
    alone = {name: values for name, values in logged.items() if not name.startswith("roll")}
    assert [m.signal for m in find_excitations(record(alone), "yaw")] == ["r_setpoint"]


def test_a_busy_pilot_flies_no_sweep() -> None:
    """Nobody tests anything: of 24 flights of two minutes none holds a sweep or a random binary signal."""
    for seed in range(24):
        rate_hz = (10.0, 50.0)[seed % 2]
        rng = np.random.default_rng(seed)
        stick = everyday_stick(level=0.5, duration_s=120.0, sample_rate_hz=rate_hz, rng=rng)
        topic = Topic(
            name="sticks",
            time_s=np.arange(stick.size) / rate_hz,
            channels=(Channel(name="roll_stick", unit="1"),),
            values=stick[None],
        )
        flight = FlightRecord(source=Source(name="a", format="", sha256=""), topics=(topic,))
        assert rich_excitations(flight, "roll") == (), seed


def test_doublets_by_hand_do_not_hide_the_sweep_of_a_program() -> None:
    pair = doublet(amplitude=0.3, pulse_s=0.3, sample_rate_hz=RATE_HZ)
    swept, flown = embedded(chirp()), np.concatenate([pair, rest(8.0)])
    stick = np.concatenate([0.0 * swept, flown])
    inner = np.concatenate([swept, 0.5 * flown])
    both = record({"roll_stick": stick, "phi_setpoint": inner})
    found = find_excitations(both, "roll")
    assert [(m.kind, m.signal) for m in found] == [("sweep", "phi_setpoint"), ("doublet", "roll_stick")]
    # A stick that corrects slowly meanwhile shows a slow sweep of its own, which is the pilot's answer.
    answer = embedded(
        logarithmic_sweep(
            amplitude=0.2,
            band_rad_s=(BAND[0], 6.0),
            duration_s=30.0,
            sample_rate_hz=RATE_HZ,
            constant_s=5.0,
        )
    )
    slow = np.zeros(stick.size)
    slow[: answer.size] = answer[: stick.size]
    answered = record({"roll_stick": slow, "phi_setpoint": inner})
    assert [m.kind for m in find(slow, channel="roll_stick")] == ["sweep"]
    assert [m.signal for m in rich_excitations(answered, "roll")] == ["phi_setpoint"]


@pytest.mark.parametrize(("size", "kinds"), [(0.15, ["sweep"]), (0.5, ["doublet", "sweep"])])
def test_a_hand_that_keeps_the_place_flies_no_doublets_next_to_a_sweep(size: float, kinds: list[str]) -> None:
    push = size * doublet(amplitude=0.1, pulse_s=0.8, sample_rate_hz=RATE_HZ)
    found = find(np.concatenate([rest(5.0), push, rest(5.0), pilot(), rest(5.0)]))
    assert [maneuver.kind for maneuver in found] == kinds
