"""Rates of commands: measured by their stamps, and commands that wait in the vehicle found by the delay."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.documents.delay import delay_document
from rotorid.identifying.command_rates import CommandRate, buffered
from rotorid.identifying.delays import Delays
from rotorid.io.tables import write_csv
from rotorid.vehicles import bebop

RATES = (10.0, 20.0, 50.0)


def logs(folder: Path, *, waiting: int, duration_s: float = 30.0) -> list[Path]:
    made = []
    for rate in RATES:
        made.append(folder / f"rate-{rate:.0f}.csv")
        flown = bebop.commanded(rate, rng=np.random.default_rng(int(rate)), buffered=waiting, duration_s=duration_s)
        write_csv(made[-1], *flown)
    return made


@pytest.fixture(scope="module")
def delays(tmp_path_factory: pytest.TempPathFactory) -> Delays:
    made = logs(tmp_path_factory.mktemp("sent"), waiting=bebop.BUFFERED)
    return rotorid.delay(made, input="theta_setpoint", output="theta", order=1)


def test_rates_and_jitter_are_those_of_the_stamps(delays: Delays) -> None:
    assert [one.rate_hz for one in delays.rates] == pytest.approx(RATES, rel=1e-6)
    assert all(one.jitter_s < 1e-6 for one in delays.rates)
    # Steps last 0.8 to 2 s; one that stays at its level is not seen.
    assert all(one.hold_s is not None and 0.8 <= one.hold_s <= 3.0 for one in delays.rates)


def test_commands_that_wait_are_answered_later_by_the_queue(delays: Delays) -> None:
    usual = bebop.FIRST_ORDER_DELAY["tau_theta"]
    for one in delays.rates:
        assert one.delay_s is not None
        assert one.std_s is not None
        # A command that enters a full queue waits for all before it, a turn each; it enters up to a turn after the
        # one that made room.
        low, high = (0.5, 0.5) if one.rate_hz <= bebop.LOOP_HZ else (bebop.BUFFERED - 1.0, bebop.BUFFERED + 1.0)
        assert one.delay_s >= usual + low / bebop.LOOP_HZ - 2.0 * one.std_s, one
        assert one.delay_s <= usual + high / bebop.LOOP_HZ + 2.0 * one.std_s, one


def test_it_is_said_up_to_which_rate_commands_do_not_wait(delays: Delays) -> None:
    (said,) = [one for one in delays.findings if one.kind == "buffered_commands"]
    assert "at 50 Hz than at 20 Hz and less" in said.message
    assert said.numbers["rate_hz"] == pytest.approx(20.0)
    document = delay_document(delays)
    assert [one.record for one in document.rates] == [f"rate-{rate:.0f}.csv" for rate in RATES]


def test_without_a_queue_nothing_is_said(tmp_path: Path) -> None:
    found = rotorid.delay(logs(tmp_path, waiting=0), input="theta_setpoint", output="theta", order=1)
    assert len(found.rates) == len(RATES)
    assert not [one for one in found.findings if one.kind == "buffered_commands"]


def test_a_delay_within_its_error_is_no_queue() -> None:
    slow = CommandRate(
        record="slow",
        input="theta_setpoint",
        output="theta",
        rate_hz=20.0,
        jitter_s=0.0,
        longest_s=0.05,
        hold_s=1.0,
        delay_s=0.05,
        std_s=0.01,
    )
    near = replace(slow, record="near", rate_hz=50.0, delay_s=0.07)
    unknown = replace(slow, record="unknown", rate_hz=80.0, delay_s=None, std_s=None)
    far = replace(slow, record="far", rate_hz=100.0, delay_s=0.2)
    assert list(buffered([near, slow, unknown])) == []
    (said,) = buffered([far, near, slow, unknown])
    assert said.numbers["rate_hz"] == 50.0


def test_a_log_that_is_late_between_faster_and_slower_ones_that_are_not_is_no_queue() -> None:
    on_time = CommandRate(
        record="slow",
        input="theta_setpoint",
        output="theta",
        rate_hz=50.0,
        jitter_s=0.0,
        longest_s=0.02,
        hold_s=1.0,
        delay_s=0.06,
        std_s=0.004,
    )
    late = replace(on_time, record="late", rate_hz=71.0, delay_s=0.154)
    faster = replace(on_time, record="faster", rate_hz=91.0, delay_s=0.065)
    assert list(buffered([on_time, late]))
    assert list(buffered([on_time, late, faster])) == []
    unsure = replace(faster, std_s=0.1)
    assert list(buffered([on_time, late, unsure]))
