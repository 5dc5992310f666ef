"""Verification: the scores, and what a prediction may and may not adjust."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotorid.data.channel import STANDARD_UNITS, Channel
from rotorid.data.history import TimeHistory
from rotorid.data.maneuver import Maneuver
from rotorid.excitation.doublet import doublet
from rotorid.models.rate import RATE_AXES, rate_model
from rotorid.models.state_space import StateSpace
from rotorid.simulate.linear import simulate_linear
from rotorid.typing import FloatArray
from rotorid.verify.scores import nrmse_fit_percent, rms, theil_inequality
from rotorid.verify.time_domain import verify_in_time
from rotorid.verify.verification import Verification

RATE_HZ = 200.0
BAND = (1.0, 40.0)
FROM_REST = doublet(amplitude=0.1, pulse_s=0.3, sample_rate_hz=RATE_HZ, trim_s=1.0)
# A record that begins in the middle of a pulse: a late model still shows what came before.
PULSE = FROM_REST[round(1.1 * RATE_HZ) :]


def system(name: str = "rate.roll", *, gain: float = 60.0, lag: float = 0.05) -> StateSpace:
    axis = RATE_AXES[name]
    return rate_model(name).matrices({axis.gain: gain, axis.damping: -2.0, "T_motor": lag, axis.delay: 0.012})


def history(name: str, u: FloatArray, y: FloatArray) -> TimeHistory:
    axis = RATE_AXES[name]
    channels = tuple(Channel(name=c, unit=STANDARD_UNITS[c]) for c in (axis.input, axis.output))
    return TimeHistory(values=np.stack([u, y]), channels=channels, sample_rate_hz=RATE_HZ, start_s=50.0)


def check(model: StateSpace, flown: TimeHistory, band: tuple[float, float] = BAND) -> Verification:
    given, seen = flown.names
    maneuver = Maneuver(axis="roll", kind="doublet", start_s=50.0, stop_s=50.0 + flown.duration_s)
    return verify_in_time(
        model, flown, inputs=(given,), outputs=(seen,), band_rad_s=band, record="a.ulg", maneuver=maneuver
    )


def flown(name: str, *, trim: float = 0.0, lag: float = 0.05) -> TimeHistory:
    """A flight of the very model: from a moving start, with a torque bias, a trimmed command and a sensor offset."""
    truth = system(name, lag=lag)
    x0, bias = np.array([0.3, 0.02]), np.array([0.7, 0.0])
    before = np.array([PULSE[0]])
    y = simulate_linear(truth, PULSE[None], sample_rate_hz=RATE_HZ, x0=x0, bias=bias, before=before, hold="first")[0]
    return history(name, PULSE + trim, y + 0.25)


@pytest.mark.parametrize("name", RATE_AXES)
@pytest.mark.parametrize("lag", [0.0, 0.05])
@pytest.mark.parametrize("trim", [0.0, 0.4])
def test_the_exact_model_predicts_exactly(name: str, lag: float, trim: float) -> None:
    made = check(system(name, lag=lag), flown(name, trim=trim, lag=lag))
    (scores,) = made.scores.values()
    assert scores.tic < 1e-6
    assert scores.nrmse_fit_percent == pytest.approx(100.0, abs=1e-3)
    assert scores.rms < 1e-6


def test_offset_and_bias_are_estimated_together() -> None:
    """A steady torque ends in a steady rate, as a shifted sensor shows it: of a damped state only the sum is seen."""
    scores = check(system(), flown("rate.roll"), band=(0.01, 40.0)).scores["p"]
    trim = 60.0 * PULSE.mean()
    assert (scores.bias - trim) / 2.0 + scores.reference_shift == pytest.approx(0.7 / 2.0 + 0.25, rel=1e-6)


@pytest.mark.parametrize("factor", [0.5, 2.0, -1.0])
def test_a_wrong_gain_is_seen(factor: float) -> None:
    y = simulate_linear(system(), FROM_REST[None], sample_rate_hz=RATE_HZ, hold="first")[0]
    scores = check(system(gain=60.0 * factor), history("rate.roll", FROM_REST, y)).scores["p"]
    # Without anything to adjust, T = |1 - f| / (1 + |f|): a third for half and for double the gain, one for the sign.
    # The initial state and the offset take up a little of it.
    assert scores.tic == pytest.approx(abs(1.0 - factor) / (1.0 + abs(factor)), rel=0.15)
    assert scores.nrmse_fit_percent == pytest.approx(100.0 * (1.0 - abs(1.0 - factor)), abs=2.0)


def test_nothing_of_the_model_is_adjusted() -> None:
    right, late = system(), system(lag=0.15)
    assert check(late, flown("rate.roll")).scores["p"].tic > 100.0 * check(right, flown("rate.roll")).scores["p"].tic


@pytest.mark.parametrize(("omega", "gain"), [(0.05, 0.0), (6.0, 1.0), (300.0, 0.0)])
def test_the_band_filter_is_zero_phase(omega: float, gain: float) -> None:
    """A tone in the band keeps size and phase; one far below or above it is gone."""
    time_s = np.arange(round(60.0 * RATE_HZ)) / RATE_HZ
    u = 1e-9 * np.random.default_rng(0).standard_normal(time_s.size)
    tone = np.sin(omega * (time_s - 30.0))
    made = check(system(), history("rate.roll", u, tone), band=(0.6, 60.0))
    inner = slice(round(15.0 * RATE_HZ), round(45.0 * RATE_HZ))
    basis = np.stack([np.sin(omega * (time_s - 30.0)), np.cos(omega * (time_s - 30.0))]).T[inner]
    in_phase, quadrature = np.linalg.lstsq(basis, made.measured[0, inner], rcond=None)[0]
    # Second order, there and back: 1 / (1 + (omega / edge)^4), below 2e-4 in the middle of the band.
    assert in_phase == pytest.approx(gain, abs=2e-3)
    assert abs(quadrature) < 1e-4


def test_a_short_maneuver_keeps_its_slow_part() -> None:
    """A high-pass needs 1.5 of its periods; without them the mean of the measurement stays."""
    made = check(system(), flown("rate.roll"), band=(1.0, 40.0))
    assert flown("rate.roll").duration_s * 1.0 / (2.0 * math.pi) < 1.5
    assert made.measured.mean() == pytest.approx(flown("rate.roll")["p"].mean(), rel=1e-3)


def test_the_result_holds_what_was_compared() -> None:
    source = flown("rate.roll", trim=0.4)
    made = check(system(), source)
    np.testing.assert_array_equal(made.time_s, source.time_s)
    assert made.measured.shape == made.predicted.shape == made.inputs.shape == (1, source.time_s.size)
    assert made.inputs.mean() == pytest.approx(0.0, abs=1e-15)
    assert (made.record, made.input_names, made.output_names) == ("a.ulg", ("roll_command",), ("p",))
    assert not made.predicted.flags.writeable
    assert made.scores["p"].rms == pytest.approx(rms(made.measured[0] - made.predicted[0]), rel=1e-12)


class TestScores:
    y = np.array([0.0, 1.0, 2.0, 5.0])
    z = np.array([0.5, 1.0, 1.0, 4.0])

    def test_formulas(self) -> None:
        miss = math.sqrt(0.25 + 1.0 + 1.0)
        assert rms(self.y) == pytest.approx(math.sqrt(30.0 / 4.0), rel=1e-15)
        assert nrmse_fit_percent(self.y, self.z) == pytest.approx(100.0 * (1.0 - miss / math.sqrt(14.0)), rel=1e-12)
        theil = (miss / 2.0) / (math.sqrt(30.0) / 2.0 + math.sqrt(18.25) / 2.0)
        assert theil_inequality(self.y, self.z) == pytest.approx(theil, rel=1e-12)

    def test_ends_of_the_scales(self) -> None:
        assert nrmse_fit_percent(self.y, np.full(4, self.y.mean())) == pytest.approx(0.0, abs=1e-12)
        assert theil_inequality(self.y, self.y) == 0.0
        assert theil_inequality(self.y, -self.y) == 1.0
        assert theil_inequality(self.y, 0.0 * self.y) == 1.0

    def test_signals_that_rest(self) -> None:
        rest = np.ones(3)
        assert nrmse_fit_percent(rest, rest) == 100.0
        assert nrmse_fit_percent(rest, 2.0 * rest) == -np.inf
        assert theil_inequality(0.0 * rest, 0.0 * rest) == 0.0
