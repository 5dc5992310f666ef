"""Nonlinear models through the same verbs as all others: identified, judged, compared, flown, written and read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.unit.checking.large_motion import TRUTH, large_motion
from tests.unit.checking.response_flight import flight as roll_flight

from rotorid.documents.result import load, save
from rotorid.documents.verify import verify_document
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fits.time import refusals
from rotorid.flying import fly_log
from rotorid.flying.flown_models import FlownStretch
from rotorid.identifying import compare, identify, verify
from rotorid.results import IdentifiedModel
from rotorid.results.verdicts import verdict

INSIDE_STDS = 4.0


@pytest.fixture(scope="module")
def flight() -> IdentifiedModel:
    return identify([large_motion(seed=1), large_motion(seed=2)], "flight.first_order", verify=[large_motion(seed=3)])


@pytest.mark.parametrize("name", TRUTH)
def test_a_whole_flight_gives_back_its_truth(flight: IdentifiedModel, name: str) -> None:
    found = flight[name]
    assert found.std is not None
    assert abs(found.value - TRUTH[name]) < INSIDE_STDS * found.std
    assert found.std < 0.1 * max(TRUTH[name], 0.1)


def test_what_was_not_commanded_is_held_and_said(flight: IdentifiedModel) -> None:
    assert {name for name, one in flight.parameters.items() if one.status == "fixed"} == {"K_psi", "T_psi", "tau_psi"}
    said = [one.where for one in flight.findings if one.kind == "no_excitation"]
    assert {"K_psi", "T_psi", "tau_psi"} <= set(said)
    assert [one.where for one in flight.findings if one.kind == "missing_channel"] == ["r_setpoint"]


def test_a_heading_that_was_not_flown_is_no_bad_fit(flight: IdentifiedModel) -> None:
    assert flight.fit.fit_percent is not None
    assert set(flight.fit.fit_percent) == set(flight.fit.outputs) - {"psi"}
    assert min(flight.fit.fit_percent.values()) > 85.0
    assert verdict(flight).color == "green"
    assert not [one for one in flight.findings if one.kind == "poor_fit"]
    (note,) = [one for one in flight.findings if one.where == "psi"]
    assert (note.kind, note.severity) == ("no_excitation", "info")
    assert note.message.startswith("r_setpoint did not move")
    assert all("psi" not in one.fit_percent for one in flight.fit.records)
    assert "psi" not in flight.verification.maneuvers[0].moved


def test_a_heading_that_was_not_flown_is_no_score(flight: IdentifiedModel) -> None:
    compared = compare([flight, flight], [large_motion(seed=6)])
    (one,) = compared.maneuvers
    label, outputs = compared.entries[0].label, ["phi", "theta", "velocity_north", "velocity_east", "velocity_down"]
    assert one.mean_percent(label, [*outputs, "psi"]) == one.mean_percent(label, outputs)
    assert one.mean_percent(label, outputs) > 85.0
    assert ["psi" in one.message for one in compared.findings if one.kind == "no_excitation"] == [True]
    (stretch,) = fly_log(flight, [large_motion(seed=6)]).stretches
    assert "psi" not in stretch.scores


def test_positions_are_integrals_and_not_fitted_but_judged(flight: IdentifiedModel) -> None:
    assert set(flight.fit.outputs) == {"velocity_north", "velocity_east", "velocity_down", "phi", "theta", "psi"}
    (scores,) = flight.verification.records.values()
    assert scores["north"].nrmse_fit_percent > 80.0
    assert scores["velocity_north"].tic < 0.05


def test_each_record_says_its_own(flight: IdentifiedModel) -> None:
    for record in flight.fit.records:
        drag = record.parameters["k_Dx"]
        assert abs(drag.value - TRUTH["k_Dx"]) < INSIDE_STDS * drag.std


def test_a_record_says_why_it_has_no_value_of_its_own() -> None:
    records = [large_motion(seed=4), large_motion(seed=7, still=("phi_setpoint",))]
    moved, little = identify(records, "drag.linear").fit.records
    assert (set(moved.parameters), set(moved.missing)) == ({"k_Dx", "k_Dy"}, set())
    assert (set(little.parameters), set(little.missing)) == ({"k_Dx"}, {"k_Dy"})
    assert little.missing["k_Dy"] == "another record moves what it acts on more than 3 times as much"


def test_of_responses_too_a_record_says_why() -> None:
    records = [large_motion(seed=1), large_motion(seed=7, still=("phi_setpoint",))]
    found = identify(records, "response.first_order_delay", outputs=("phi", "theta"))
    for fit in found.fit.records:
        assert not fit.parameters
        assert (
            fit.missing["K_phi"]
            == "phi_setpoint did not move in flight7.csv at 0.0 s; each record must move every input"
        )
    assert found.fit.records[1].fit_percent.keys() == {"theta"}


def test_it_is_linear_about_rest(flight: IdentifiedModel) -> None:
    assert flight.nonlinear is not None
    slow = sorted(abs(pole.value) for pole in flight.poles if abs(pole.value) > 1e-6)[:2]
    assert slow == pytest.approx([flight["k_Dx"].value, flight["k_Dy"].value], rel=1e-6)


def test_it_is_written_and_read(flight: IdentifiedModel, tmp_path: Path) -> None:
    save(flight, tmp_path)
    again = load(tmp_path)
    assert again.nonlinear is not None
    u = np.stack([np.full(40, 0.1), np.zeros(40), np.zeros(40), np.zeros(40)])
    here, there = (one.simulate(u, sample_rate_hz=20.0) for one in (flight, again))
    np.testing.assert_allclose(there, here, rtol=1e-9, atol=1e-12)
    assert 'kind = "nonlinear"' in (tmp_path / "model.toml").read_text()
    verified = verify(tmp_path, [large_motion(seed=3)])
    assert verify_document(verified).maneuvers[0].verdict == "good"


def test_drag_takes_velocities_turned_by_the_heading() -> None:
    record = large_motion(seed=4)
    turned = identify([record], "drag.linear")
    assert abs(turned["k_Dx"].value - TRUTH["k_Dx"]) < 0.08
    assert any(one.kind == "reconstructed" and one.where == "velocity_forward" for one in turned.findings)
    placed = identify([large_motion(seed=4, without=("velocity_north", "velocity_east"))], "drag.linear")
    assert abs(placed["k_Dx"].value - turned["k_Dx"].value) < 0.05


def test_own_equations(tmp_path: Path) -> None:
    text = tmp_path / "own.toml"
    text.write_text(
        'kind = "nonlinear"\nname = "own"\ninputs = ["phi_setpoint"]\nstates = ["phi"]\n'
        'equations = ["T*phi\' = K*sin(phi_setpoint) - phi"]\noutputs = ["phi"]\n[starts]\nphi = "phi"\n'
        '[parameters.K]\nvalue = 1.0\nunit = "1"\n[parameters.T]\nvalue = 0.3\nunit = "s"\nlower = 0.01\n'
    )
    found = identify([large_motion(seed=5)], text)
    assert found["T"].value == pytest.approx(TRUTH["T_phi"] + TRUTH["tau_phi"], rel=0.2)


def test_values_that_nothing_bounds_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the rule of all fits in time."""
    monkeypatch.setattr(refusals, "unbounded_parameters", lambda parameters, limits: ["k_Dx"])
    with pytest.raises(InsufficientDataError, match="not enough data for k_Dx"):
        identify([large_motion(seed=4)], "drag.linear")


def test_comparison_has_one_row_for_a_flight(flight: IdentifiedModel) -> None:
    record = large_motion(seed=6)
    roll = identify([large_motion(seed=1)], "response.first_order_delay", outputs=("phi",))
    compared = compare([roll, flight], [record])
    assert compared.maneuvers is not None
    assert [sorted(one.scores) for one in compared.maneuvers] == [sorted(one.label for one in compared.entries)]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"band_rad_s": (1.0, 2.0), "reduce": True}, "--band, --reduce does not apply to drag.linear"),
        ({"method": "frequency"}, "--method frequency does not apply to"),
        ({"outputs": ("nothing",)}, "no output"),
        ({"fix": {"nothing": 1.0}}, "no parameter"),
    ],
)
def test_choices_that_it_does_not_have(options: dict[str, object], words: str) -> None:
    from rotorid.errors import RotoridError

    with pytest.raises(RotoridError, match=words):
        identify([large_motion(seed=1)], "drag.linear", **options)


def test_a_log_without_its_outputs_is_refused() -> None:
    with pytest.raises(InsufficientDataError, match="contains none of"):
        identify([roll_flight()], "drag.linear")


@pytest.fixture(scope="module")
def whole(flight: IdentifiedModel) -> FlownStretch:
    (stretch,) = fly_log(flight, [large_motion(seed=7)]).stretches
    return stretch


def test_flown_through_a_log_it_stays_beside_the_truth(whole: FlownStretch) -> None:
    stretch = whole
    assert stretch.scores["velocity_east"].nrmse_fit_percent > 85.0
    assert stretch.starts == (0,)
    _require_band(stretch)


def test_in_pieces_positions_do_not_drift(flight: IdentifiedModel, whole: FlownStretch) -> None:
    (cut,) = fly_log(flight, [large_motion(seed=7)], pieces_s=5.0).stretches
    assert len(cut.starts) == 5
    assert cut.scores["north"].rms < whole.scores["north"].rms


def test_responses_and_drag_make_a_flight() -> None:
    records = [large_motion(seed=1, heading_rad=0.0)]
    answers = identify(records, "response.first_order_delay", outputs=("phi", "theta", "velocity_down"))
    drag = identify(records, "drag.linear")
    flown = fly_log([answers, drag], [large_motion(seed=8, heading_rad=0.0)])
    assert flown.model.name == "flight"
    (stretch,) = flown.stretches
    assert stretch.scores["velocity_north"].nrmse_fit_percent > 85.0
    with pytest.raises(UsageError, match="cannot be flown together"):
        fly_log([answers, answers], records)
    with pytest.raises(UsageError, match="no model of"):
        fly_log([identify(records, "response.first_order", outputs=("phi",)), drag], records)


def test_a_linear_answer_flies_too() -> None:
    model = identify([roll_flight(seed=1)], "response.second_order_delay")
    (stretch,) = fly_log(model, [roll_flight(seed=2)]).stretches
    assert stretch.scores["phi"].nrmse_fit_percent > 90.0
    _require_band(stretch)


def _require_band(stretch: FlownStretch) -> None:
    assert (stretch.lower <= stretch.simulated).all()
    assert (stretch.simulated <= stretch.upper).all()
    assert np.isfinite(stretch.upper).all()
