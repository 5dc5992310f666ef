"""Models side by side: what is read, what is scored, what counts as seen."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
from tests.unit.identifying.response_twins import flight, written

from rotorid.checking.linear import with_rest
from rotorid.data.record import FlightRecord, Maneuver
from rotorid.documents.compare import CompareDocument, compare_document, read_results
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.flights import Flight
from rotorid.identifying.comparison import Comparison, compare, refused_comparison
from rotorid.report.files import to_json
from rotorid.settings.identifying import IdentifySettings


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """First order from flight 1, second order from flights 1 and 2."""
    folder = tmp_path_factory.mktemp("results")
    return [
        written(folder / "first", "response.first_order", 1),
        written(folder / "second", "response.second_order", 1),
        written(folder / "other", "response.second_order", 2),
    ]


@pytest.fixture(scope="module")
def unseen(results: list[Path]) -> Comparison:
    return compare(read_results(results), [flight(3)])


def test_what_results_say_of_themselves_stands_side_by_side(results: list[Path]) -> None:
    document = compare_document(compare(read_results(results)))
    assert [one.label for one in document.models] == ["first", "second", "other"]
    assert [one.free_parameters for one in document.models] == [2, 3, 3]
    assert [one.order for one in document.models] == [1, 2, 2]
    assert {one.method for one in document.models} == {"output_error"}
    assert all(one.fit_percent and one.aic is not None and one.bic is not None for one in document.models)
    assert document.maneuvers == []
    assert all(one.on_logs is None for one in document.models)


def test_all_are_scored_on_the_same_log(unseen: Comparison) -> None:
    document = compare_document(unseen)
    (maneuver,) = document.maneuvers
    assert maneuver.record == "flight_3.csv"
    assert document.common_outputs == ["phi"]
    assert document.horizon_s is None
    assert not any(score.seen for score in maneuver.models.values())
    by_label = {one.label: one.on_logs for one in document.models}
    assert all(summary is not None and not summary.seen for summary in by_label.values())
    means = {label: summary.mean_percent for label, summary in by_label.items() if summary}
    assert means["second"] == maneuver.models["second"].mean_percent
    assert means["first"] < means["second"] - 10.0
    assert means["second"] == pytest.approx(means["other"], abs=1.0)
    assert document.findings == []


def test_measured_and_predicted_stand_behind_the_scores(unseen: Comparison) -> None:
    (maneuver,) = unseen.maneuvers
    (scored,) = maneuver.scores["second"]
    assert scored.measured.shape == scored.predicted.shape == (1, scored.time_s.size)
    assert math.isnan(maneuver.mean_percent("second", ["theta"]))


def test_a_log_that_was_fitted_is_seen_by_its_hash(results: list[Path]) -> None:
    document = compare_document(compare(read_results(results), [flight(1), flight(3)]))
    assert [{label for label, one in each.models.items() if one.seen} for each in document.maneuvers] == [
        {"first", "second"},
        set(),
    ]
    # Only the flight that none has seen counts.
    assert all(one.on_logs is not None and one.on_logs.maneuvers == 1 for one in document.models)


def test_with_nothing_unseen_the_comparison_says_whom_it_flatters(results: list[Path]) -> None:
    document = compare_document(compare(read_results(results), [flight(1)]))
    (finding,) = document.findings
    assert (finding.kind, finding.where) == ("seen_data", "first, second")
    assert all(one.on_logs is not None and one.on_logs.seen for one in document.models)


def test_another_stretch_of_a_fitted_log_is_unseen(results: list[Path]) -> None:
    entry = read_results(results)[0]
    (used,) = entry.model.provenance.maneuvers
    later = Maneuver(axis="roll", kind="other", start_s=used.stop_s, stop_s=used.stop_s + 5.0)
    within = Maneuver(axis="roll", kind="other", start_s=1.0, stop_s=2.0)
    assert entry.was_fitted(Flight(flight(1), within))
    assert not entry.was_fitted(Flight(flight(1), later))
    assert not entry.was_fitted(Flight(flight(3), within))


def test_shared_parameters_have_a_distance_in_standard_deviations(results: list[Path]) -> None:
    values = compare_document(compare(read_results(results))).parameters["omega_phi"].values
    assert values.keys() == {"second", "other"}
    first, second = values["second"], values["other"]
    assert first.z is None
    assert first.std is not None
    assert second.std is not None
    assert second.z == pytest.approx((second.value - first.value) / math.hypot(first.std, second.std))
    # Two estimates of the same truth from independent noise.
    assert abs(second.z) < 4.0


def test_results_of_one_log_have_no_distance(results: list[Path]) -> None:
    values = compare_document(compare(read_results(results))).parameters["K_phi"].values
    assert {label: one.z is not None for label, one in values.items()} == {
        "first": False,
        "second": False,
        "other": True,
    }


def test_a_log_that_only_verified_a_result_stands_behind_none_of_its_values(
    results: list[Path], tmp_path: Path
) -> None:
    table = json.loads((results[1] / "result.json").read_text())
    table["provenance"]["inputs"] |= {"flight_2.csv": flight(2).source.sha256}
    verified = tmp_path / "verified"
    verified.mkdir()
    (verified / "result.json").write_text(json.dumps(table))
    values = compare_document(compare(read_results([verified, results[2]]))).parameters["omega_phi"].values
    assert values["other"].z is not None


def test_models_without_a_common_output_do_not_compare(results: list[Path], tmp_path: Path) -> None:
    table = json.loads((results[1] / "result.json").read_text().replace('"phi"', '"theta"'))
    other = tmp_path / "pitch"
    other.mkdir()
    (other / "result.json").write_text(json.dumps(table))
    model = (results[1] / "model.toml").read_text().replace("phi_setpoint", "theta_setpoint")
    (other / "model.toml").write_text(model.replace('"phi = ', '"theta = '))
    document = compare_document(compare(read_results([results[0], other]), [both_axes()]))
    assert "different_outputs" in {finding.kind for finding in document.findings}


def both_axes() -> FlightRecord:
    """Roll and, with the same numbers, pitch."""
    one = flight(3)
    topic = one.topics[0]
    names = [replace(c, name=c.name.replace("phi", "theta")) for c in topic.channels]
    both = replace(topic, channels=(*topic.channels, *names), values=[*topic.values.tolist(), *topic.values.tolist()])
    return replace(one, topics=(both,))


def test_a_log_without_the_channels_scores_nothing(results: list[Path]) -> None:
    one = flight(3)
    topic = one.topics[0]
    bare = replace(one, topics=(replace(topic, channels=topic.channels[:1], values=topic.values[:1]),))
    with pytest.raises(InsufficientDataError, match="phi") as refused:
        compare(read_results(results), [bare])
    document = compare_document(
        refused_comparison(refused.value, read_results(results), [bare], settings=IdentifySettings())
    )
    assert {finding.kind for finding in document.findings} == {"not_verified"}
    assert len(document.models) == 3


def test_a_log_without_motion_scores_nothing(results: list[Path]) -> None:
    (topic,) = (one := flight(3)).topics
    still = replace(one, topics=(replace(topic, values=[[0.1] * topic.time_s.size, topic.values[1].tolist()]),))
    with pytest.raises(InsufficientDataError, match="phi_setpoint does not move"):
        compare(read_results(results), [still])
    document = compare_document(compare(read_results(results), [still, flight(4)]))
    assert [one.record for one in document.maneuvers] == ["flight_4.csv"]
    assert {finding.kind for finding in document.findings} == {"not_verified"}


def test_a_result_without_its_model_is_compared_but_not_scored(results: list[Path], tmp_path: Path) -> None:
    bare = tmp_path / "bare"
    bare.mkdir()
    (bare / "result.json").write_text((results[1] / "result.json").read_text())
    document = compare_document(compare(read_results([results[0], bare]), [flight(3)]))
    assert document.models[1].on_logs is None
    assert document.models[1].free_parameters == 3
    (finding,) = document.findings
    assert "no model.toml" in finding.message


def test_the_document_can_be_read_back(unseen: Comparison) -> None:
    text = to_json(compare_document(unseen))
    assert json.loads(text)["schema"] == "rotorid.compare/1"
    assert CompareDocument.model_validate_json(text) == compare_document(unseen)


def test_provenance_names_results_and_logs(unseen: Comparison) -> None:
    assert compare_document(unseen).provenance.inputs.keys() == {
        "first/result.json",
        "second/result.json",
        "other/result.json",
        "flight_3.csv",
    }


def test_folders_of_one_name_are_told_apart(results: list[Path], tmp_path: Path) -> None:
    for above in ("a", "b"):
        (tmp_path / above / "same").mkdir(parents=True)
        (tmp_path / above / "same" / "result.json").write_text((results[0] / "result.json").read_text())
    entries = read_results([tmp_path / "a" / "same", tmp_path / "b" / "same" / "result.json"])
    assert [entry.label for entry in entries] == ["a/same", "b/same"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "is no JSON"),
        ("[]", "names no schema"),
        ('{"schema": "rotorid.verify/1"}', "has the schema rotorid.verify/1"),
        ('{"schema": "rotorid.result/1"}', "does not fit its schema at model"),
    ],
)
def test_what_is_no_result_is_refused(text: str, said: str, results: list[Path], tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text(text)
    with pytest.raises(UsageError, match=said):
        read_results([results[0], tmp_path])


def test_a_refused_result_holds_no_model(results: list[Path], tmp_path: Path) -> None:
    table = json.loads((results[0] / "result.json").read_text())
    (tmp_path / "result.json").write_text(json.dumps({**table, "parameters": {}}))
    with pytest.raises(UsageError, match="has no model"):
        read_results([results[0], tmp_path])


def test_results_are_two_or_more_and_different(results: list[Path], tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="at least two"):
        read_results(results[:1])
    with pytest.raises(UsageError, match="given twice"):
        read_results([results[0], results[0] / "result.json"])
    with pytest.raises(UsageError, match="cannot be read"):
        read_results([results[0], tmp_path / "nowhere"])


def test_a_model_of_another_result_is_noticed(results: list[Path], tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text((results[0] / "result.json").read_text())
    (tmp_path / "model.toml").write_text((results[1] / "model.toml").read_text())
    with pytest.raises(UsageError, match="files of one result"):
        read_results([results[1], tmp_path])


def test_short_maneuvers_take_the_time_around_them_along() -> None:
    record = flight(1)
    short = [Maneuver(axis="roll", kind="doublet", start_s=start, stop_s=start + 1.0) for start in (0.5, 2.5, 8.0)]
    sweep = Maneuver(axis="roll", kind="sweep", start_s=10.0, stop_s=14.0)
    flights = with_rest(record, [Flight(record, m) for m in (*short, sweep)])
    wider = [(flight.maneuver.start_s, flight.maneuver.stop_s) for flight in flights]
    # To the beginning of the log, half way to a neighbor, or 1.5 s.
    assert wider == [(0.0, 2.0), (2.0, 5.0), (6.5, 9.5), (10.0, 14.0)]
