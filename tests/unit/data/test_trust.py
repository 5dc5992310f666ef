"""The limits of trust act where they are used: each case lies just inside and just outside of one."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rotorid.data.findings import warn
from rotorid.data.record import FlightRecord, Maneuver, Source
from rotorid.data.trust import least_coherence, trusted
from rotorid.errors import InsufficientDataError
from rotorid.fits.data_requirements import require_known_gain, require_support
from rotorid.fits.remarks import judge_band, judge_parameters
from rotorid.models.library import rate_model
from rotorid.results.verdicts import DATA_ONLY, _doubts
from rotorid.signal.excitations import rich_excitations, verifying_excitations
from rotorid.uncertainty.cramer_rao import Bounds

PARAMETERS = rate_model("rate.roll").parameters


def test_points_of_30_percent_error_and_the_coherence_of_their_estimate_count() -> None:
    errors, coherences = np.array([0.29, 0.31, 0.1, 0.1]), np.array([0.9, 0.9, 0.61, 0.59])
    assert trusted(errors, coherences, least_coherence(None, joint=False)).tolist() == [True, False, True, False]
    assert trusted(np.full(2, 0.1), np.array([0.21, 0.19]), least_coherence(None, joint=True)).tolist() == [True, False]


@pytest.mark.parametrize(
    ("cramer_rao", "insensitivity", "kinds"),
    [(19.0, 9.0, set()), (21.0, 9.0, {"uncertain_parameter"}), (19.0, 11.0, {"insensitive_parameter"})],
)
def test_parameters_are_usual_up_to_the_guidelines_of_cifer(
    cramer_rao: float, insensitivity: float, kinds: set[str]
) -> None:
    size = np.array([abs(PARAMETERS[name].value) for name in PARAMETERS.free])
    bounds = Bounds(
        names=PARAMETERS.free,
        cramer_rao=0.01 * cramer_rao * size,
        insensitivity=0.01 * insensitivity * size,
        covariance=np.diag((0.01 * size) ** 2),
        random=np.diag((0.01 * size) ** 2),
        colored=1.0,
    )
    found = {finding.kind for finding in judge_parameters(PARAMETERS, bounds)}
    assert found & {"uncertain_parameter", "insensitive_parameter"} == kinds


@pytest.mark.parametrize(("percent", "meaningless"), [(9.0, False), (11.0, True)])
def test_values_have_no_meaning_where_a_tenth_of_the_response_is_missed(percent: float, meaningless: bool) -> None:
    missed = warn("structure_error", "p/roll_command", "It misses.", model_error_percent=percent)
    assert (next(_doubts([missed]))[0] == DATA_ONLY) == meaningless


@pytest.mark.parametrize(("std", "known"), [(45.0, True), (55.0, False)])
def test_a_sign_is_certain_from_two_deviations(std: float, known: bool) -> None:
    parameters = PARAMETERS.with_values({"L_roll": 100.0})
    bounds = cast("Any", SimpleNamespace(names=("L_roll",), stds={"L_roll": std}))
    if known:
        require_known_gain("L_roll", parameters, bounds)
        return
    with pytest.raises(InsufficientDataError, match="the sign of L_roll"):
        require_known_gain("L_roll", parameters, bounds)


def measured(low_rad_s: float, high_rad_s: float) -> Any:
    """A response that is known in a band, of 1 to 40 rad/s that were asked for."""
    omega = np.geomspace(low_rad_s, high_rad_s, 20)
    response = SimpleNamespace(omega_rad_s=omega, outputs=("p",), inputs=("roll_command",))
    return SimpleNamespace(
        response=response, asked_rad_s=(1.0, 40.0), excited_rad_s={}, excited_to_rad_s=40.0, removed={}
    )


ALL = np.ones((1, 1, 20), dtype=np.bool_)


@pytest.mark.parametrize(("high", "kinds"), [(14.0, ["low_coherence"]), (16.0, [])])
def test_a_fit_says_where_less_than_70_percent_of_its_octaves_could_be_used(high: float, kinds: list[str]) -> None:
    found = judge_band(measured(1.0, 40.0**0.7 * high / 15.0), ALL, {})
    assert [finding.kind for finding in found] == kinds


@pytest.mark.parametrize(("low", "enough"), [(19.0, True), (21.0, False)])
def test_a_fit_needs_an_octave(low: float, enough: bool) -> None:
    given: dict[str, Any] = {"least_coherence": 0.2, "rate_model": True, "chosen": True}
    if enough:
        require_support(measured(low, 40.0), ALL, **given)
        return
    with pytest.raises(InsufficientDataError):
        require_support(measured(low, 40.0), ALL, **given)


def test_doublets_judge_a_model_and_are_not_fitted() -> None:
    source = Source(name="flight.BIN", format="dataflash", sha256="")
    sweep = Maneuver(axis="roll", kind="sweep", start_s=5.0, stop_s=60.0, origin="declared")
    doublet = replace(sweep, kind="doublet", start_s=70.0, stop_s=75.0)
    record = FlightRecord(source=source, topics=(), declared=(sweep, doublet))
    assert list(rich_excitations(record, "roll")) == [sweep]
    assert list(verifying_excitations(record, "roll")) == [doublet]
