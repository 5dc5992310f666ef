"""Words about new gains and the flights to the best ones."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from rotorid.data.trust import ROBUSTNESS
from rotorid.documents.review import QuantityDocument
from rotorid.documents.tune import AxisJudgedDocument
from rotorid.documents.verdict import BreakingDocument
from rotorid.report.tune_words import (
    _less,
    _than_today,
    axis_sentences,
    following,
    headline,
    is_checked,
    limiting,
    margin_lines,
    missed_sentences,
    moving_d_sentence,
    path_sentence,
    stricter_sentence,
    unread,
    verdict_sentence,
)


def step(ratio: float) -> SimpleNamespace:
    return SimpleNamespace(attitude_ratio=SimpleNamespace(value=ratio), sweep_to_rad_s=120.0)


@pytest.mark.parametrize(("goal", "words"), [(0.25, "2 times less"), (0.48, "4 % less"), (0.35, "30 % less")])
def test_a_small_gain_is_given_in_percent_and_never_as_one_time(goal: float, words: str) -> None:
    way: Any = [step(0.5), step(goal)]
    assert path_sentence(way).endswith(f"tilts the vehicle {words} than with the gains proposed now.")


@pytest.mark.parametrize(
    ("ratio", "words"),
    [(0.25, "4 times less"), (0.9, "10 % less"), (1.2, "20 % more"), (5.3, "5.3 times more")],
)
def test_a_disturbance_that_tilts_much_more_is_a_factor(ratio: float, words: str) -> None:
    assert _less(SimpleNamespace(value=ratio)) == words  # type: ignore[arg-type]
    assert _than_today(SimpleNamespace(value=ratio)) == f"{words} than today"  # type: ignore[arg-type]
    assert _than_today(SimpleNamespace(value=1.002)) == "as much as today"  # type: ignore[arg-type]


def quantity(value: float) -> SimpleNamespace:
    return SimpleNamespace(value=value, lower=0.95 * value, upper=1.05 * value)


def tuned(whole_phase_deg: float, *, path: tuple[float, ...] = (), reasons: tuple[str, ...] = ()) -> Any:
    rate = {"sensitivity_peak": quantity(1.5), "phase_margin_deg": quantity(50.0), "gain_margin_db": quantity(9.0)}
    whole = {"sensitivity_peak": quantity(1.6), "phase_margin_deg": quantity(whole_phase_deg)}
    steps = [
        SimpleNamespace(
            flight=number,
            attitude_ratio=quantity(ratio),
            sweep_to_rad_s=75.0,
            whole={"sensitivity_peak": quantity(1.6 - 0.1 * number)},
        )
        for number, ratio in enumerate(path, start=1)
    ]
    axis = SimpleNamespace(
        changed=True, flown=rate, proposed=rate, flown_whole=whole, proposed_whole=whole, path=steps, reasons=reasons
    )
    return SimpleNamespace(axes={"roll": axis}, provenance=SimpleNamespace(settings={}))


def test_each_margin_names_its_loop_and_the_one_that_misses_its_bar_is_named() -> None:
    lines = margin_lines(tuned(39.1))
    assert [line.name for line in lines] == [
        "M_s, rate loop",
        "M_s, with angle loop",
        "phase margin, rate loop",
        "phase margin, with angle loop",
        "gain margin, rate loop",
    ]
    missed = "Roll: the phase margin with angle loop is 39.1°; above 40° is fine."
    assert [line.missed for line in lines] == ["", "", "", missed, ""]
    assert not any(line.missed for line in margin_lines(tuned(41.0)))


def test_a_stricter_limit_than_the_scale_is_explained() -> None:
    words = stricter_sentence(tuned(50.0))
    assert "below 2 is fine" in words
    assert f"New gains keep it below {ROBUSTNESS:g}" in words
    asked = tuned(50.0)
    asked.provenance.settings["robustness"] = 2.5
    assert not stricter_sentence(asked)


def test_a_d_that_changes_in_flight_has_both_its_ends() -> None:
    base = {"crossover_rad_s": quantity(80.0), "sensitivity_peak": quantity(2.0)}
    top = {"crossover_rad_s": quantity(97.0), "sensitivity_peak": quantity(2.4)}
    moving = SimpleNamespace(changed=False, proposed=base, ends={"D at its base": base, "D at its top": top})
    still = SimpleNamespace(changed=True, proposed=base, ends={})
    assert moving_d_sentence(of(roll=moving, yaw=still)) == (
        "D of roll changes in flight; these margins are for D at its base. "
        "M_s of the rate loop with D at its top: 2.40 (2.28 to 2.52) in roll."
    )
    assert moving_d_sentence(of(yaw=still)) == ""


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ((0.5, 0.48), "nearly the best, so a further tune is optional: after 2 flights in all, a disturbance tilts "),
        ((0.5, 0.4, 0.25), "need more flights, so tune again from that log: after 3 flights in all, a disturbance "),
    ],
)
def test_what_comes_next_says_how_much_it_brings(path: tuple[float, ...], words: str) -> None:
    assert words in following(tuned(50.0, path=path))
    assert not following(tuned(50.0))


def test_what_limits_the_gains_is_no_reason_to_change_them() -> None:
    reasons = ("today M_s of the rate loop exceeds 1.7", "P doubles, the most allowed in one flight")
    assert limiting(tuned(50.0, reasons=reasons).axes["roll"]) == (
        "reason for the change: today M_s of the rate loop exceeds 1.7. "
        "Limited by: P doubles, the most allowed in one flight."
    )


def test_what_the_answer_says_already_is_no_further_warning() -> None:
    why = "roll.ulg: the log contains no excitation of yaw"
    findings = [
        SimpleNamespace(kind="no_excitation", where="yaw", message=f"{why}."),
        SimpleNamespace(
            kind="not_tuned", where="yaw", message=f"Not enough data to tune yaw: {why}; sweep the yaw stick."
        ),
        SimpleNamespace(kind="firmware_contradicted", where="", message="Another firmware flew."),
    ]
    left = unread(SimpleNamespace(findings=findings))  # type: ignore[arg-type]
    assert [finding.kind for finding in left] == ["firmware_contradicted"]


def new(ratio: float, *, noise: float = 1.0, phase_deg: float = 50.0, peak: float = 1.6, today: bool = False) -> Any:
    """An axis with new gains."""
    whole = {
        "sensitivity_peak": quantity(peak),
        "phase_margin_deg": quantity(phase_deg),
        "crossover_rad_s": quantity(40.0),
    }
    return SimpleNamespace(
        changed=True,
        attitude_ratio=quantity(ratio),
        noise_ratio=noise,
        noise_flown=0.01,
        proposed_whole=whole,
        gains={"MC_ROLLRATE_P": SimpleNamespace(flown=0.1, proposed=0.2)},
        reasons=("today M_s of the rate loop exceeds 1.7",) if today else (),
    )


def kept(*reasons: str) -> Any:
    return SimpleNamespace(changed=False, reasons=reasons)


def of(**axes: Any) -> Any:
    return SimpleNamespace(axes=axes)


def test_the_headline_says_what_gets_better_and_what_to_watch() -> None:
    assert headline(of(roll=new(0.25), pitch=new(0.25))) == (
        "New gains for roll and pitch. With the new gains, a disturbance tilts the vehicle 4 times less than today.",
        "In the first flight, watch for roll shaking at about 6.4 Hz; if in doubt, land and load the old gains.",
    )
    better, watch = headline(of(roll=new(0.25), yaw=new(0.9, noise=1.8, phase_deg=35.0, peak=1.69)))
    assert "tilts the vehicle 4 times less in roll and turns the vehicle 10 % less in yaw than today." in better
    better, _ = headline(of(roll=new(0.25), pitch=new(0.2)))
    assert better.endswith("a disturbance tilts the vehicle 4 times less in roll and 5 times less in pitch than today.")
    assert "watch for yaw shaking at about 6.4 Hz, overshoot in yaw and hot motors" in watch


def test_an_outer_loop_moves_the_vehicle_and_swings_slowly() -> None:
    outer = new(0.4, noise=1.9)
    outer.gains = {"PSC_NE_POS_P": SimpleNamespace(flown=1.0, proposed=1.3)}
    better, watch = headline(of(velocity=outer))
    assert better.endswith("a disturbance moves the vehicle 2.5 times less than today.")
    assert "watch for slow swings of the position at about 6.4 Hz; if" in watch
    assert axis_sentences(of(velocity=outer)) == (("Velocity: position P 1 → 1.3.", ""),)
    assert is_checked(of(velocity=outer))


def test_the_headline_of_safer_gains_names_their_price() -> None:
    better, safer, _ = headline(of(roll=new(0.5), yaw=new(4.8, today=True)))
    assert better.startswith("New gains for roll.")
    assert safer == (
        "Safer gains for yaw: today's have too little margin. "
        "The price: a disturbance turns the vehicle 4.8 times more than today."
    )


def test_the_headline_without_new_gains() -> None:
    assert headline(of(roll=kept(), yaw=kept())) == ("Keep today's gains of roll and yaw.",)
    weak = of(roll=kept("today M_s of the rate loop exceeds 2: lower P and D by hand and fly again"), yaw=kept())
    assert headline(weak) == (
        "No new gains for roll, although today's have too little margin.",
        "Keep today's gains of yaw.",
    )
    assert axis_sentences(weak)[0][0].startswith("Roll: no new gains: today M_s of the rate loop exceeds 2: lower P")
    assert headline(of()) == ()


def test_axes_of_which_the_same_is_true_share_a_sentence() -> None:
    found = axis_sentences(of(roll=kept("no better"), pitch=kept("no better"), yaw=new(0.5)))
    assert found == (("Roll and pitch: keep today's gains: no better.", ""), ("Yaw: P 0.1 → 0.2.", ""))


def test_both_loops_that_miss_a_margin_are_one_sentence() -> None:
    document = tuned(39.1)
    document.axes["roll"].proposed["phase_margin_deg"] = quantity(30.0)
    assert missed_sentences(margin_lines(document)) == (
        "Roll: the phase margin is 30.0° (rate loop) and 39.1° (with angle loop); above 40° is fine.",
    )


def test_noise_that_was_not_measured_is_not_called_small() -> None:
    unknown = new(0.5, noise=1.5)
    unknown.noise_flown = None
    ((sentence, _),) = axis_sentences(of(roll=unknown))
    assert sentence == (
        "Roll: P 0.1 → 0.2; noise in the motor commands was not measured, white noise would be 150 % of today's."
    )


@pytest.mark.parametrize(
    ("noise", "noisy", "verdict", "said"),
    [
        (0.01, False, "fly", "today."),
        (None, False, "fly", "today. Noise in the motor commands was not measured."),
        (
            None,
            True,
            "gently",
            "gently first: noise in the motor commands was not measured, white noise would be 2.5 times today's. A "
            "disturbance tilts the vehicle 2 times less than today.",
        ),
    ],
)
def test_a_verdict_says_that_noise_was_not_measured(noise: float | None, noisy: bool, verdict: Any, said: str) -> None:
    breaking = BreakingDocument(
        loop="rate", situation="", omega_rad_s=40.0, sensitivity_peak=1.6, gain=1.1, phase_deg=-3.0
    )
    found = AxisJudgedDocument(
        verdict=verdict,
        breaking=breaking,
        noisy=noisy,
        noise=noise,
        noise_ratio=2.5,
        attitude_ratio=QuantityDocument(value=0.5, std=0.01, lower=0.48, upper=0.52, unit="1"),
    )
    assert verdict_sentence("roll", found).endswith(said)
