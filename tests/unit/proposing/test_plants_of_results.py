"""The rate plant of an axis is one, whatever result it comes from: rate models, and models of hover of every kind."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal
from tests.unit.exports.models import model

from rotorid.identifying.tracking import predicted
from rotorid.models.library import library_model, rate_model
from rotorid.models.structure import LinearStructure
from rotorid.proposing.plants import plant_of, plant_remarks
from rotorid.proposing.plants import rate_model as chosen_model
from rotorid.proposing.proposal import _provenance
from rotorid.proposing.settings import TuneSettings
from rotorid.results.model import IdentifiedModel
from rotorid.results.summary import Cost, PairCost
from rotorid.tuning.loops import LoopFigures, loop_figures
from rotorid.tuning.plant import UncertainPlant
from rotorid.typing import FloatArray
from rotorid.verification.tracking import BAND_HZ, RATE_HZ

RATE = {"M_pitch": 110.0, "M_q": -1.5, "T_motor": 0.045, "tau_pitch": 0.009}
SPEED = {"X_u": -0.3, "X_w": 0.0, "Z_u": 0.0, "Z_w": -0.6, "M_w": 0.0, "M_thrust": 0.0, "X_thrust": 0.0}
OMEGA = np.geomspace(0.1, 300.0, 900)


def result(structure: LinearStructure, values: Mapping[str, float], *, responses: bool) -> IdentifiedModel:
    own = {name: values[name] for name in structure.parameters.names if name in values}
    found = model(replace(structure, parameters=structure.parameters.with_values(own)), responses=responses)
    measured = found.data.response
    if responses:
        covariance = 0.05**2 * np.abs(measured.values)[..., None] ** 2 * np.eye(measured.omega_rad_s.size)
        measured = replace(measured, covariance=covariance.astype(np.complex128))
    data = replace(found.data, response=measured, used=np.ones(measured.values.shape, dtype=bool))
    pair = PairCost(value=1.0, band_rad_s=(1.0, 50.0), points=25)
    return replace(found, data=data, fit=replace(found.fit, cost=Cost(average=1.0, pairs={"q/pitch_command": pair})))


def hover(M_u: float, *, responses: bool = False) -> IdentifiedModel:
    values = {**RATE, **SPEED, "M_u": M_u, "X_q": 0.0, "Z_q": 0.0, "X_pitch": 0.0, "Z_pitch": 0.0, "Z_thrust": -20.0}
    structure = library_model("hover.longitudinal")
    return result(structure, {**dict.fromkeys(structure.parameters.names, 0.0), **values}, responses=responses)


def rate(*, responses: bool = False) -> IdentifiedModel:
    return result(rate_model("rate.pitch"), RATE, responses=responses)


def figures(plant: UncertainPlant) -> LoopFigures:
    """Of a proportional and integral controller of the rate."""
    controller = 0.15 * (1.0 + 1.0 / (1j * OMEGA))
    return loop_figures(OMEGA, plant.drawn(OMEGA) * controller, from_rad_s=plant.known_from_rad_s)


@pytest.mark.parametrize("M_u", [0.0, 0.3, 4.0], ids=["stable", "slowly unstable", "unstable"])
@pytest.mark.parametrize("responses", [True, False], ids=["measured", "model alone"])
def test_margins_of_hover_are_those_of_the_rate_model(M_u: float, *, responses: bool) -> None:
    whole = hover(M_u, responses=responses)
    assert whole.rate_axes == ("pitch",)
    assert bool((whole.system.poles().real > 0.0).any()) is (M_u > 0.0)
    ours, theirs = (figures(plant_of(found, "pitch", draws=60, seed=1)) for found in (whole, rate(responses=responses)))
    assert ours.stable.all()
    for name in ("crossover_rad_s", "phase_margin_rad", "sensitivity_peak"):
        low, high = np.percentile(getattr(theirs, name), [2.5, 97.5])
        assert low <= np.median(getattr(ours, name)) <= high, name


def test_a_rate_model_goes_first_and_others_are_named() -> None:
    given = [hover(4.0), rate()]
    own = chosen_model("pitch", given, [])
    assert own.name == "rate.pitch"
    (said,) = [finding.message for finding in plant_remarks("pitch", given, own)]
    assert said == "rate.pitch was used for pitch; hover.longitudinal has its plant too."
    assert chosen_model("pitch", given[:1], []).name == "hover.longitudinal"


def test_an_unstable_model_foretells_the_rate_under_its_controller() -> None:
    """Inside the band of the tracker, where its command holds the feedback that keeps the vehicle in the air."""
    whole = hover(4.0)
    plant = whole.rational(delays="states", sample_rate_hz=RATE_HZ)
    q, theta = (whole.structure.outputs.index(name) for name in ("q", "theta"))
    rng = np.random.default_rng(1)
    low_pass, band = (signal.butter(2, cut, kind, fs=RATE_HZ) for cut, kind in ((3.0, "low"), (BAND_HZ, "band")))
    asked = signal.lfilter(*low_pass, 0.6 * rng.standard_normal(3000))
    x, command, rates = np.zeros(len(plant.A)), [], []
    u = np.zeros(2)
    for stick in asked:
        y = plant.C @ x + plant.D @ u
        u = np.array([0.04 * (6.0 * (stick - y[theta]) - y[q]), 0.0])
        command.append(u[0])
        rates.append(y[q])
        x = plant.A @ x + plant.B @ u
    assert np.abs(rates).max() < 10.0
    own = predicted(whole, "pitch", np.array(command))

    def inside(row: FloatArray) -> FloatArray:
        # Ends hold what came before and would come after.
        return np.asarray(signal.filtfilt(*band, row))[300:-300]

    # The samples are held between turns: half a turn of delay at the end of the band.
    half = np.interp(np.arange(own.size) - 0.5, np.arange(own.size), own)
    difference = inside(half) - inside(np.array(rates))
    assert np.std(difference) < 0.06 * np.std(inside(np.array(rates)))


def test_a_proposal_of_results_alone_has_the_choices_of_tune() -> None:
    """The limit that was asked for is read there: that of ``identify``, which has none, was taken for the default."""
    found = rate()
    provenance = _provenance((), (found,), TuneSettings(robustness=1.4, seed=3))
    assert (provenance.settings["robustness"], provenance.seed) == (1.4, 3)
    assert provenance.inputs == found.provenance.inputs
