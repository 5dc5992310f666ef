"""Verdicts on a flight with proposed gains: wide intervals acquit nobody, and an injection overrules a plant."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rotorid.data.quantities import QUANTITIES
from rotorid.data.quantity import Quantity
from rotorid.models.autopilots import axis_controller
from rotorid.proposing import check
from rotorid.proposing.axis_tuning import AxisTuning, _loops, _responses
from rotorid.proposing.check import CheckedAxis, Foretold
from rotorid.tuning import ControllerParts, Gains, frequency_grid, propose, uncertain_plant
from rotorid.tuning.loops import quantities
from rotorid.typing import ComplexArray, FloatArray

PARAMETERS = {
    "MC_ROLLRATE_P": 0.25,
    "MC_ROLLRATE_I": 0.8,
    "MC_ROLLRATE_D": 0.006,
    "MC_ROLL_P": 5.0,
    "IMU_DGYRO_CUTOFF": 30.0,
    "IMU_GYRO_RATEMAX": 400.0,
}


def vehicle(w: FloatArray) -> ComplexArray:
    return np.asarray(113.1 / ((0.048j * w + 1.0) * (1j * w + 1.0)) * np.exp(-0.012j * w))


def flown(band_rad_s: tuple[float, float] = (1.0, 100.0), parameters: dict[str, float] = PARAMETERS) -> AxisTuning:
    """A second flight without a log."""
    axis = axis_controller(parameters, "roll", firmware="PX4 1.16.0")
    assert axis is not None
    plant = uncertain_plant(vehicle, None, band_rad_s=band_rad_s, draws=40)
    omega = frequency_grid(axis.controller)
    ones = np.ones(omega.size, dtype=np.complex128)
    parts = ControllerParts(controller=axis.controller, omega_rad_s=omega, filters=ones, logged=ones)
    found = propose("roll", plant, axis.controller, parts=parts)
    drawn = plant.drawn(omega)
    sets = {"flown": (drawn, parts, Gains.of(axis.controller)), "proposed": (drawn, parts, found.proposed.gains)}
    return AxisTuning(
        controller=axis,
        plant=plant,
        omega_rad_s=omega,
        proposal=found,
        parameters={name: (value, value) for name, value in parameters.items()},
        loops=_loops(sets),
        responses=_responses(omega, sets),
        step_s=np.zeros(2),
        steps={},
        parts=parts,
    )


SECOND = flown()
RATE, WHOLE = quantities(SECOND.proposal.flown.rate), quantities(SECOND.proposal.flown.whole)


def wider(figures: dict[str, Quantity], share: float) -> dict[str, Quantity]:
    """The same figures with half intervals of a share of their values."""
    return {
        name: Quantity(
            value=x.value,
            std=0.5 * share * x.value,
            lower=(1 - share) * x.value,
            upper=(1 + share) * x.value,
            unit=x.unit,
        )
        for name, x in figures.items()
    }


def checked(
    rate: dict[str, Quantity] = RATE,
    whole: dict[str, Quantity] = WHOLE,
    *,
    now: AxisTuning = SECOND,
    injected: dict[str, Quantity] | None = None,
    robustness: float = 1.7,
) -> CheckedAxis:
    before = Foretold(flown={}, proposed=dict(PARAMETERS), rate=rate, whole=whole, robustness=robustness)
    logged = replace(now, parameters={name: (value, value) for name, value in PARAMETERS.items()})
    return check._checked("roll", before, logged, injected or {})


def test_a_loop_that_is_known_well_is_as_foretold() -> None:
    assert checked().verdict == "as_foretold"


@pytest.mark.parametrize("name", ["crossover_rad_s", "phase_margin_deg", "sensitivity_peak"])
def test_a_wide_interval_does_not_acquit(name: str) -> None:
    """A proposal that says little is not fulfilled by whatever flies."""
    found = checked(whole={**WHOLE, name: wider(WHOLE, 0.25)[name]})
    assert found.verdict == "cannot_tell"
    assert QUANTITIES[name].words in found.sentence
    assert all(one.inside for one in found.figures)
    assert "Keep these gains" not in found.advice
    assert "up to" in found.advice
    assert "rollback" in found.advice


def test_a_plant_that_ends_at_the_crossover_does_not_acquit() -> None:
    """Its peak is what the model says of frequencies that nobody flew."""
    crossover = WHOLE["crossover_rad_s"].value
    short = flown(band_rad_s=(1.0, 1.2 * crossover))
    found = checked(now=short)
    assert found.verdict == "cannot_tell"
    assert "peak sensitivity M_s" in found.sentence


def test_a_test_signal_at_the_mixer_overrules_the_plant() -> None:
    """Both flights agree with each other, and neither with the loop that flew."""
    measured = {
        "crossover_rad_s": Quantity.normal(0.7 * WHOLE["crossover_rad_s"].value, 0.2, "rad/s"),
        "phase_margin_deg": WHOLE["phase_margin_deg"],
        "sensitivity_peak": Quantity.normal(1.3, 0.02, "1"),
    }
    found = checked(injected=measured)
    assert found.contradicted
    assert found.verdict == "inside_limits"
    assert "contradicts the identified plant" in found.sentence
    assert "before you tune again" in found.advice
    assert not any(one.decided for one in found.figures if one.loop == "rate")
    assert {one.method for one in found.figures if one.loop == "whole"} == {"injection"}
    hot = checked(injected={**measured, "sensitivity_peak": Quantity.normal(2.4, 0.02, "1")})
    assert hot.verdict == "worse"
    assert "rollback" in hot.advice


def test_a_test_signal_that_agrees_says_so() -> None:
    agreed = {name: replace(one, std=0.1 * one.std) for name, one in WHOLE.items() if name in check.COMPARED}
    found = checked(injected=agreed)
    assert (found.verdict, found.contradicted) == ("as_foretold", False)


def test_another_loop_whose_peak_is_unknown_is_not_inside_its_limits() -> None:
    other = {**WHOLE, "crossover_rad_s": replace(WHOLE["crossover_rad_s"], lower=60.0, value=62.0, upper=64.0)}
    unknown = {
        name: {**one, "sensitivity_peak": wider(one, 0.3)["sensitivity_peak"]}
        for name, one in (("rate", RATE), ("whole", other))
    }
    found = checked(**unknown)
    assert found.verdict == "cannot_tell"
    assert "crossover (with angle loop)" in found.sentence
    assert checked(whole=other).verdict == "inside_limits"
    # What the rate loop alone has says nothing of the loop that flies.
    assert checked(whole=unknown["whole"]).verdict == "cannot_tell"


@pytest.mark.parametrize(
    ("peak", "asked", "verdict"),
    [
        (1.73, 1.7, "inside_limits"),
        (1.78, 1.7, "worse"),
        # What the proposal asked for counts, not the limit by default.
        (1.78, 2.0, "inside_limits"),
        (1.60, 1.5, "worse"),
    ],
)
def test_a_peak_may_be_three_percent_above_what_was_asked_for(peak: float, asked: float, verdict: str) -> None:
    measured = {
        "crossover_rad_s": Quantity.normal(0.7 * WHOLE["crossover_rad_s"].value, 0.2, "rad/s"),
        "phase_margin_deg": WHOLE["phase_margin_deg"],
        "sensitivity_peak": Quantity.normal(peak, 0.02, "1"),
    }
    assert checked(injected=measured, robustness=asked).verdict == verdict


def test_an_unstable_loop_is_worse() -> None:
    swinging = flown(parameters={**PARAMETERS, "MC_ROLLRATE_P": 0.002, "MC_ROLLRATE_D": 0.0, "MC_ROLL_P": 9.0})
    judged = swinging.proposal.flown
    assert not judged.whole.stable.any()
    assert checked(quantities(judged.rate), quantities(judged.whole), now=swinging).verdict == "worse"


def test_nothing_more_to_gain_is_not_said_of_a_plant_that_was_not_seen() -> None:
    kept = replace(SECOND, parameters={name: (value, value) for name, value in PARAMETERS.items()})
    agreed = {name: replace(one, std=0.1 * one.std) for name, one in WHOLE.items() if name in check.COMPARED}
    assert checked(now=kept).advice == "Keep these gains. No better gains for roll exist within the limits."
    short = replace(kept, plant=replace(kept.plant, band_rad_s=(1.0, 30.0)))
    found = checked(now=short, injected=agreed)
    assert found.verdict == "as_foretold"
    assert "The flight was measured only up to 5 Hz, too low for better gains." in found.advice


def test_a_peak_that_is_read_off_an_injection_is_half_as_wide_again(monkeypatch: pytest.MonkeyPatch) -> None:
    peak = SimpleNamespace(value=1.5, std=0.02)
    rejection = SimpleNamespace(peak=peak, peak_omega_rad_s=SimpleNamespace(interval=(20.0, 30.0)))
    margins = SimpleNamespace(gain_crossovers=(), phase_margin_rad=None)
    loop = SimpleNamespace(omega_rad_s=np.array([1.0, 50.0]))
    found = SimpleNamespace(loop=loop, margins=margins, rejection=rejection)
    monkeypatch.setattr(check, "loop_by_injection", lambda axis, logs: found)
    assert check._measured("roll", ())["sensitivity_peak"].std == pytest.approx(0.03)
    # At the end of the band a peak is none.
    loop.omega_rad_s = np.array([1.0, 30.0])
    assert check._measured("roll", ()) == {}
