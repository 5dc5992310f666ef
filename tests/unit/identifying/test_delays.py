"""Which pairs and stretches of a log tell delays, and the document about them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.fitting.late_lags import INPUT, OUTPUT, RATE_HZ, late_lag, slower

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.documents.delay import DelayDocument, delay_document
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.delay.fit import Order
from rotorid.flights.selection import default_pairs
from rotorid.identifying.delays import delay
from rotorid.settings.measuring import MeasureSettings
from rotorid.settings.parsing import parse_segment
from rotorid.typing import FloatArray

DELAY_SAMPLES = 2.7


def log(columns: dict[str, FloatArray], name: str = "log", rate_hz: float = RATE_HZ) -> FlightRecord:
    channels = tuple(Channel(name=column, unit=STANDARD_UNITS[column]) for column in columns)
    values = np.stack(list(columns.values()))
    topic = Topic(name="log", time_s=np.arange(values.shape[1]) / rate_hz, channels=channels, values=values)
    return FlightRecord(source=Source(name=name, format="twin", sha256=name), topics=(topic,))


@pytest.fixture(scope="module")
def record() -> FlightRecord:
    history = late_lag(1, DELAY_SAMPLES)
    rest = np.zeros(history.values.shape[1])
    return log({INPUT: history[INPUT], OUTPUT: history[OUTPUT], "theta_setpoint": rest, "theta": rest})


def test_set_points_that_move_are_the_default(record: FlightRecord) -> None:
    assert default_pairs([record]) == ((INPUT, OUTPUT),)


def test_commands_and_rates_stand_in_where_no_set_point_is_logged() -> None:
    history = late_lag(1, DELAY_SAMPLES)
    assert default_pairs([log({"roll_command": history[INPUT], "p": history[OUTPUT]})]) == (("roll_command", "p"),)


def test_a_log_without_pairs_is_refused() -> None:
    with pytest.raises(InsufficientDataError) as refused:
        default_pairs([log({"p": np.random.default_rng(0).normal(size=500)})])
    assert [finding.kind for finding in refused.value.findings] == ["missing_channel"]


def test_document_holds_the_delay_and_what_it_means(record: FlightRecord) -> None:
    document = delay_document(delay([record]))
    (name,) = document.pairs
    pair = document.pairs[name]
    assert name == f"{OUTPUT}/{INPUT}"
    assert pair.hold == "held"
    assert not pair.feedback
    assert pair.recommended.method == "records"
    assert pair.recommended.interval_s is not None
    low, high = pair.recommended.interval_s
    assert low < pair.recommended.delay_s < high
    assert pair.recommended.delay_samples == pytest.approx(DELAY_SAMPLES, abs=0.3)
    assert {estimate.method for estimate in pair.others} >= {"samples"}
    assert DelayDocument.model_validate_json(document.model_dump_json(by_alias=True)) == document


def test_a_shift_moves_the_delay(record: FlightRecord) -> None:
    plain = delay([record], input=INPUT, output=OUTPUT)
    moved = delay([record], input=INPUT, output=OUTPUT, settings=MeasureSettings(shifts={OUTPUT: 0.03}))
    name = f"{OUTPUT}/{INPUT}"
    change = moved.pairs[name].recommended.delay_s - plain.pairs[name].recommended.delay_s
    # The output is interpolated to move it, which costs it some of its highest frequencies.
    assert change == pytest.approx(0.03, abs=2e-3)


def test_several_logs_are_compared_with_a_lag_of_one_order() -> None:
    histories = {name: late_lag(seed, late) for name, seed, late in (("early", 1, 1.7), ("late", 2, 3.7))}
    logs = [log({INPUT: of[INPUT], OUTPUT: of[OUTPUT]}, name) for name, of in histories.items()]
    result = delay(logs, order=2)
    pair = result.pairs[f"{OUTPUT}/{INPUT}"]
    alone = {name: estimate for name, estimate in pair.alone.items() if estimate is not None}
    assert list(alone) == ["early", "late"]
    assert {estimate.order for estimate in (pair.recommended, *alone.values())} == {Order(0, 2)}
    assert alone["late"].delay_s - alone["early"].delay_s == pytest.approx(2.0 / RATE_HZ, abs=0.3 / RATE_HZ)
    assert alone["early"].delay_s < pair.recommended.delay_s < alone["late"].delay_s
    document = delay_document(result)
    assert list(document.pairs[f"{OUTPUT}/{INPUT}"].records) == ["early", "late"]


def test_a_log_that_shows_no_delay_is_listed_without_a_number(record: FlightRecord) -> None:
    rng = np.random.default_rng(8)
    noise = {name: 1e-3 * rng.standard_normal(record[name].values.size) for name in (INPUT, OUTPUT)}
    pair = delay([record, log(noise, "still")], input=INPUT, output=OUTPUT).pairs[f"{OUTPUT}/{INPUT}"]
    assert pair.alone["log"] is not None
    assert pair.alone["still"] is None


def test_an_order_beyond_those_of_lags_is_refused(record: FlightRecord) -> None:
    with pytest.raises(UsageError, match="--order 7 was given; expected the order of a lag, 1 to 4"):
        delay([record], order=7)


@pytest.mark.parametrize(
    ("input", "output", "words"),
    [
        (INPUT, None, "was given without"),
        (None, OUTPUT, "was given without"),
        (INPUT, INPUT, "is both input and output"),
        ("phi_setpiont", OUTPUT, "did you mean phi_setpoint"),
    ],
)
def test_slips_are_named(input: str | None, output: str | None, words: str, record: FlightRecord) -> None:
    with pytest.raises(UsageError, match=words):
        delay([record], input=input, output=output)


def test_segments_outside_of_the_log_are_refused(record: FlightRecord) -> None:
    settings = MeasureSettings(segments=(parse_segment("roll:900:950"),))
    with pytest.raises(UsageError, match="outside every log"):
        delay([record], input=INPUT, output=OUTPUT, settings=settings)


def test_logs_of_different_rates_keep_their_own() -> None:
    fast, slow = (late_lag(seed, DELAY_SAMPLES, samples=1200, hold_samples=6) for seed in (1, 2))
    slow = slower(slow)
    logs = [
        log({INPUT: one[INPUT], OUTPUT: one[OUTPUT]}, name, one.sample_rate_hz)
        for one, name in ((fast, "fast"), (slow, "slow"))
    ]
    result = delay(logs, input=INPUT, output=OUTPUT)
    pair = result.pairs[f"{OUTPUT}/{INPUT}"]
    assert pair.hold == "held"
    assert pair.recommended.std_s is not None
    assert abs(pair.recommended.delay_s - DELAY_SAMPLES / RATE_HZ) < 4.0 * pair.recommended.std_s
    assert not any("were resampled to" in finding.message for finding in result.findings)


def test_feedback_in_logs_of_different_rates_is_refused() -> None:
    fast = late_lag(1, DELAY_SAMPLES, samples=1200, hold_samples=6)
    logs = [
        log({INPUT: one[INPUT], "phi": one[OUTPUT], "p": one[OUTPUT]}, name, one.sample_rate_hz)
        for one, name in ((fast, "fast"), (slower(fast), "slow"))
    ]
    settings = MeasureSettings(instruments=("p",))
    with pytest.raises(UsageError, match="each rate separately"):
        delay(logs, input=INPUT, output=OUTPUT, settings=settings)


def test_feedback_without_an_instrument_is_warned_of() -> None:
    history = late_lag(1, DELAY_SAMPLES)
    found = delay([log({"roll_command": history[INPUT], "p": history[OUTPUT]})])
    assert found.pairs["p/roll_command"].feedback
    (finding,) = [finding for finding in found.findings if finding.kind == "closed_loop_bias"]
    assert finding.where == "p/roll_command"


@pytest.mark.parametrize(
    ("instruments", "words"),
    [
        (("phi_setpiont",), "did you mean phi_setpoint"),
        ((OUTPUT,), "the output itself"),
        ((INPUT, "theta"), "expected one"),
    ],
)
def test_wrong_instruments_are_named(instruments: tuple[str, ...], words: str, record: FlightRecord) -> None:
    settings = MeasureSettings(instruments=instruments)
    with pytest.raises(UsageError, match=words):
        delay([record], input=INPUT, output=OUTPUT, settings=settings)


def test_an_instrument_that_is_not_logged_is_missed(record: FlightRecord) -> None:
    with pytest.raises(InsufficientDataError, match="has no roll_excitation"):
        delay([record], input=INPUT, output=OUTPUT, settings=MeasureSettings(instruments=("roll_excitation",)))


def test_why_there_is_no_joint_response_is_said(record: FlightRecord) -> None:
    # The other set-point rests: nothing of the input is coherent with it.
    settings = MeasureSettings(instruments=("theta_setpoint",))
    found = delay([record], input=INPUT, output=OUTPUT, settings=settings)
    (finding,) = [finding for finding in found.findings if finding.kind == "closed_loop_bias"]
    assert found.pairs[f"{OUTPUT}/{INPUT}"].recommended.method == "records"
    assert "no joint frequency response was usable (" in finding.message


@pytest.mark.slow
def test_noise_shows_no_delay() -> None:
    history = late_lag(1, DELAY_SAMPLES)
    noise = np.random.default_rng(77).normal(size=history.values.shape[1])
    with pytest.raises(InsufficientDataError, match="no pair of channels shows a delay") as refused:
        delay([log({INPUT: history[INPUT], OUTPUT: noise})])
    assert [finding.kind for finding in refused.value.findings] == ["no_delay"]
    seen = delay(
        [log({INPUT: history[INPUT], OUTPUT: history[OUTPUT], "theta_setpoint": history[INPUT], "theta": noise})]
    )
    (finding,) = [finding for finding in seen.findings if finding.kind == "no_delay"]
    assert finding.where == "theta/theta_setpoint"


def test_one_sample_is_refused() -> None:
    one = np.ones(1)
    with pytest.raises(InsufficientDataError, match="one moment"):
        delay([log({INPUT: one, OUTPUT: one})], input=INPUT, output=OUTPUT)


def test_delays_show_themselves_in_a_few_lines(record: FlightRecord) -> None:
    result = delay([record])
    shown = repr(result).splitlines()
    assert f"{OUTPUT}/{INPUT}" in shown[1]
    assert len(shown) <= 20
    assert "<table>" in result._repr_html_()


def test_a_delay_whose_interval_has_no_deviation_shows_the_interval(record: FlightRecord) -> None:
    result = delay([record])
    (pair,) = result.pairs.values()
    without = replace(pair.recommended, delay_s=0.04875, std_s=None, interval_s=(0.0453, 0.0522))
    shown = replace(result, pairs={"p": replace(pair, analysis=replace(pair.analysis, recommended=without))})
    assert "49 ms (45 to 52 ms)" in repr(shown)
