"""Kinematics: a flight that obeys them is consistent, and each planted error is found inside its spread."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, TimeHistory
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.signal.kinematics import derivative, ingredients, kinematic_consistency, reconstruct
from rotorid.signal.skew import shift
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2 as G

RATE_HZ = 200.0
TIME_S = np.arange(0.0, 60.0, 1.0 / RATE_HZ)


class Tones:
    """A sum of slow tones with exact derivative, so that a twin needs no integration."""

    def __init__(self, seed: int, rms: float) -> None:
        rng = np.random.default_rng(seed)
        self.omega = rng.uniform(1.0, 20.0, 60)[:, None]
        self.phase = rng.uniform(0.0, 2.0 * np.pi, 60)[:, None]
        self.size = rms * np.sqrt(2.0 / 60)

    @property
    def value(self) -> FloatArray:
        return np.asarray(self.size * np.sin(self.omega * TIME_S + self.phase).sum(axis=0))

    @property
    def slope(self) -> FloatArray:
        return np.asarray(self.size * (self.omega * np.cos(self.omega * TIME_S + self.phase)).sum(axis=0))


def flight() -> dict[str, FloatArray]:
    """A motion with large angles: attitude and body velocity chosen, the rest from textbook kinematics."""
    phi, theta, psi = (Tones(seed, 0.2) for seed in range(3))
    u, v, w = (Tones(seed, 1.0) for seed in range(3, 6))
    f, t, y = phi.value, theta.value, psi.value
    p = phi.slope - psi.slope * np.sin(t)
    q = theta.slope * np.cos(f) + psi.slope * np.cos(t) * np.sin(f)
    r = psi.slope * np.cos(t) * np.cos(f) - theta.slope * np.sin(f)
    channels = {"phi": f, "theta": t, "psi": y, "u": u.value, "v": v.value, "w": w.value, "p": p, "q": q, "r": r}
    channels["ax"] = u.slope + q * w.value - r * v.value + G * np.sin(t)
    channels["ay"] = v.slope + r * u.value - p * w.value - G * np.cos(t) * np.sin(f)
    channels["az"] = w.slope + p * v.value - q * u.value - G * np.cos(t) * np.cos(f)
    return channels


def earth(channels: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Velocity in earth axes, row by row of the direction cosines."""
    f, t, y, u, v, w = (channels[name] for name in ("phi", "theta", "psi", "u", "v", "w"))
    sf, cf, st, ct, sy, cy = np.sin(f), np.cos(f), np.sin(t), np.cos(t), np.sin(y), np.cos(y)
    return {
        "velocity_north": ct * cy * u + (sf * st * cy - cf * sy) * v + (cf * st * cy + sf * sy) * w,
        "velocity_east": ct * sy * u + (sf * st * sy + cf * cy) * v + (cf * st * sy - sf * cy) * w,
        "velocity_down": -st * u + sf * ct * v + cf * ct * w,
    }


def history(channels: dict[str, FloatArray]) -> TimeHistory:
    return TimeHistory(
        values=np.stack(list(channels.values())),
        channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in channels),
        sample_rate_hz=RATE_HZ,
        start_s=0.0,
    )


SENSORS = ("p", "q", "r", "ax", "ay", "az")


@pytest.mark.parametrize("axes", ["body", "earth"])
def test_a_true_flight_is_consistent(axes: str) -> None:
    channels = flight()
    if axes == "earth":
        channels = {name: row for name, row in channels.items() if name not in "uvw"} | earth(channels)
    result = kinematic_consistency(history(channels))
    assert [check.channel for check in result.checks] == list(SENSORS)
    assert {finding.kind for finding in result.findings} == {"kinematic_consistency"}
    for check in result.checks:
        # Products of tones reach 60 rad/s, 0.3 per sample, where the derivative of the spline is 0.3^4/180 short.
        assert check.scale == pytest.approx(1.0, abs=1e-4)
        assert abs(check.lag_s) <= 1e-5
        assert abs(check.bias) <= 1e-3


@pytest.mark.parametrize("name", SENSORS)
def test_scale_bias_and_lag_of_one_sensor_are_found(name: str) -> None:
    rng = np.random.default_rng(7)
    channels = flight()
    channels[name] = 1.15 * channels[name] + 0.3
    channels = {key: row + 0.02 * np.std(row) * rng.standard_normal(row.size) for key, row in channels.items()}
    # The sensor under test is not an ingredient of its own expectation; late rates would spoil the forces.
    late = shift(history(channels), name, 12e-3)
    result = kinematic_consistency(late, band_rad_s=(2.0, 20.0))
    (check,) = (check for check in result.checks if check.channel == name)
    assert abs(check.scale - 1.15) <= 4.0 * check.scale_std
    assert check.scale_std < 0.02
    assert abs(check.lag_s - 12e-3) <= 4.0 * check.lag_std_s
    assert check.lag_std_s < 1e-3
    # The bias is that at the working point: a scale on the mean of az counts.
    mean = flight()[name].mean()
    assert abs(check.bias - 0.3 - 0.15 * mean) <= 4.0 * check.bias_std + 1e-2
    (finding,) = (finding for finding in result.findings if finding.where == name)
    assert (finding.kind, finding.severity) == ("kinematic_inconsistency", "warning")
    assert finding.numbers["scale"] == check.scale


def test_small_errors_are_no_warning() -> None:
    channels = flight()
    channels["q"] = 1.04 * channels["q"]
    findings = kinematic_consistency(shift(history(channels), "q", 0.9 / RATE_HZ)).findings
    assert {f.severity for f in findings if f.where == "q"} == {"info"}


def test_a_wrong_sign_is_named() -> None:
    channels = flight()
    channels["r"] = -channels["r"]
    result = kinematic_consistency(history({name: channels[name] for name in ("phi", "theta", "psi", "r")}))
    assert result.checks[0].scale == pytest.approx(-1.0, abs=1e-4)
    assert result.findings[0].kind == "kinematic_inconsistency"
    assert "opposite" in result.findings[0].message


def test_what_is_missing_or_silent_is_not_checked() -> None:
    channels = flight()
    assert kinematic_consistency(history({"p": channels["p"]})).checks == ()
    noise = np.random.default_rng(0).standard_normal(TIME_S.size)
    result = kinematic_consistency(history({"theta": channels["theta"], "q": noise}))
    assert result.checks == ()
    assert [(finding.kind, finding.where) for finding in result.findings] == [("kinematics_unchecked", "q")]


def test_a_lag_that_filters_explain_is_no_warning() -> None:
    late = shift(history(flight()), "q", 12e-3)
    for known, severity in (((0.0, 11e-3), "info"), ((0.0, 2e-3), "warning"), ((20e-3, 25e-3), "warning")):
        result = kinematic_consistency(late, channels=("q",), known_lag_s={"q": known})
        assert [finding.severity for finding in result.findings] == [severity]
    assert "known filters lag 20.0 to 25.0 ms" in result.findings[0].message


def hovering(*, damping: float, error: float) -> dict[str, FloatArray]:
    """A hover in which drag is what tilt and acceleration leave, with a velocity whose scale is wrong."""
    v = Tones(4, 0.1)
    drag = -damping * v.value
    # v' = ay + g sin(phi): the tilt is what velocity and drag ask for.
    channels = dict.fromkeys(("p", "q", "r", "u", "w", "theta"), np.zeros(TIME_S.size))
    return channels | {"v": (1.0 + error) * v.value, "phi": np.arcsin((v.slope - drag) / G), "ay": drag}


def test_errors_of_terms_that_nearly_cancel_are_weighed_by_what_is_left() -> None:
    damping, error = 2.0, 0.02
    channels = hovering(damping=damping, error=error)
    (check,) = kinematic_consistency(history(channels), channels=("ay",), band_rad_s=(2.0, 20.0)).checks
    # -d v + e v' is late by e / d against -d v, to first order: two samples here, which would be a warning elsewhere.
    assert check.lag_s == pytest.approx(-error / damping, rel=0.1)
    assert abs(check.lag_s) > 1.5 / RATE_HZ
    assert check.cancellation > 2.0
    assert check.verdict == "consistent"
    channels["ay"] = 2.0 * channels["ay"]
    (check,) = kinematic_consistency(history(channels), channels=("ay",)).checks
    assert check.verdict == "inconsistent"


def test_no_verdict_is_given_where_terms_cancel() -> None:
    result = kinematic_consistency(history(hovering(damping=0.2, error=0.0)), channels=("ay",))
    (check,) = result.checks
    assert check.cancellation > 10.0
    assert check.verdict == "uncertain"
    (finding,) = result.findings
    assert (finding.kind, finding.severity) == ("kinematics_unchecked", "info")
    assert "its terms cancel" in finding.message


def test_body_velocities_are_turned_exactly() -> None:
    channels = flight()
    seen = earth(channels) | {name: channels[name] for name in ("phi", "theta", "psi")}
    made = reconstruct(history(seen))
    for name in ("u", "v", "w"):
        # Attitudes up to a radian: the rotation is that of direction cosines, not of small angles.
        np.testing.assert_allclose(made[name], channels[name], atol=1e-12)
    assert (
        made.channels[made.names.index("w")].source
        == "reconstructed from velocity_north, velocity_east, velocity_down and attitude"
    )


def test_accelerations_follow_from_earth_velocities_too() -> None:
    channels = flight()
    rest = {name: channels[name] for name in ("phi", "theta", "psi", *SENSORS)}
    made = reconstruct(history(earth(channels) | rest))
    np.testing.assert_allclose(made["v_dot"], reconstruct(history(channels))["v_dot"], atol=1e-11)


def test_ingredients_name_what_is_needed() -> None:
    assert ingredients("q_dot", []) == ("q",)
    assert ingredients("u_dot", ["u", "v", "w"]) == ("ax", "ay", "az", "p", "q", "r", "phi", "theta", "u", "v", "w")
    assert ingredients("u_dot", ["u"])[-4:] == ("velocity_north", "velocity_east", "velocity_down", "psi")
    assert ingredients("thrust_command", ["p"]) == ()


def test_accelerations_are_reconstructed_without_trim() -> None:
    made = reconstruct(history(flight()))
    for seed, name in enumerate(("u_dot", "v_dot", "w_dot"), start=3):
        slope = Tones(seed, 1.0).slope
        # Exact but for rounding: specific force, rates and velocities are the twin's own.
        np.testing.assert_allclose(made[name], slope - slope.mean(), atol=1e-12)
        channel = made.channels[made.names.index(name)]
        assert channel.unit == "m/s^2"
        assert channel.source.startswith("reconstructed from a")
    assert made.names[-6:] == ("p_dot", "q_dot", "r_dot", "u_dot", "v_dot", "w_dot")
    assert made.processing[-1] == "p_dot, q_dot, r_dot, u_dot, v_dot, w_dot reconstructed"


def test_what_is_logged_is_not_reconstructed() -> None:
    given = history({"q": np.sin(TIME_S), "q_dot": np.full(TIME_S.size, 7.0), "p": np.cos(TIME_S)})
    made = reconstruct(given)
    assert made.names == ("q", "q_dot", "p", "p_dot")
    np.testing.assert_array_equal(made["q_dot"], 7.0)
    with pytest.raises(UsageError, match="nothing can be reconstructed"):
        reconstruct(history({"theta": TIME_S}))


@pytest.mark.parametrize("rate_hz", [50.0, 100.0])
def test_the_derivative_has_the_gain_of_its_docstring(rate_hz: float) -> None:
    time_s = np.arange(0.0, 20.0, 1.0 / rate_hz)
    x = 30.0 / rate_hz
    made = derivative(np.sin(30.0 * time_s), rate_hz)
    gain = 3.0 * np.sin(x) / (x * (2.0 + np.cos(x)))
    # The ends of the spline fade by 0.27 per sample.
    np.testing.assert_allclose(made[50:-50], gain * 30.0 * np.cos(30.0 * time_s)[50:-50], atol=1e-9)


def test_holes_are_refused() -> None:
    holed = history({"theta": np.where(TIME_S > 30.0, np.nan, 0.0), "q": TIME_S})
    with pytest.raises(InsufficientDataError, match="finite"):
        kinematic_consistency(holed)


def test_the_history_is_not_changed() -> None:
    given = history(flight())
    before = replace(given).values
    reconstruct(given)
    kinematic_consistency(given)
    np.testing.assert_array_equal(given.values, before)


@pytest.mark.parametrize(
    ("seed", "name", "plane"),
    [
        (3, "u_dot", ("ax", "q", "theta", "u", "w")),
        (5, "w_dot", ("az", "q", "theta", "u", "w")),
        (4, "v_dot", ("ay", "p", "phi", "v")),
    ],
)
def test_accelerations_of_one_plane_follow_from_its_channels(seed: int, name: str, plane: tuple[str, ...]) -> None:
    moved = flight()
    f, t, u, v, w = (moved[channel] for channel in ("phi", "theta", "u", "v", "w"))
    slope = {channel: Tones(row, 1.0).slope for row, channel in enumerate(("u", "v", "w"), start=3)}
    # In one plane the angles and speeds of the other rest.
    q, p = Tones(1, 0.2).slope, Tones(0, 0.2).slope
    rest = {"q": q, "p": p, "phi": f, "theta": t, "u": u, "v": v, "w": w}
    rest |= {"ax": slope["u"] + q * w + G * np.sin(t), "az": slope["w"] - q * u - G * np.cos(t)}
    rest["ay"] = slope["v"] - G * np.sin(f)
    assert ingredients(name, plane) == plane
    made = reconstruct(history({channel: rest[channel] for channel in plane}))
    expected = Tones(seed, 1.0).slope
    np.testing.assert_allclose(made[name], expected - expected.mean(), atol=1e-12)
    assert "the other plane taken as at rest" in made.channels[made.names.index(name)].source
