"""What follows from an identified model: in the result, printed, in tables and on the page."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.report.hover_sample import hover_document, hover_identification
from tests.unit.report.page_parser import Page

from rotorid.cli.identify import print_result
from rotorid.documents.base import to_json
from rotorid.documents.result import ResultDocument
from rotorid.errors import UsageError
from rotorid.identifying.derivation import derivation, derivation_findings
from rotorid.identifying.families import require_choices
from rotorid.models.derived import derived_quantities
from rotorid.models.library import library_model
from rotorid.models.parameter import ParameterSet
from rotorid.report.identification import render_sections
from rotorid.report.tables import as_csv, as_latex, result_tables
from rotorid.results.summary import DerivedSummary, Range
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.parsing import parse_known
from rotorid.uncertainty.cramer_rao import Bounds

HEAVE = {"Z_thrust": -33.8, "Z_w": -0.59, "tau_thrust": 0.03, "T_motor": 0.024}
KNOWN = {"k_n": (114.7, 0.0), "m": (0.52, 0.005), "D": (0.2032, 0.0), "rho": (1.2, 0.0)}


def bounds(parameters: ParameterSet, percent: float = 1.0) -> Bounds:
    std = np.array([0.01 * percent * abs(parameters[name].value) for name in parameters.free])
    return Bounds(
        names=parameters.free,
        cramer_rao=std,
        insensitivity=std,
        covariance=np.diag(std**2),
        random=np.diag(std**2),
        colored=1.0,
    )


def heave(**changes: float) -> ParameterSet:
    return library_model("axis.vertical").parameters.with_values(HEAVE | changes)


def summary(parameters: ParameterSet | None = None, **options: object) -> DerivedSummary:
    chosen = parameters or heave()
    given = {"known": KNOWN, "covered": {}, **options}
    found = derivation(chosen, bounds(chosen), **given)  # type: ignore[arg-type]
    assert found is not None
    return found


def test_nothing_follows_where_nothing_is_known() -> None:
    assert derivation(heave(), bounds(heave()), known={}, covered={}) is None
    assert derivation_findings(None) == []


def test_physics_of_hover_has_its_thrust_over_the_advance_ratio_by_itself() -> None:
    parameters = library_model("physical.hover").parameters
    found = derivation(parameters, bounds(parameters), known={}, covered={})
    assert found is not None
    at_rest = found.thrust[len(found.thrust) // 2]
    assert (at_rest.advance_ratio, at_rest.c_T) == (0.0, parameters["c_T"].value)
    assert at_rest.std == pytest.approx(0.01 * parameters["c_T"].value)


def test_thrust_falls_with_climb_and_is_marked_where_it_was_flown() -> None:
    points = summary(covered={"w": Range(unit="m/s", lowest=-2.0, highest=1.0, rms=0.5)}).thrust
    tip = summary().quantities["n_h"].value * KNOWN["D"][0]
    assert points[-1].advance_ratio == pytest.approx(2.0 / tip)
    assert points[0].c_T > points[-1].c_T
    assert [one.flown for one in points] == [one.advance_ratio >= -1.0 / tip for one in points]
    assert all(one.lower < one.c_T < one.upper for one in points)


def test_without_a_vertical_speed_nobody_knows_what_was_flown() -> None:
    assert {one.flown for one in summary().thrust} == {None}


def test_the_part_of_the_flight_is_told_apart() -> None:
    """The coefficient has twice the relative error of the thrust slope, and once that of the mass."""
    one = summary().quantities["c_T"]
    assert one.std_identified / one.value == pytest.approx(0.02)
    # m stands in c_T alone, as n_h comes from the slope and not from the weight.
    assert one.std / one.value == pytest.approx(np.hypot(0.02, 0.005 / 0.52))


def test_nothing_follows_from_a_parameter_that_was_dropped() -> None:
    yaw = library_model("axis.yaw").parameters.drop("N_spin")
    found = derivation(yaw, bounds(yaw), known={"I_zz": (0.006, 0.0), "k_n": (115.0, 0.0)}, covered={})
    assert found is not None
    assert "J_r" not in found.quantities


def test_a_clearly_wrong_sign_is_remarked() -> None:
    found = summary(heave(Z_w=0.5))
    assert [(one.kind, one.where) for one in derivation_findings(found)] == [("impossible_physics", "dc_T_dJ")]
    unsure = derivation(heave(Z_w=0.5), bounds(heave(Z_w=0.5), 80.0), known=KNOWN, covered={})
    assert derivation_findings(unsure) == []


@pytest.fixture(scope="module")
def document() -> ResultDocument:
    return hover_document().model_copy(update={"derived": summary(known=KNOWN | {"k_omega_delta": (788.0, 0.0)})})


def test_the_document_says_it_and_reads_it_back(document: ResultDocument) -> None:
    again = ResultDocument.model_validate_json(to_json(document))
    assert again.derived == document.derived


def test_tables_hold_it(document: ResultDocument) -> None:
    tables = {table.name: table for table in result_tables(document)}
    assert as_csv(tables["derived"]).splitlines()[0] == "quantity,value,std,std_identified,unit,meaning"
    rows = as_csv(tables["thrust_coefficient"]).splitlines()
    assert rows[0] == "advance_ratio,c_T,std,lower,upper,flown"
    assert len(rows) == 12
    assert "Coefficient" in as_latex(tables["thrust_coefficient"])


def test_the_page_shows_it(document: ResultDocument) -> None:
    shown = replace(hover_identification(), document=document)
    text = "".join(Page(render_sections([shown], title="t")).text)
    assert "Rotors and motors" in text
    assert "Thrust coefficient over the advance ratio" in text
    assert "Given by you: k_n" in text


def test_it_is_printed(document: ResultDocument, capsys: pytest.CaptureFixture[str], tmp_path: object) -> None:
    from pathlib import Path

    short = replace(document.derived, missing={"c_P": ("I_zz",)})  # type: ignore[type-var]
    print_result(document.model_copy(update={"derived": short}), Path("folder"), verbose=True)
    printed = capsys.readouterr().out
    assert "c_T 0.1" in printed
    assert "c_P also needs I_zz: add --known I_zz=VALUE:STD" in printed


def test_a_known_quantity_is_told_in_the_provenance() -> None:
    settings = IdentifySettings(known=parse_known(["I_zz=0.006:0.0002", "k_n=115"]))
    assert settings.as_json()["known"] == ["I_zz=0.006:0.0002", "k_n=115.0:0.0"]
    assert "known" not in IdentifySettings().as_json()


@pytest.mark.parametrize("text", ["I_zz", "I_zz=", "I_zz=a", "I_zz=1:b", "I_zz=1:2:3", "=1"])
def test_what_is_no_known_quantity_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match=r"I_zz=0\.012:0\.0004"):
        parse_known([text])


def test_motors_take_no_known_quantity() -> None:
    with pytest.raises(UsageError, match=r"known does not apply to physical\.motors"):
        require_choices("physical.motors", IdentifySettings(known={"I_zz": (0.006, 0.0)}))


def test_the_slope_of_a_large_sweep_is_that_at_its_mean_speed() -> None:
    hover, moved = 66.47, 114.7 * 0.132
    mean = float(np.sqrt(hover**2 - moved**2))
    parameters = {"Z_thrust": -2.0 * 9.80665 * 114.7 * mean / hover**2, "Z_w": -0.59}
    found = derived_quantities(parameters, np.zeros((2, 2)), KNOWN, thrust_spread=0.132).values
    assert (found["n_h"], found["n_m"]) == pytest.approx((hover, mean), rel=1e-12)
    assert found["dc_T_dJ"] == pytest.approx(0.52 * -0.59 / (4.0 * 1.2 * mean * 0.2032**3), rel=1e-12)
    small = derived_quantities(parameters, np.zeros((2, 2)), KNOWN).values
    assert "n_m" not in small
    assert small["n_h"] == pytest.approx(hover**2 / mean, rel=1e-12)
    # Larger than rotors of such a slope can fly: nothing but the slope counts.
    assert derived_quantities(parameters, np.zeros((2, 2)), KNOWN, thrust_spread=1.0).values["n_h"] == small["n_h"]
