"""Margins of a review by a Betaflight loop that is known exactly, as a blackbox logs it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Status, Topic
from rotorid.errors import InsufficientDataError
from rotorid.flights.whole_flights import flown
from rotorid.loops.rate_loops import read_margins
from rotorid.models.autopilots.betaflight import BASE, TOP
from rotorid.models.autopilots.reading import axis_controller
from rotorid.models.controller import RateController
from rotorid.reviewing.margins import margins
from rotorid.reviewing.missing import Unavailable
from rotorid.reviewing.values import MarginReview
from rotorid.tuning.loops import loop_figures
from rotorid.tuning.plant import certain_plant
from rotorid.typing import ComplexArray, FloatArray

RATE_HZ, LENGTH_S, THROTTLE = 1000.0, 40.0, 0.3
FIRMWARE = "Betaflight 4.3.1 (8d4f005) STM32F7X2"
HEADER = {
    "rollPID_P": 50.0,
    "rollPID_I": 65.0,
    "rollPID_D": 45.0,
    "d_min_0": 30.0,
    "ff_weight_0": 0.0,
    "dterm_lpf1_type": 0.0,
    "dterm_lpf1_dyn_hz_0": 75.0,
    "dterm_lpf1_dyn_hz_1": 150.0,
    "dterm_lpf2_type": 0.0,
    "dterm_lpf2_static_hz": 150.0,
    "iterm_relax": 1.0,
    "looptime": 1000.0,
    "pid_process_denom": 1.0,
}


def plant(omega_rad_s: FloatArray) -> ComplexArray:
    s = 1j * omega_rad_s
    return np.asarray(1000.0 / ((s + 2.0) * (1.0 + 0.012 * s)) * np.exp(-0.0045 * s))


def controller(name: str) -> RateController:
    found = axis_controller(HEADER, "roll", firmware=FIRMWARE, throttle=THROTTLE)
    assert found is not None
    return found.ends[name].rate_loop


def record(*, d_share: float = 1.0, i_share: float = 1.0, p_share: float = 1.0, gust: float = 0.3) -> FlightRecord:
    """A flight in acro: sticks and gusts that repeat after its length, so that the loop is exact line by line."""
    count = int(LENGTH_S * RATE_HZ)
    rng = np.random.default_rng(5)
    omega = 2.0 * math.pi * np.fft.rfftfreq(count, 1.0 / RATE_HZ)
    omega[0] = 1e-3
    top = controller(TOP)
    flew = replace(
        top,
        proportional_s=p_share * top.proportional_s,
        integral=i_share * top.integral,
        derivative_s2=d_share * top.derivative_s2,
    )

    def noise(size: float, corner: float, order: int) -> ComplexArray:
        raw = np.fft.rfft(rng.standard_normal(count)) / np.sqrt(1.0 + (omega / corner) ** (2 * order))
        raw[0] = 0.0
        return np.asarray(raw * size / np.fft.irfft(raw, count).std())

    r, v = noise(3.0, 20.0, 2), noise(gust, 10.0, 1)
    C, C_r, P = flew.response(omega), flew.setpoint_response(omega), plant(omega)
    y = (P * C_r * r + v) / (1.0 + P * C)
    u = C_r * r - C * y
    error = r - y
    parts = {
        "p": replace(flew, integral=0.0, derivative_s2=0.0).response(omega) * error,
        "d": -flew.derivative_response(omega) * y,
    }
    parts["i"] = u - parts["p"] - parts["d"]
    spectra = {"p": y, "p_setpoint": r, "roll_command": u} | {f"roll_{one}_term": parts[one] for one in "pid"}
    columns = {name: np.fft.irfft(values, count) for name, values in spectra.items()}
    columns |= {"thrust_stick": np.full(count, THROTTLE), "roll_stick": columns["p_setpoint"] / 10.0}
    main = Topic(
        name="flight 1",
        time_s=np.arange(count) / RATE_HZ,
        channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in columns),
        values=np.stack(list(columns.values())),
    )
    whole = ((0.0, LENGTH_S),)
    return FlightRecord(
        source=Source(name="flight.bbl", format="Betaflight blackbox", sha256="", firmware=FIRMWARE),
        topics=(main,),
        parameters=HEADER,
        status=Status(vehicle="multirotor", armed=whole, in_air=whole, flagged_in="twin", direct_rates=whole),
    )


def exact(name: str) -> dict[str, float]:
    omega = np.geomspace(1.0, 900.0, 40_000)
    loop = plant(omega) * controller(name).response(omega)
    last = int(np.flatnonzero(np.abs(loop) > 1.0)[-1])
    turn = int(np.flatnonzero((loop.imag[:-1] < 0.0) & (loop.imag[1:] >= 0.0) & (np.abs(loop[1:]) < 1.0))[0])
    return {
        "crossover_rad_s": float(omega[last]),
        "phase_margin_deg": math.degrees(float(np.angle(-loop[last]))),
        "gain_margin_db": float(-20.0 * np.log10(np.abs(loop[turn]))),
        "sensitivity_peak": float(1.0 / np.abs(1.0 + loop).min()),
    }


def reviewed(flight: FlightRecord) -> tuple[MarginReview | None, tuple[Unavailable, ...]]:
    found, untold = margins(flown(flight))
    return found.get("roll"), tuple(one for one in untold if "roll" in one.what)


@pytest.mark.parametrize(("d_share", "nearest"), [(0.95, TOP), (0.7, BASE)])
def test_both_ends_of_d_are_told_and_the_numbers_are_those_of_the_nearer(d_share: float, nearest: str) -> None:
    found, _ = reviewed(record(d_share=d_share))
    assert found is not None
    assert found.instrument == "direct"
    assert found.throttle == pytest.approx(THROTTLE)
    assert found.controller.derivative_s2 == controller(nearest).derivative_s2
    for name in (BASE, TOP):
        truth, told = exact(name), found.ends[name]
        for key in ("crossover_rad_s", "phase_margin_deg"):
            assert told[key].lower <= truth[key] <= told[key].upper, (name, key)
        # What a model adds, and what a peak is, holds within what they state.
        for key in set(told) & {"gain_margin_db", "sensitivity_peak"}:
            assert abs(told[key].value - truth[key]) < 3.0 * told[key].std, (name, key)
    assert found.numbers["phase_margin_deg"].value == found.ends[nearest]["phase_margin_deg"].value
    # The verdict on the flown gains is by both ends, and by the angle loop too.
    assert found.verdict is not None
    assert found.verdict.usual_peak >= max(end["sensitivity_peak"].value for end in found.ends.values()) - 0.05


def test_an_integral_that_is_taken_back_widens_the_interval_and_is_a_finding() -> None:
    relaxed, _ = reviewed(record(i_share=0.1))
    assert relaxed is not None
    # The numbers are those of the whole integral, as hover has it, and reach to those that flew.
    flew, configured = relaxed.numbers["disturbance_rejection_rad_s"], relaxed.ends[TOP]["disturbance_rejection_rad_s"]
    assert flew.value == configured.value
    assert flew.std > 1.2 * configured.std
    shares = [one.numbers["share"] for one in relaxed.findings if "share" in one.numbers]
    assert shares == [pytest.approx(0.1, abs=0.02)]


def test_a_p_term_that_the_header_does_not_make_has_no_margins() -> None:
    found, (only,) = reviewed(record(p_share=1.3))
    assert found is None
    assert "1.300 ± 0.005 times their P" in only.why


def test_excitations_that_show_too_little_take_nothing_from_the_flight(monkeypatch: pytest.MonkeyPatch) -> None:
    flight = record()
    whole, _ = reviewed(flight)

    def nothing(*_: object) -> None:
        raise InsufficientDataError("the sweep is too short")

    monkeypatch.setattr("rotorid.loops.rate_loops.swept_plant", nothing)
    found, _ = reviewed(flight)
    assert whole is not None
    assert found is not None
    assert found.numbers == whole.numbers


def changed(flight: FlightRecord, channel: str, part: slice, value: float) -> FlightRecord:
    """A flight with other samples in a part of a channel."""
    (main,) = flight.topics
    values = np.array(main.values)
    values[[one.name for one in main.channels].index(channel), part] = value
    return replace(flight, topics=(replace(main, values=values),))


def test_samples_that_are_missing_cost_their_windows_only() -> None:
    found, _ = reviewed(changed(record(), "p", slice(1000, 9000), np.nan))
    assert found is not None
    assert found.explained is not None
    assert found.explained > 0.99
    assert "phase_margin_deg" in found.numbers


def test_a_command_that_the_terms_do_not_make_has_no_margins() -> None:
    found, (only,) = reviewed(changed(record(), "roll_command", slice(None), 0.0))
    assert found is None
    assert "does not follow the sum" in only.why


def test_a_model_below_a_half_turn_at_its_crossover_has_no_peak() -> None:
    """With too strong an integral it is unstable, whatever the size of its sensitivity."""
    omega = np.geomspace(0.5, 600.0, 500)

    def numbers(loop: Callable[[ComplexArray], ComplexArray]) -> set[str]:
        plant = certain_plant(lambda at: np.asarray(loop(1j * at)))
        return set(read_margins(loop_figures(omega, plant.drawn(omega)), plant)[0])

    for unstable in (
        lambda s: 100.0 / s * (0.002 + 1.0 / s) * (1.0 + 8.0 / s) * np.exp(-0.01 * s),
        lambda s: 20.0 / s**2 / (1.0 + 0.05 * s),
    ):
        assert numbers(unstable) == {"crossover_rad_s"}
    assert "sensitivity_peak" in numbers(lambda s: 10.0 / s * np.exp(-0.02 * s))
