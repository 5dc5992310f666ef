"""Speed damping in two steps: the value of a known response, and what is said about it."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Maneuver, Source, Topic
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.fits.frequency.speed_damping import FirstStep, first_step, without_first
from rotorid.flights.flights import Flight
from rotorid.models.library import library_model, rate_model
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.resolve import require_known
from rotorid.typing import Axis, FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

RATE_HZ = 50.0
SAMPLES = 6000
X_U, Y_V = -0.6, -0.35


def flight(*axes: Axis, noise: float = 0.02, without: str = "") -> list[Flight]:
    """One log with a stretch of each axis in turn; attitudes are noise up to 2 Hz, accelerations what follows."""
    rng = np.random.default_rng(3)
    omega = 2.0 * np.pi * np.fft.rfftfreq(SAMPLES, 1.0 / RATE_HZ)
    columns: dict[str, list[FloatArray]] = {name: [] for name in ("theta", "u_dot", "phi", "v_dot") if name != without}
    maneuvers = []
    for place, axis in enumerate(axes):
        for angle, speed, damping, sign, own in (
            ("theta", "u_dot", X_U, -1.0, "pitch"),
            ("phi", "v_dot", Y_V, 1.0, "roll"),
        ):
            spectrum = np.fft.rfft(rng.standard_normal(SAMPLES)) * (omega < 4.0 * np.pi) * (axis == own)
            push = sign * STANDARD_GRAVITY_M_S2 * 1j * omega / (1j * omega - damping)
            moved = {angle: spectrum, speed: push * spectrum}
            for name in moved.keys() & columns.keys():
                quiet = noise * rng.standard_normal(SAMPLES) * (name == speed)
                columns[name].append(np.fft.irfft(moved[name], SAMPLES) + quiet)
        start_s = place * SAMPLES / RATE_HZ
        maneuvers.append(
            Maneuver(
                axis=axis, kind="random_binary", start_s=start_s, stop_s=start_s + SAMPLES / RATE_HZ, origin="found"
            )
        )
    values = np.stack([np.concatenate(parts) for parts in columns.values()])
    topic = Topic(
        name="log",
        time_s=np.arange(values.shape[1]) / RATE_HZ,
        channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in columns),
        values=values,
    )
    record = FlightRecord(source=Source(name="flight.csv", format="CSV", sha256="a"), topics=(topic,))
    return [Flight(record, maneuver) for maneuver in maneuvers]


def pushed_flight(*, of_rate: float = -0.08, force: float = -7.0, delay_s: float = 0.04) -> Flight:
    """Pitch by a command that pushes the vehicle along its axis too; the attitude answers as two integrators do."""
    rng = np.random.default_rng(5)
    omega = 2.0 * np.pi * np.fft.rfftfreq(SAMPLES, 1.0 / RATE_HZ)
    s = 1j * omega
    command = np.fft.rfft(rng.standard_normal(SAMPLES)) * (omega > 0.0) * (omega < 8.0 * np.pi)
    theta = 60.0 / (s + 1.0) ** 2 * command * np.exp(-s * delay_s)
    pushed = (-STANDARD_GRAVITY_M_S2 + of_rate * s) * theta + force * np.exp(-s * delay_s) * command
    columns = {"pitch_command": command, "theta": theta, "u_dot": s * pushed / (s - X_U)}
    values = np.stack([np.fft.irfft(spectrum, SAMPLES) for spectrum in columns.values()])
    values[1:] += 0.01 * np.std(values[1:], axis=1, keepdims=True) * rng.standard_normal((2, SAMPLES))
    topic = Topic(
        name="log",
        time_s=np.arange(SAMPLES) / RATE_HZ,
        channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in columns),
        values=values,
    )
    record = FlightRecord(source=Source(name="flight.csv", format="CSV", sha256="a"), topics=(topic,))
    stop_s = SAMPLES / RATE_HZ
    return Flight(record, Maneuver(axis="pitch", kind="random_binary", start_s=0.0, stop_s=stop_s, origin="found"))


def pushed_flights(*, by_thrust: float) -> list[Flight]:
    """Pitch, which feedback answers with a thrust that pushes too, then thrust alone."""
    rng = np.random.default_rng(8)
    omega = 2.0 * np.pi * np.fft.rfftfreq(SAMPLES, 1.0 / RATE_HZ)
    s = 1j * omega
    parts: list[dict[str, FloatArray]] = []
    axes: tuple[Axis, ...] = ("pitch", "thrust")
    for axis in axes:
        free = [np.fft.rfft(rng.standard_normal(SAMPLES)) * (omega > 0.0) * (omega < 8.0 * np.pi) for _ in axes]
        command, thrust = free * np.where(np.array(axes) == axis, 1.0, 0.05)[:, None]
        theta = 60.0 / (s + 1.0) ** 2 * command
        thrust = thrust + 0.2 * theta
        speed = s * (-STANDARD_GRAVITY_M_S2 * theta - 7.0 * command + by_thrust * thrust) / (s - X_U)
        spectra = {"pitch_command": command, "thrust_command": thrust, "theta": theta, "u_dot": speed}
        parts.append({name: np.fft.irfft(one, SAMPLES) for name, one in spectra.items()})
    values = np.stack([np.concatenate([part[name] for part in parts]) for name in parts[0]])
    values[2:] += 0.01 * np.std(values[2:], axis=1, keepdims=True) * rng.standard_normal((2, 2 * SAMPLES))
    topic = Topic(
        name="log",
        time_s=np.arange(2 * SAMPLES) / RATE_HZ,
        channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in parts[0]),
        values=values,
    )
    record = FlightRecord(source=Source(name="flight.csv", format="CSV", sha256="a"), topics=(topic,))
    length_s = SAMPLES / RATE_HZ
    return [
        Flight(
            record,
            Maneuver(
                axis=axis, kind="random_binary", start_s=place * length_s, stop_s=(place + 1) * length_s, origin="found"
            ),
        )
        for place, axis in enumerate(axes)
    ]


def step(model: str, flown: list[Flight], **choices: object) -> FirstStep:
    choices = {"speed_damping": "two_step"} | choices
    return first_step(library_model(model), flown, IdentifySettings(**choices))  # type: ignore[arg-type]


@pytest.mark.parametrize(("model", "axis", "name", "truth"), [
    ("hover.longitudinal", "pitch", "X_u", X_U),
    ("hover.lateral", "roll", "Y_v", Y_V),
])  # fmt: skip
def test_the_damping_of_a_known_response_is_found(model: str, axis: Axis, name: str, truth: float) -> None:
    first = step(model, flight(axis))
    assert first.fix.keys() == {name}
    (finding,) = first.findings
    assert finding.numbers["value"] == first.fix[name]
    assert abs(first.fix[name] - truth) <= 4.0 * finding.numbers["std"]
    assert finding.numbers["std"] < 0.05 * abs(truth)


def test_the_remark_says_what_was_held_and_why_it_may_be_wrong() -> None:
    (finding,) = step("hover.longitudinal", flight("pitch")).findings
    assert (finding.kind, finding.severity, finding.where) == ("speed_damping_biased", "warning", "X_u")
    for part in ("u_dot/theta", "neglects X_pitch", f"{finding.numbers['low_rad_s']:.2g}", "rad/s"):
        assert part in finding.message
    assert finding.numbers["low_rad_s"] < finding.numbers["high_rad_s"]


def test_each_is_taken_from_the_maneuvers_of_its_own_axis() -> None:
    # While pitch is flown phi stands still: v_dot/phi over both would be half noise.
    first = step("hover.full", flight("pitch", "roll"))
    assert first.fix.keys() == {"X_u", "Y_v"}
    spread = {finding.where: finding.numbers["std"] for finding in first.findings}
    assert abs(first.fix["X_u"] - X_U) <= 4.0 * spread["X_u"]
    assert abs(first.fix["Y_v"] - Y_V) <= 4.0 * spread["Y_v"]


def test_choices_about_the_second_step_do_not_disturb_the_first() -> None:
    plain = step("hover.longitudinal", flight("pitch"))
    chosen = step(
        "hover.longitudinal",
        flight("pitch"),
        pairs={"q/pitch_command": (1.0, 20.0)},
        pair_weights={"q/pitch_command": 3.0},
        shifts={"q": 0.01},
        weights="cifer",
    )
    assert chosen.fix == plain.fix


def test_a_force_of_the_command_has_its_place_in_the_form_that_has_it() -> None:
    first = step("hover.longitudinal", [pushed_flight()], speed_damping="two_step_force")
    (finding,) = first.findings
    assert (finding.kind, finding.severity, finding.where) == ("speed_damping_first", "info", "X_u")
    assert abs(first.fix["X_u"] - X_U) <= 3.0 * finding.numbers["std"]
    assert finding.numbers["std"] < 0.1 * abs(X_U)
    assert finding.numbers["cost"] < 10.0


def test_what_another_command_does_meanwhile_is_no_part_of_it() -> None:
    # Over the pitch command alone the response holds what feedback made of the thrust.
    flown = pushed_flights(by_thrust=-20.0)
    (finding,) = step("hover.longitudinal", flown, speed_damping="two_step_force").findings
    assert abs(finding.numbers["value"] - X_U) <= 3.0 * finding.numbers["std"]
    assert finding.numbers["std"] < 0.1 * abs(X_U)
    with pytest.raises(InsufficientDataError, match="does not show X_u"):
        step("hover.longitudinal", flown[:1], speed_damping="two_step_force")


def test_a_first_step_that_does_not_fit_is_refused() -> None:
    """The response of one equation with a force that it does not have: no later cost can be trusted."""
    with pytest.raises(InsufficientDataError, match="does not show X_u: the cost is") as refused:
        step("hover.longitudinal", [pushed_flight(force=-60.0)])
    assert "two_step_force" in (refused.value.remedy or "")
    assert {finding.kind for finding in refused.value.findings} == {"poor_fit"}


@pytest.mark.parametrize("way", ["two_step", "two_step_force"])
def test_the_band_of_the_first_response_is_chosen_with_pair(way: str) -> None:
    choices = {"speed_damping": way, "pairs": {"u_dot/theta": (1.5, 6.0), "q/pitch_command": None}}
    (finding,) = step("hover.longitudinal", [pushed_flight(force=-1.0)], **choices).findings
    assert 1.5 <= finding.numbers["low_rad_s"] < 2.0
    assert 5.5 < finding.numbers["high_rad_s"] <= 6.0
    assert without_first({"u_dot/theta": (1.5, 6.0), "q/pitch_command": None}) == {"q/pitch_command": None}


def test_a_first_response_is_no_name_of_a_joint_fit() -> None:
    structure = library_model("hover.longitudinal")
    require_known(structure, IdentifySettings(pairs={"u_dot/theta": (2.0, 13.0)}, speed_damping="two_step"))
    with pytest.raises(ModelError, match="u_dot/theta"):
        require_known(structure, IdentifySettings(pairs={"u_dot/theta": (2.0, 13.0)}))


def test_a_model_without_speed_damping_is_refused() -> None:
    with pytest.raises(UsageError, match=r"rate\.roll has neither a free X_u nor a free Y_v"):
        first_step(rate_model("rate.roll"), flight("roll"), IdentifySettings(speed_damping="two_step"))


def test_one_that_is_held_already_is_not_looked_for() -> None:
    structure = library_model("hover.full")
    held = type(structure)(
        **{name: getattr(structure, name) for name in structure.__dataclass_fields__ if name != "parameters"},
        parameters=structure.parameters.fix("X_u", -0.2),
    )
    first = first_step(held, flight("roll"), IdentifySettings(speed_damping="two_step"))
    assert first.fix.keys() == {"Y_v"}


def test_a_log_without_attitude_cannot_answer() -> None:
    with pytest.raises(InsufficientDataError, match="theta"):
        step("hover.longitudinal", flight("pitch", without="theta"))
