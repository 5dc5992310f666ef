"""Delays as fractions of a sample."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, cont2discrete, freqz, sosfiltfilt
from tests.unit.fitting.late_lags import INPUT, OUTPUT, RATE_HZ, late_lag, record_of, slower

from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.delay import record as delay_record
from rotorid.fitting.delay.estimate import AIRFRAME_ORDERS, LONGEST_S, _consistent, estimate_delay, input_hold
from rotorid.fitting.delay.fit import DelayedLag, Order
from rotorid.fitting.delay.record import RecordFit, record_spectra
from rotorid.typing import FloatArray

SECOND = (Order(0, 2),)


@pytest.mark.parametrize("order", AIRFRAME_ORDERS, ids=lambda order: order.words)
@pytest.mark.parametrize("hold", ["held", "smooth"])
def test_slopes_of_the_model_are_those_of_small_steps(order: Order, hold: str) -> None:
    model = DelayedLag(order=order, scale_rad_s=5.0, hold=hold, sample_s=0.02)  # type: ignore[arg-type]
    theta = np.random.default_rng(order.coefficients).uniform(0.5, 1.5, size=order.coefficients + 1)
    theta[-1] = 0.03
    omega = np.linspace(0.5, 60.0, 25)
    _, slopes = model.response(theta, omega)
    for index in range(theta.size):
        step = np.zeros(theta.size)
        step[index] = 1e-6
        there, back = model.response(theta + step, omega)[0], model.response(theta - step, omega)[0]
        # Central differences: the third derivative times the square of the step, and rounding over the step.
        np.testing.assert_allclose(slopes[index], (there - back) / 2e-6, rtol=1e-5, atol=1e-8)


@pytest.mark.parametrize("order", AIRFRAME_ORDERS, ids=lambda order: order.words)
def test_factors_have_the_poles_they_are_made_of(order: Order) -> None:
    model = DelayedLag(order=order, scale_rad_s=5.0, hold="smooth", sample_s=0.02)
    poles = np.array([-3.0, -1.0 + 4.0j, -1.0 - 4.0j])[3 - order.poles :].astype(np.complex128)
    if order.poles == 1:
        poles = np.array([-3.0 + 0.0j])
    theta = np.concatenate([np.ones(order.zeros + 1), model.factors(poles, 0.0), [0.0]])
    np.testing.assert_allclose(np.sort_complex(model.poles_rad_s(theta)), np.sort_complex(poles), atol=1e-12)
    mirrored = np.concatenate([np.ones(order.zeros + 1), model.factors(-poles, 0.0), [0.0]])
    assert np.all(model.poles_rad_s(mirrored).real < 0.0)


def test_images_of_a_held_input_are_those_of_exact_sampling() -> None:
    sample_s, pole = 0.05, 8.0
    omega = np.linspace(0.5, 0.5 * np.pi / sample_s, 30)
    above, below, _ = cont2discrete(([pole**2], [1.0, 2.0 * pole, pole**2]), sample_s, method="zoh")
    exact = freqz(np.ravel(above), below, worN=omega * sample_s)[1]
    model = DelayedLag(order=Order(0, 2), scale_rad_s=1.0, hold="held", sample_s=sample_s)
    found, _ = model.response(np.array([pole**2, 2.0 * pole, pole**2, 0.0]), omega)
    # An image at k times the sample rate stands against the response as (omega / (k omega_s))^3 at most, and its two
    # neighbors nearly cancel: at a quarter of the rate the first one that is left out adds (1/16)^3 of it and less.
    assert np.abs(found - exact).max() < 0.25 * 16.0**-3 * np.abs(exact).max()
    assert np.abs(found / exact - 1.0).max() < 16.0 * 16.0**-3


@pytest.mark.parametrize("delay_samples", [0.0, 0.3, 2.7, 6.5])
def test_without_noise_the_delay_is_exact(delay_samples: float) -> None:
    found = estimate_delay([late_lag(1, delay_samples, noise=1e-6)], input=INPUT, output=OUTPUT, orders=SECOND)
    assert found.hold == "held"
    # Images that are left out turn the phase by less than a hundredth of a sample.
    assert found.recommended.delay_s * RATE_HZ == pytest.approx(delay_samples, abs=0.01)


def test_several_records_tell_more_than_one() -> None:
    records = [late_lag(seed, 2.7, samples=400) for seed in range(4)]
    one = estimate_delay(records[:1], input=INPUT, output=OUTPUT, orders=SECOND).recommended
    four = estimate_delay(records, input=INPUT, output=OUTPUT, orders=SECOND).recommended
    assert one.std_s is not None
    assert four.std_s is not None
    assert four.std_s == pytest.approx(0.5 * one.std_s, rel=0.35)


def test_residuals_do_not_see_where_a_record_begins() -> None:
    whole = late_lag(3, 1.4, samples=900, noise=0.0)
    part = record_of(whole[INPUT][217:], whole[OUTPUT][217:])
    data = record_spectra([part], input=INPUT, output=OUTPUT, holds=["held"], delays_s=(-0.1, 0.3), highest_rad_s=40.0)
    model = DelayedLag(order=Order(0, 2), scale_rad_s=9.0, hold="held", sample_s=1.0 / RATE_HZ)
    theta = np.array([1.0, 2.0 * 0.8, 1.0, 1.4 / RATE_HZ])
    residual, _ = RecordFit(data=data, noise=data.white, model=model).residuals(theta)
    level = np.sqrt(2.0) * np.linalg.norm(data.parts[0].output)
    assert np.linalg.norm(residual) < 5e-3 * level


def test_order_is_chosen_and_the_others_stand_beside() -> None:
    found = estimate_delay([late_lag(5, 2.7)], input=INPUT, output=OUTPUT).recommended
    assert found.order == Order(0, 2)
    assert "dead time plus a lag of second order" in found.meaning
    by_order = {fit.order: fit.delay_s for fit in found.orders}
    # A first order calls the second lag delay, a third order takes some of it away.
    assert by_order[Order(0, 1)] > by_order[Order(0, 2)] + 0.02
    assert by_order[Order(0, 3)] < by_order[Order(0, 2)]


def filtered(seed: int, delay_samples: float) -> tuple[FloatArray, FloatArray]:
    whole = late_lag(seed, delay_samples, samples=900, noise=0.02)
    low = butter(6, 7.0, output="sos", fs=2.0 * np.pi * RATE_HZ)
    return whole[INPUT], sosfiltfilt(low, whole[OUTPUT])


def test_a_zero_phase_filter_on_the_output_is_told() -> None:
    records = [record_of(*filtered(seed, 2.0)) for seed in range(2)]
    found = estimate_delay(records, input=INPUT, output=OUTPUT, orders=(Order(0, 1),))
    (finding,) = [finding for finding in found.findings if finding.kind == "acausal_output"]
    assert 4.0 < finding.numbers["cutoff_rad_s"] < 12.0
    assert finding.numbers["hidden_s"] > 0.02
    assert found.as_filtered is not None
    assert found.recommended.band_rad_s is not None
    assert found.recommended.band_rad_s[1] < finding.numbers["cutoff_rad_s"]


@pytest.mark.parametrize("seed", range(3))
def test_an_output_as_measured_is_not_called_filtered(seed: int) -> None:
    found = estimate_delay([late_lag(seed, 0.3)], input=INPUT, output=OUTPUT, orders=SECOND)
    assert found.as_filtered is None
    assert "acausal_output" not in {finding.kind for finding in found.findings}


def test_hold_is_read_from_the_input() -> None:
    time_s = np.arange(0.0, 12.0, 1.0 / RATE_HZ)
    smooth, rest = np.sin(3.0 * time_s), np.where(time_s < 9.0, 0.0, np.sin(3.0 * time_s))
    assert input_hold([late_lag(0, 0.0)], INPUT) == "held"
    assert input_hold([record_of(smooth, smooth)], INPUT) == "smooth"
    assert input_hold([record_of(rest, rest)], INPUT) == "smooth"


def test_wrong_records_are_refused() -> None:
    short = late_lag(0, 0.0, samples=30)
    still = record_of(np.zeros(300), np.random.default_rng(0).normal(size=300))
    with pytest.raises(InsufficientDataError, match="no record"):
        estimate_delay([], input=INPUT, output=OUTPUT)
    with pytest.raises(InsufficientDataError, match="does not move"):
        estimate_delay([still], input=INPUT, output=OUTPUT)
    with pytest.raises(InsufficientDataError, match="lines"):
        estimate_delay([short], input=INPUT, output=OUTPUT)


def test_records_of_different_rates_keep_their_own() -> None:
    fast = late_lag(0, 2.7, samples=1200, hold_samples=6)
    slow = slower(late_lag(1, 2.7, samples=1200, hold_samples=6))
    both, *alone = (
        estimate_delay(records, input=INPUT, output=OUTPUT, orders=SECOND) for records in ([fast, slow], [fast], [slow])
    )
    assert both.hold == "held"
    assert both.sample_s == pytest.approx(2.0 / RATE_HZ)
    # Whole samples of different length are no common measure.
    assert {estimate.method for estimate in both.others} == set()
    assert both.recommended.std_s is not None
    assert all(one.recommended.std_s is not None for one in alone)
    stds = [one.recommended.std_s or np.inf for one in alone]
    # Both together tell as much as two independent measurements do.
    assert both.recommended.std_s == pytest.approx(float(np.sum([std**-2.0 for std in stds])) ** -0.5, rel=0.1)
    assert abs(both.recommended.delay_s - 2.7 / RATE_HZ) < 4.0 * both.recommended.std_s


def test_each_record_has_its_own_hold() -> None:
    held = late_lag(0, 2.7)
    # Forty samples to a period and more: between them the input is as smooth as its samples.
    smooth = np.sin(2.0 * np.pi * np.cumsum(np.linspace(0.1, 1.25, 600)) / RATE_HZ)
    other = record_of(smooth, late_lag(1, 0.0)[OUTPUT])
    assert estimate_delay([held, other], input=INPUT, output=OUTPUT, orders=SECOND).hold == "mixed"


def test_a_frequency_response_of_different_rates_is_refused() -> None:
    fast = late_lag(0, 2.7, samples=900)
    omega = np.linspace(1.0, 30.0, 20)
    response = FrequencyResponse(
        inputs=(INPUT,),
        outputs=(OUTPUT,),
        omega_rad_s=omega,
        values=np.exp(-0.05j * omega)[None, None],
        coherence=np.ones((1, 1, 20)),
        random_error=np.full((1, 1, 20), 0.01),
        covariance=1e-4 * np.eye(20, dtype=np.complex128)[None, None],
        estimate="direct",
        windows_s=(5.0,),
    )
    with pytest.raises(UsageError, match="each rate separately"):
        estimate_delay(
            [fast, slower(fast)],
            input=INPUT,
            output=OUTPUT,
            response=(response, np.ones((1, 1, 20), dtype=np.bool_)),
        )


@pytest.mark.parametrize("seed", range(4))
def test_noise_shows_no_delay(seed: int) -> None:
    u, noise = late_lag(seed, 2.7)[INPUT], np.random.default_rng(100 + seed).normal(size=600)
    found = estimate_delay([record_of(u, noise)], input=INPUT, output=OUTPUT)
    assert [finding.kind for finding in found.findings if finding.severity == "warning"] == ["no_delay"]
    assert found.recommended.unseen


def test_a_delay_beyond_the_limits_is_not_seen() -> None:
    found = estimate_delay([late_lag(0, 25.0, samples=900)], input=INPUT, output=OUTPUT)
    assert 25.0 / RATE_HZ > LONGEST_S
    assert "no_delay" in {finding.kind for finding in found.findings}
    assert "300 ms" in found.recommended.unseen


def test_a_standard_deviation_is_given_only_where_the_interval_is_of_its_width() -> None:
    """Where the poles of a second order merge, the curvature of the cost says nothing about its width."""
    assert _consistent(2.9, (0.08, 0.095)) is None
    assert _consistent(0.004, (0.08, 0.095)) == 0.004


@pytest.mark.slow
def test_merged_lines_say_what_all_of_them_say(monkeypatch: pytest.MonkeyPatch) -> None:
    record = late_lag(2, 2.7, samples=12_000, hold_samples=1)
    merged = estimate_delay([record], input=INPUT, output=OUTPUT, orders=SECOND).recommended
    monkeypatch.setattr(delay_record, "MOST_LINES", 100_000)
    every = estimate_delay([record], input=INPUT, output=OUTPUT, orders=SECOND).recommended
    assert merged.std_s is not None
    assert every.std_s is not None
    assert merged.std_s == pytest.approx(every.std_s, rel=0.02)
    # What merging changes is small beside what noise does.
    assert abs(merged.delay_s - every.delay_s) < 0.1 * every.std_s
    assert abs(merged.delay_s - 2.7 / RATE_HZ) < 4.0 * every.std_s


@pytest.mark.parametrize("samples", [-7, -1, 0, 1, 14])
def test_a_moved_window_has_the_transform_of_its_samples(samples: int) -> None:
    record = late_lag(0, 2.7)
    data = record_spectra([record], input=INPUT, output=OUTPUT, holds=["held"], delays_s=(-0.15, 0.3))
    part = data.thin.parts[0].thinned(9)
    begin = part.first - samples
    direct = np.fft.rfft(record[INPUT][begin : begin + part.count])[part.bins]
    np.testing.assert_allclose(part.input_lines(samples), direct, atol=1e-11)


def test_spectra_are_values() -> None:
    record = late_lag(0, 2.7)
    part = record_spectra([record], input=INPUT, output=OUTPUT, holds=["held"], delays_s=(-0.15, 0.3)).parts[0]
    assert part.equations(1) is part.equations(1)
    for name in ("omega_rad_s", "output", "input", "bins", "drive", "edges"):
        assert not getattr(part, name).flags.writeable, name
    assert not np.shares_memory(part.input, record.values)
