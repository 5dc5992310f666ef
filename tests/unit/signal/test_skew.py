"""Time skew: twins of known delay, inside the predicted spread; shifts exact where they can be."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import Channel, TimeHistory
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.signal.skew import (
    Relation,
    coherent_lines,
    cross_spectrum,
    shift,
    time_skew,
)
from rotorid.typing import FloatArray

RATE_HZ = 250.0
COUNT = 15000
SKEW_S = 3.7e-3


def history(**channels: FloatArray) -> TimeHistory:
    return TimeHistory(
        values=np.stack(list(channels.values())),
        channels=tuple(Channel(name=name, unit="1") for name in channels),
        sample_rate_hz=RATE_HZ,
        start_s=100.0,
    )


def white(rng: np.random.Generator, count: int = COUNT) -> FloatArray:
    return rng.standard_normal(count)


def through(values: FloatArray, *, delay_s: float = 0.0, lag_s: float = 0.0, order: int = 0) -> FloatArray:
    """The samples through ``(jω)^order exp(-jω delay) / (jω lag + 1)``, around a period: exact, without an edge."""
    omega = 2.0 * np.pi * np.fft.rfftfreq(values.size, 1.0 / RATE_HZ)
    s = 1j * omega
    s[0] = 1.0
    response = s**order * np.exp(-1j * omega * delay_s) / (1j * omega * lag_s + 1.0)
    response[0] = 0.0
    # The Nyquist line of a real signal cannot hold a phase.
    response[-1] = 0.0
    return np.asarray(np.fft.irfft(np.fft.rfft(values) * response, values.size))


@pytest.mark.parametrize("delay_s", [-SKEW_S, 0.0, 0.4e-3, SKEW_S, 83.21e-3])
def test_a_clean_delay_is_found_far_below_a_sample(delay_s: float) -> None:
    motion = white(np.random.default_rng(0))
    skew = time_skew(history(a=motion, b=through(motion, delay_s=delay_s)), reference="a", delayed="b")
    assert skew.relation == "same"
    # What enters a window at one end and leaves at the other is the only noise; it is in the predicted spread.
    assert abs(skew.seconds - delay_s) <= 4.0 * skew.std + 1e-9
    assert skew.std <= 0.1 / RATE_HZ


@pytest.mark.parametrize("noise", [0.1, 0.7])
def test_the_spread_is_the_predicted_one(noise: float) -> None:
    errors = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        motion = white(rng, 5000)
        a, b = motion + noise * white(rng, 5000), through(motion, delay_s=SKEW_S) + noise * white(rng, 5000)
        skew = time_skew(history(a=a, b=b), reference="a", delayed="b", band_rad_s=(10.0, 300.0), relation="same")
        errors.append((skew.seconds - SKEW_S) / skew.std)
    # 40 normalized errors of a right prediction: rms one within 3/sqrt(80), mean zero within 3/sqrt(40).
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.0, abs=0.34)
    assert abs(np.mean(errors)) <= 0.47


@pytest.mark.parametrize(("lag_s", "widened"), [(0.0, False), (0.03, True)])
def test_a_phase_that_is_no_delay_widens_the_deviation(lag_s: float, widened: bool) -> None:
    """A lag bends the phase away from every straight line; the lines then scatter by more than their noise says."""
    rng = np.random.default_rng(3)
    motion = white(rng)
    data = history(a=motion, b=through(motion, delay_s=SKEW_S, lag_s=lag_s) + 0.05 * white(rng))
    band = (5.0, 300.0)
    skew = time_skew(data, reference="a", delayed="b", band_rad_s=band, relation="same")
    lines = coherent_lines(cross_spectrum(data, "a", "b", band_rad_s=band), "b/a")
    omega, weight = lines.omega_rad_s, lines.weight
    misfit = np.angle(lines.cross * np.exp(1j * omega * skew.seconds))
    of_noise = 1.0 / np.sqrt(np.sum(weight * omega**2))
    of_misfit = of_noise * np.sqrt(np.sum(weight * misfit**2) / (omega.size - 1))
    assert skew.std == pytest.approx(max(of_noise, of_misfit), rel=1e-9)
    assert bool(skew.std > 5.0 * of_noise) is widened


RELATIONS: dict[Relation, tuple[float, int]] = {
    "same": (1.0, 0),
    "opposite": (-1.0, 0),
    "derivative": (1.0, 1),
    "opposite derivative": (-1.0, 1),
    "integral": (1.0, -1),
    "opposite integral": (-1.0, -1),
}


@pytest.mark.parametrize("relation", RELATIONS)
def test_integration_and_sign_are_told_from_delay(relation: Relation) -> None:
    sign, order = RELATIONS[relation]
    motion = white(np.random.default_rng(1))
    other = sign * through(motion, delay_s=SKEW_S, order=order)
    skew = time_skew(history(a=motion, b=other), reference="a", delayed="b", band_rad_s=(5.0, 400.0))
    assert skew.relation == relation
    assert skew.seconds == pytest.approx(SKEW_S, abs=max(4.0 * skew.std, 1e-9))


def flight(seed: int, skew_s: float) -> TimeHistory:
    """Motor → rate through a lag of 48 ms and a delay of 5 ms, and a gyro with noise of its own."""
    rng = np.random.default_rng(seed)
    motor = through(white(rng), lag_s=0.05)
    rate = through(motor, delay_s=0.005, lag_s=0.048, order=-1)
    # At 60 rad/s the rate is 0.0017 of the white noise behind the motor: the gyro's is a tenth of it.
    return history(motor_1=motor, p=through(rate, delay_s=skew_s) + 0.0002 * white(rng))


@pytest.mark.parametrize("seed", range(5))
def test_what_was_injected_between_motor_and_gyro_is_found_between_two_records(seed: int) -> None:
    before, after = (
        time_skew(
            flight(number, skew_s),
            reference="motor_1",
            delayed="p",
            band_rad_s=(3.0, 60.0),
            relation="integral",
            known_lag_s=0.045,
        )
        for number, skew_s in ((2 * seed, 0.0), (2 * seed + 1, SKEW_S))
    )
    # The lag is known roughly and the delay not at all: what is left is in both alike.
    assert abs(before.seconds) > 3e-3
    assert after.seconds - before.seconds == pytest.approx(SKEW_S, abs=0.3e-3)


@pytest.mark.parametrize("seed", range(5))
def test_a_known_vehicle_leaves_the_skew_of_one_record(seed: int) -> None:
    skew = time_skew(
        flight(seed, SKEW_S),
        reference="motor_1",
        delayed="p",
        band_rad_s=(3.0, 60.0),
        known_lag_s=0.048,
        known_delay_s=0.005,
    )
    assert skew.relation == "integral"
    assert skew.seconds == pytest.approx(SKEW_S, abs=0.3e-3)
    assert abs(skew.seconds - SKEW_S) <= 4.0 * skew.std


def test_only_a_sure_skew_of_more_than_a_sample_is_a_warning() -> None:
    motion = white(np.random.default_rng(2))
    short, long = (
        time_skew(history(a=motion, b=through(motion, delay_s=delay_s)), reference="a", delayed="b").findings[0]
        for delay_s in (0.5 / RATE_HZ, 1.5 / RATE_HZ)
    )
    assert (short.kind, short.severity) == ("clock_skew", "info")
    assert (long.kind, long.severity) == ("clock_skew", "warning")
    assert long.numbers["skew_s"] == pytest.approx(6e-3, abs=1e-4)


def test_noise_has_no_skew() -> None:
    rng = np.random.default_rng(3)
    with pytest.raises(InsufficientDataError, match="coherent") as caught:
        time_skew(history(a=white(rng), b=white(rng)), reference="a", delayed="b")
    assert [finding.kind for finding in caught.value.findings] == ["low_coherence"]


def test_wrong_calls_are_refused() -> None:
    pair = history(a=np.arange(400.0), b=np.zeros(400))
    with pytest.raises(UsageError, match="no channel c"):
        time_skew(pair, reference="a", delayed="c")
    with pytest.raises(UsageError, match="empty"):
        time_skew(pair, reference="a", delayed="b", band_rad_s=(5.0, 2.0))
    with pytest.raises(UsageError, match="relation"):
        time_skew(pair, reference="a", delayed="b", relation="cousin")  # type: ignore[arg-type]
    with pytest.raises(InsufficientDataError, match="100 samples"):
        time_skew(history(a=np.ones(100), b=np.ones(100)), reference="a", delayed="b")
    with pytest.raises(InsufficientDataError, match="coherent"):
        time_skew(pair, reference="a", delayed="b")
    with pytest.raises(InsufficientDataError, match="finite"):
        time_skew(history(a=np.full(400, np.nan), b=np.ones(400)), reference="a", delayed="b")


@pytest.mark.parametrize("seconds", [0.0, 1.0 / RATE_HZ, -2.0 / RATE_HZ])
def test_a_shift_by_whole_samples_is_exact(seconds: float) -> None:
    values = white(np.random.default_rng(4), 500)
    other = np.arange(500.0)
    moved = shift(history(a=values, b=other), "a", seconds)
    samples = round(seconds * RATE_HZ)
    first, count = max(samples, 0), 500 - abs(samples)
    np.testing.assert_allclose(moved["a"], values[first - samples :][:count], atol=1e-11)
    np.testing.assert_array_equal(moved["b"], other[first:][:count])
    assert moved.start_s == pytest.approx(100.0 + first / RATE_HZ)
    assert moved.processing[-1].startswith("a delayed by")


def test_a_fractional_shift_of_a_slow_signal() -> None:
    time_s = np.arange(2000) / RATE_HZ

    def motion(t: FloatArray) -> FloatArray:
        return np.asarray(np.sin(20.0 * t) + 0.3 * t)

    moved = shift(history(a=motion(time_s)), "a", SKEW_S)
    kept = moved.time_s - 100.0
    inner = slice(100, -100)
    # The reflection breaks the curvature, (ω h)² per sample²; what that rings falls with the distance from the ends.
    assert np.abs(moved["a"] - motion(kept - SKEW_S))[inner].max() <= (20.0 / RATE_HZ) ** 2 / 100.0


def test_a_shift_takes_an_estimated_skew_out() -> None:
    motion = through(white(np.random.default_rng(5)), lag_s=0.02)
    pair = history(a=motion, b=through(motion, delay_s=SKEW_S))
    skew = time_skew(pair, reference="a", delayed="b")
    left = time_skew(shift(pair, "b", -skew.seconds), reference="a", delayed="b")
    assert abs(left.seconds) <= 4.0 * left.std + 1e-6


def test_wrong_shifts_are_refused() -> None:
    pair = history(a=np.arange(20.0), b=np.full(20, np.nan))
    with pytest.raises(UsageError, match="no channel c"):
        shift(pair, "c", 0.1)
    with pytest.raises(UsageError, match="finite"):
        shift(pair, "a", float("nan"))
    with pytest.raises(InsufficientDataError, match="finite"):
        shift(pair, "b", 0.001)
    with pytest.raises(InsufficientDataError, match="more than the shift"):
        shift(pair, "a", 1.0)
