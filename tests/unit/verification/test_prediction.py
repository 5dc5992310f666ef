"""Verification: the scores, and what a prediction may and may not adjust."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, Maneuver, TimeHistory
from rotorid.excitation.switching import doublet
from rotorid.models.library import RATE_AXES, rate_model
from rotorid.models.state_space import StateSpace
from rotorid.simulation.linear import simulate_linear
from rotorid.typing import FloatArray
from rotorid.verification.sampled import LowPass, independent_columns
from rotorid.verification.scores import GUIDELINES, guidelines_met, nrmse_fit_percent, rms, theil_inequality
from rotorid.verification.time_domain import verify_in_time
from rotorid.verification.verification import Scores, Verification

RATE_HZ = 200.0
BAND = (1.0, 40.0)
FROM_REST = doublet(amplitude=0.1, pulse_s=0.3, sample_rate_hz=RATE_HZ, trim_s=1.0)
# A record that begins in the middle of a pulse: a late model still shows what came before.
PULSE = FROM_REST[round(1.1 * RATE_HZ) :]


def system(name: str = "rate.roll", *, gain: float = 60.0, lag: float = 0.05) -> StateSpace:
    axis = RATE_AXES[name]
    values = {axis.gain: gain, axis.damping: -2.0, "T_motor": lag, axis.delay: 0.012, "N_spin": 5.0 * (lag > 0.0)}
    return rate_model(name).matrices(values)


def history(name: str, u: FloatArray, y: FloatArray) -> TimeHistory:
    axis = RATE_AXES[name]
    channels = tuple(Channel(name=c, unit=STANDARD_UNITS[c]) for c in (axis.input, axis.output))
    return TimeHistory(values=np.stack([u, y]), channels=channels, sample_rate_hz=RATE_HZ, start_s=50.0)


def check(
    model: StateSpace,
    flown: TimeHistory,
    band: tuple[float, float] = BAND,
    vibration_filter: LowPass = "auto",
) -> Verification:
    given, seen = flown.names
    maneuver = Maneuver(axis="roll", kind="doublet", start_s=50.0, stop_s=50.0 + flown.duration_s)
    return verify_in_time(
        model,
        flown,
        inputs=(given,),
        outputs=(seen,),
        band_rad_s=band,
        record="a.ulg",
        maneuver=maneuver,
        vibration_filter=vibration_filter,
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


def test_the_shift_takes_what_a_bias_does_to_a_damped_rate() -> None:
    """A steady torque ends in a steady rate, as a shifted sensor shows it: only their sum is seen, and is a shift."""
    scores = check(system(), flown("rate.roll"), band=(0.01, 40.0)).scores["p"]
    trim = 60.0 * PULSE.mean()
    assert scores.bias == 0.0
    assert scores.reference_shift - trim / 2.0 == pytest.approx(0.7 / 2.0 + 0.25, rel=1e-6)


def test_the_ramp_of_an_undamped_rate_is_a_bias() -> None:
    integrator = rate_model("rate.roll").matrices({"L_roll": 60.0, "L_p": 0.0, "T_motor": 0.05, "tau_roll": 0.0})
    u = FROM_REST - FROM_REST.mean()
    y = simulate_linear(
        integrator, u[None], sample_rate_hz=RATE_HZ, bias=np.array([0.7, 0.0]), before=u[:1], hold="first"
    )[0]
    scores = check(integrator, history("rate.roll", u, y + 0.25), band=(0.01, 40.0)).scores["p"]
    assert scores.bias == pytest.approx(0.7, rel=1e-6)
    assert scores.reference_shift == pytest.approx(0.25, rel=1e-6)


@pytest.mark.parametrize("damping", [0.0, -1e-3])
def test_what_the_filter_removes_is_not_estimated(damping: float) -> None:
    """Of a ramp the high-pass leaves rounding noise, which any coefficient could scale up to explain anything."""
    values = {"L_roll": 60.0, "L_p": damping, "T_motor": 0.05, "tau_roll": 0.012}
    u = np.tile(FROM_REST, 6)
    noise = np.random.default_rng(2).standard_normal(u.size)
    model = rate_model("rate.roll").matrices(values)
    y = simulate_linear(model, u[None], sample_rate_hz=RATE_HZ, hold="first")[0] + 0.3 + 0.05 * noise
    scores = check(model, history("rate.roll", u, y), band=(8.0, 40.0)).scores["p"]
    assert (scores.bias, scores.reference_shift) == (0.0, 0.0)
    assert scores.tic < 0.05


class TestGravity:
    """An accelerometer shows g all the time; that a model is told so is no merit of it."""

    def scores(self, model: StateSpace, *, gravity: float = -9.81) -> Scores:
        rng = np.random.default_rng(3)
        truth = rate_model("rate.vertical").matrices(self.values(1.0))
        y = simulate_linear(truth, FROM_REST[None], sample_rate_hz=RATE_HZ, hold="first")[0]
        y = y + gravity + 0.02 * rng.standard_normal(y.size)
        return check(model, history("rate.vertical", FROM_REST, y), band=(0.5, 40.0)).scores["az"]

    @staticmethod
    def values(factor: float, *, damping: float = 0.0) -> dict[str, float]:
        return {"Z_thrust": -20.0 * factor, "Z_w": damping, "T_motor": 0.05, "tau_thrust": 0.012}

    @pytest.mark.parametrize("factor", [0.5, 1.0])
    @pytest.mark.parametrize("damping", [0.0, -0.5])
    def test_scores_do_not_depend_on_gravity(self, factor: float, damping: float) -> None:
        model = rate_model("rate.vertical").matrices(self.values(factor, damping=damping))
        with_g, without = self.scores(model), self.scores(model, gravity=0.0)
        assert with_g.tic == pytest.approx(without.tic, rel=1e-9)
        assert with_g.nrmse_fit_percent == pytest.approx(without.nrmse_fit_percent, abs=1e-6)

    def test_half_the_gain_is_not_good(self) -> None:
        scores = self.scores(rate_model("rate.vertical").matrices(self.values(0.5)))
        # |1 - f| / (1 + f) and 100 f, but for the noise.
        assert scores.tic == pytest.approx(1.0 / 3.0, rel=0.1)
        assert scores.nrmse_fit_percent == pytest.approx(50.0, abs=3.0)
        assert guidelines_met(scores.tic, scores.nrmse_fit_percent) < GUIDELINES

    def test_the_shift_is_all_of_gravity(self) -> None:
        scores = self.scores(rate_model("rate.vertical").matrices(self.values(1.0)))
        assert scores.bias == 0.0
        # The input without its mean, which a doublet hardly has, and the mean of the noise.
        assert scores.reference_shift == pytest.approx(-9.81, abs=0.01)


class TestToldApart:
    """Columns are kept in their order, unless the filter or those before them leave nothing of them."""

    line = np.linspace(-1.0, 1.0, 50)
    columns = np.stack([np.ones(50), np.ones(50) + 1e-4 * line, np.ones(50) + 1e-2 * line, line])

    def test_first_come_first_kept(self) -> None:
        kept = independent_columns(self.columns, np.linalg.norm(self.columns, axis=1))
        assert kept.tolist() == [True, False, True, False]
        turned = independent_columns(self.columns[::-1], np.linalg.norm(self.columns[::-1], axis=1))
        assert turned.tolist() == [True, True, False, False]

    @pytest.mark.parametrize(("left", "kept"), [(0.5e-3, False), (2e-3, True)])
    def test_a_column_must_survive_its_filter(self, left: float, kept: bool) -> None:
        assert independent_columns(left * self.line[None], np.array([np.linalg.norm(self.line)])).tolist() == [kept]

    def test_a_column_of_zeros_is_none(self) -> None:
        assert independent_columns(np.zeros((1, 5)), np.zeros(1)).tolist() == [False]


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
    made = check(system(), history("rate.roll", u, tone), band=(0.6, 60.0), vibration_filter=None)
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

    @pytest.mark.parametrize("factor", [0.2, 0.55, 1.0, 1.45, 1.6, 3.0])
    def test_each_guideline_catches_what_the_other_forgives(self, factor: float) -> None:
        motion = self.y - self.y.mean()
        tic, fit = theil_inequality(motion, factor * motion), nrmse_fit_percent(motion, factor * motion)
        # TIC up to 0.25 means 3/5 to 5/3 of the size, a fit of 50 % means 1/2 to 3/2.
        assert guidelines_met(tic, fit) == int(3 / 5 <= factor <= 5 / 3) + int(1 / 2 <= factor <= 3 / 2)

    def test_signals_that_rest(self) -> None:
        rest = np.ones(3)
        assert nrmse_fit_percent(rest, rest) == 100.0
        assert nrmse_fit_percent(rest, 2.0 * rest) == -np.inf
        assert theil_inequality(0.0 * rest, 0.0 * rest) == 0.0
