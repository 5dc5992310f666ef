"""One clock: nothing changes that need not, and everything that was done is said."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.errors import InsufficientDataError
from rotorid.signal.clock import Conditioned, resample
from rotorid.typing import FloatArray


def topic(name: str, time_s: FloatArray, **channels: FloatArray) -> Topic:
    return Topic(
        name=name,
        time_s=time_s,
        channels=tuple(Channel(name=channel, unit=STANDARD_UNITS[channel], source=name) for channel in channels),
        values=np.stack(list(channels.values())),
    )


def record(*topics: Topic) -> FlightRecord:
    return FlightRecord(source=Source(name="a.ulg", format="ulog", sha256="0" * 64), topics=topics)


def stamps(rate_hz: float, duration_s: float = 20.0, start_s: float = 100.0) -> FloatArray:
    return start_s + np.arange(round(duration_s * rate_hz)) / rate_hz


def kinds(conditioned: Conditioned) -> Mapping[str, Mapping[str, float]]:
    return {finding.kind: finding.numbers for finding in conditioned.findings}


def smooth(time_s: FloatArray) -> FloatArray:
    return np.asarray(np.sin(2.0 * np.pi * 5.0 * time_s))


@pytest.mark.parametrize(("start_s", "stop_s"), [(100.0, 120.0), (103.0, 108.0), (0.0, 1e3)])
def test_a_log_with_one_clock_passes_unchanged(start_s: float, stop_s: float) -> None:
    time_s, values = stamps(250.0), np.random.default_rng(0).standard_normal((2, 5000))
    made = resample(
        record(topic("t", time_s, p=values[0], roll_command=values[1])),
        channels=("roll_command", "p"),
        start_s=start_s,
        stop_s=stop_s,
    )
    (history,) = made.histories
    first = int(np.searchsorted(time_s, start_s))
    count = history.values.shape[1]
    assert history.start_s == time_s[first]
    assert count >= min(stop_s - start_s, 20.0) * 250.0 - 1
    np.testing.assert_array_equal(history["p"], values[0, first : first + count])
    np.testing.assert_array_equal(history["roll_command"], values[1, first : first + count])
    assert history.sample_rate_hz == pytest.approx(250.0, rel=1e-10)
    assert [finding.kind for finding in made.findings] == (["segment_trimmed"] if stop_s > 120.0 else [])


def test_jitter_is_taken_out_by_the_spline() -> None:
    """A cubic spline errs by at most 5/384 h^4 |f''''|, with h the longest step."""
    rng = np.random.default_rng(1)
    time_s = stamps(200.0) + rng.uniform(-0.001, 0.001, 4000)
    made = resample(record(topic("t", time_s, p=smooth(time_s))), channels=("p",), start_s=100.0, stop_s=120.0)
    (history,) = made.histories
    bound = 5.0 / 384.0 * np.diff(time_s).max() ** 4 * (2.0 * np.pi * 5.0) ** 4
    inner = slice(20, -20)
    assert np.abs(history["p"] - smooth(history.time_s))[inner].max() <= bound
    # The mean step of N jittery stamps is known to the jitter over N steps.
    assert history.sample_rate_hz == pytest.approx(200.0, rel=0.002 / 20.0 + 1e-9)


def thinned(tone_hz: float) -> tuple[FloatArray, FloatArray]:
    fast, slow = stamps(1000.0), stamps(100.0)
    flight = record(
        topic("fast", fast, p=np.sin(2.0 * np.pi * tone_hz * fast)), topic("slow", slow, roll_command=0.0 * slow)
    )
    (history,) = resample(flight, channels=("p", "roll_command"), start_s=105.0, stop_s=115.0).histories
    assert history.sample_rate_hz == pytest.approx(100.0)
    return history.time_s, history["p"]


def test_thinning_removes_what_would_fold() -> None:
    _, values = thinned(70.0)
    assert np.abs(values).max() <= 0.01


def test_thinning_keeps_what_is_slow_without_phase() -> None:
    time_s, values = thinned(5.0)
    # Least squares on cosine and sine: the cosine is the phase.
    basis = np.stack([np.sin(2.0 * np.pi * 5.0 * time_s), np.cos(2.0 * np.pi * 5.0 * time_s)]).T
    in_phase, quadrature = np.linalg.lstsq(basis, values, rcond=None)[0]
    assert in_phase == pytest.approx(1.0, abs=1e-3)
    # A symmetric filter has no phase at all; what is left is rounding of the stamps and the spline.
    assert abs(quadrature) <= 1e-6


def test_the_slowest_channel_sets_the_rate_and_is_named() -> None:
    fast, slow = stamps(400.0), stamps(50.0)
    flight = record(topic("fast", fast, p=smooth(fast)), topic("slow", slow, roll_command=smooth(slow)))
    made = resample(flight, channels=("p", "roll_command"), start_s=100.0, stop_s=120.0)
    (history,) = made.histories
    assert history.sample_rate_hz == pytest.approx(50.0)
    np.testing.assert_array_equal(history["roll_command"], smooth(slow)[: history.values.shape[1]])
    assert kinds(made)["rate_too_low"] == pytest.approx({"rate_hz": 50.0, "fastest_hz": 400.0})


@pytest.mark.parametrize(
    ("names", "warned"),
    [(("phi_setpoint", "phi"), False), (("p_setpoint", "p"), True), (("phi_setpoint", "roll_command"), True)],
)
def test_a_slow_log_shows_the_delay_of_a_whole_loop(names: tuple[str, str], warned: bool) -> None:
    time_s = stamps(10.0)
    flight = record(topic("slow", time_s, **{name: smooth(time_s) for name in names}))
    made = resample(flight, channels=names, start_s=100.0, stop_s=119.0)
    assert ("rate_too_low" in kinds(made)) == warned


def test_a_follower_does_not_set_the_rate() -> None:
    fast, slow = stamps(200.0), stamps(10.0)
    flight = record(topic("fast", fast, p=smooth(fast)), topic("slow", slow, roll_excitation=slow))
    made = resample(flight, channels=("p",), auxiliary=("roll_excitation",), start_s=100.0, stop_s=119.0)
    (history,) = made.histories
    assert history.sample_rate_hz == pytest.approx(200.0)
    np.testing.assert_allclose(history["roll_excitation"], history.time_s, atol=1e-9)
    assert "rate_too_low" not in kinds(made)


def test_a_rate_can_be_given() -> None:
    time_s = stamps(200.0)
    made = resample(
        record(topic("t", time_s, p=smooth(time_s))), channels=("p",), start_s=100.0, stop_s=119.0, sample_rate_hz=50.0
    )
    assert made.histories[0].sample_rate_hz == 50.0


def without(time_s: FloatArray, *holes: tuple[float, float]) -> FloatArray:
    kept = np.ones(time_s.size, dtype=bool)
    for low, high in holes:
        kept &= (time_s <= low + 1e-6) | (time_s >= high - 1e-6)
    return time_s[kept]


def test_a_short_gap_is_bridged_and_said() -> None:
    time_s = without(stamps(200.0), (110.0, 110.05))
    made = resample(record(topic("t", time_s, p=smooth(time_s))), channels=("p",), start_s=100.0, stop_s=120.0)
    (history,) = made.histories
    bound = 5.0 / 384.0 * 0.05**4 * (2.0 * np.pi * 5.0) ** 4
    assert np.abs(history["p"] - smooth(history.time_s))[20:-20].max() <= bound
    assert kinds(made)["gap"] == pytest.approx({"gaps": 1.0, "longest_s": 0.05})
    assert [finding.severity for finding in made.findings] == ["info"]


def test_a_long_gap_splits_and_is_said() -> None:
    time_s = without(stamps(200.0), (108.0, 110.0))
    made = resample(record(topic("t", time_s, p=smooth(time_s))), channels=("p",), start_s=100.0, stop_s=120.0)
    spans = [(h.start_s, h.time_s[-1]) for h in made.histories]
    np.testing.assert_allclose(spans, [(100.0, 108.0), (110.0, 119.995)], atol=1e-6)
    assert kinds(made)["gap"] == pytest.approx({"gaps": 1.0, "longest_s": 2.0})
    assert [finding.severity for finding in made.findings] == ["warning"]


@pytest.mark.parametrize("inner", [(106.0, 107.0), (104.0, 106.0), (109.0, 112.0), (105.0, 110.0)])
def test_gaps_of_several_channels_may_overlap(inner: tuple[float, float]) -> None:
    outer = (105.0, 110.0)
    first, second = without(stamps(200.0), outer), without(stamps(200.0), inner)
    flight = record(topic("a", first, p=smooth(first)), topic("b", second, roll_command=smooth(second)))
    made = resample(flight, channels=("p", "roll_command"), start_s=100.0, stop_s=120.0)
    low, high = min(outer[0], inner[0]), max(outer[1], inner[1])
    spans = [(h.start_s, h.time_s[-1]) for h in made.histories]
    np.testing.assert_allclose(spans, [(100.0, low), (high, 119.995)], atol=1e-6)


def test_the_longest_piece_is_taken_and_none_is_an_error() -> None:
    time_s = without(without(stamps(200.0), (100.6, 102.0)), (106.0, 108.0))
    flight = record(topic("t", time_s, p=smooth(time_s)))
    made = resample(flight, channels=("p",), start_s=100.0, stop_s=120.0)
    assert made.longest.start_s == pytest.approx(108.0)
    made = resample(flight, channels=("p",), start_s=100.0, stop_s=102.5)
    with pytest.raises(InsufficientDataError, match="gaps leave nothing"):
        _ = made.longest


def test_repeated_and_reversed_stamps_are_left_out_and_counted() -> None:
    time_s = stamps(200.0).copy()
    values = smooth(time_s)
    time_s[1000], values[1000] = time_s[999], 50.0
    time_s[2000:2002] -= 0.5
    values[2000:2002] = -50.0
    made = resample(record(topic("t", time_s, p=values)), channels=("p",), start_s=100.0, stop_s=120.0)
    (history,) = made.histories
    assert kinds(made)["clock_disorder"] == {"samples": 3.0}
    assert np.abs(history["p"]).max() < 1.01


def test_missing_samples_are_a_gap() -> None:
    time_s = stamps(200.0)
    values = smooth(time_s)
    values[1500:1504] = np.nan
    made = resample(record(topic("t", time_s, p=values)), channels=("p",), start_s=100.0, stop_s=120.0)
    assert np.isfinite(made.histories[0].values).all()
    assert kinds(made)["gap"] == pytest.approx({"gaps": 1.0, "longest_s": 0.025})


def test_the_preferred_topic_is_used_for_as_long_as_it_lasts() -> None:
    full, part = stamps(100.0), stamps(100.0, duration_s=8.0)
    flight = record(topic("best", part, p=np.ones(part.size)), topic("other", full, p=np.full(full.size, 2.0)))
    inside = resample(flight, channels=("p",), start_s=101.0, stop_s=107.0)
    beyond = resample(flight, channels=("p",), start_s=101.0, stop_s=118.0)
    assert set(inside.histories[0]["p"]) == {1.0}
    assert set(beyond.histories[0]["p"]) == {2.0}
    assert inside.histories[0].channels[0].source == "best"


@pytest.mark.parametrize("build", [lambda t: t, np.flip])
def test_a_heading_does_not_jump(build: Callable[[FloatArray], FloatArray]) -> None:
    time_s = stamps(100.0)
    heading = build(0.9 * (time_s - 100.0))
    wrapped = (heading + np.pi) % (2.0 * np.pi) - np.pi
    made = resample(record(topic("t", time_s, psi=wrapped)), channels=("psi",), start_s=100.0, stop_s=120.0)
    unwrapped = made.histories[0]["psi"]
    np.testing.assert_allclose(unwrapped - unwrapped[0], (heading - heading[0])[: unwrapped.size], atol=1e-9)


def test_a_channel_that_is_not_there_is_an_error_with_its_finding() -> None:
    time_s = stamps(100.0)
    with pytest.raises(
        InsufficientDataError, match=r"a\.ulg has no q; this needs the channel q; there are p"
    ) as caught:
        resample(record(topic("t", time_s, p=time_s)), channels=("p", "q"), start_s=100.0, stop_s=120.0)
    assert [finding.kind for finding in caught.value.findings] == ["missing_channel"]


@pytest.mark.parametrize("start_s", [200.0, 120.5, 119.991])
def test_a_channel_that_is_not_there_in_this_interval_is_an_error(start_s: float) -> None:
    time_s = stamps(100.0)
    with pytest.raises(InsufficientDataError, match="has no p"):
        resample(record(topic("t", time_s, p=time_s)), channels=("p",), start_s=start_s, stop_s=start_s + 10.0)


@pytest.mark.parametrize("pause_s", [0.1, 1.0, 3600.0])
@pytest.mark.parametrize("burst_s", [1e-9, 1e-6, 1e-4])
def test_no_clock_has_many_more_samples_than_were_logged(burst_s: float, pause_s: float) -> None:
    """Messages stamped on arrival: ten at once, then none for a while."""
    time_s = np.sort((np.arange(300)[:, None] * pause_s + np.arange(10) * burst_s).ravel())
    made = resample(
        record(topic("t", time_s, p=smooth(time_s), roll_command=smooth(time_s))),
        channels=("roll_command", "p"),
        start_s=0.0,
        stop_s=float(time_s[-1]),
    )
    assert sum(history.values.shape[1] for history in made.histories) <= 4 * time_s.size + 10
    assert all(np.isfinite(history.values).all() for history in made.histories)
    assert ("clock_disorder" in kinds(made)) == (pause_s == 0.1)


def test_a_jump_of_the_clock_splits_the_data() -> None:
    time_s = stamps(250.0)
    time_s[2500:] += 2e5
    made = resample(
        record(topic("t", time_s, p=smooth(time_s), roll_command=smooth(time_s))),
        channels=("roll_command", "p"),
        start_s=0.0,
        stop_s=1e6,
    )
    assert [history.values.shape[1] for history in made.histories] == [2500, 2500]
    assert kinds(made)["gap"]["longest_s"] == pytest.approx(2e5, rel=1e-4)


def test_a_burst_on_a_long_clock_costs_no_more_than_its_samples() -> None:
    burst, slow = topic("burst", np.arange(64) * 1e-6, p=np.zeros(64)), np.array([0.0, 1e5, 2e5])
    conditioned = resample(
        record(burst, topic("slow", slow, q=np.zeros(3))), channels=["p", "q"], start_s=0.0, stop_s=2e5
    )
    assert sum(history.values.shape[1] for history in conditioned.histories) <= 3


def test_a_gap_across_the_end_of_a_segment_is_a_gap() -> None:
    """A segment that ends in thirty years without a sample asked for a clock of 107 GiB."""
    time_s = np.concatenate([stamps(250.0)[:1000], 1e9 + stamps(250.0)[:1000]])
    made = resample(
        record(topic("t", time_s, p=smooth(time_s), roll_command=smooth(time_s))),
        channels=("roll_command", "p"),
        start_s=0.0,
        stop_s=0.9e9,
    )
    assert [history.values.shape[1] for history in made.histories] == [1000]
    late = resample(
        record(topic("t", time_s, p=smooth(time_s), roll_command=smooth(time_s))),
        channels=("roll_command", "p"),
        start_s=float(time_s[999]) + 1.0,
        stop_s=2e9,
    )
    assert [history.values.shape[1] for history in late.histories] == [1000]
