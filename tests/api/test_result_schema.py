"""The names in ``result.json``, word for word: scripts are written against them."""

from __future__ import annotations

from typing import Any

import pytest

from rotorid.documents.result import ResultDocument

NAMES = {
    "ResultDocument": {
        *("schema", "model", "inputs", "outputs", "states", "parameters", "cost", "fit_percent", "matrices", "poles"),
        *("verification", "identifiability", "findings", "provenance"),
        *("fit", "reduction", "correlation", "constants", "delays", "covered"),
        *("method", "hold", "pieces_s", "records", "noise", "log_likelihood", "information", "residuals", "minima"),
        *(
            "frequency_fit",
            "cross_validation",
            "equations",
            "search",
            "bootstrap",
            "motors",
            "flight",
            "derived",
            "controller",
            "verdict",
        ),
        *("orders", "rotors", "filters_removed", "noise_runs"),
    },
    "ParameterEstimate": {"value", "unit", "std", "cramer_rao_percent", "insensitivity_percent", "status"}
    | {"std_random", "std_model", "lower", "upper"},
    "Cost": {"average", "pairs"},
    "PairCost": {"value", "band_rad_s", "points"},
    "MatricesDocument": {"M", "F", "G", "H0", "H1", "delays_s"},
    "DelaysDocument": {"inputs", "outputs"},
    "PoleEstimate": {"real", "imag", "damping", "frequency_rad_s"}
    | {"real_std", "imag_std", "damping_std", "frequency_std_rad_s"},
    "Checks": {"records", "frequency", "maneuvers", "sweeps"},
    "Scores": {"nrmse_fit_percent", "tic", "rms", "bias", "reference_shift"},
    "UnseenCombination": {"words", "vector"},
    "EquationFit": {"name", "r_squared", "press", "misfit"},
    "SearchSummary": {
        "name",
        "objective",
        "evaluations",
        "polishing",
        "local_searches",
        "minima",
        "trace",
        "alone",
        "runs",
        "iterations",
        "points",
    },
    "SearchRuns": {"runs", "seed", "left_out", "alone", "polished"},
    "RunTable": {"cost", "parameters", "costs", "draws"},
    "RunSpread": {"mean", "std", "min", "max"},
    "SearchMinimum": {"cost", "share", "parameters"},
    "BootstrapSummary": {"source", "runs", "seed", "left_out", "parameters", "correlation"},
    "Spread": {"mean", "std", "relative_percent", "low", "median", "high"},
    "FindingDocument": {"kind", "severity", "where", "message", "numbers"},
}


@pytest.fixture(scope="module")
def definitions() -> dict[str, Any]:
    schema = ResultDocument.model_json_schema(by_alias=True)
    return {**schema["$defs"], "ResultDocument": schema}


@pytest.mark.parametrize("name", NAMES)
def test_fields_are_those_of_the_contract(name: str, definitions: dict[str, Any]) -> None:
    assert set(definitions[name]["properties"]) == NAMES[name]
    assert definitions[name]["additionalProperties"] is False


def test_schema_names_itself(definitions: dict[str, Any]) -> None:
    assert definitions["ResultDocument"]["properties"]["schema"]["const"] == "rotorid.result/1"


def test_a_parameter_is_free_fixed_tied_or_dropped(definitions: dict[str, Any]) -> None:
    status = definitions["ParameterEstimate"]["properties"]["status"]
    assert status["enum"] == ["free", "fixed", "tied", "dropped"]


def test_what_may_be_unknown_is_null(definitions: dict[str, Any]) -> None:
    for name in ("std", "cramer_rao_percent", "insensitivity_percent"):
        kinds = {option.get("type") for option in definitions["ParameterEstimate"]["properties"][name]["anyOf"]}
        assert kinds == {"number", "null"}


def test_provenance_says_how_to_make_it_again(definitions: dict[str, Any]) -> None:
    assert {"version", "command", "inputs", "settings", "seed"} <= set(definitions["ProvenanceDocument"]["properties"])
