"""Claims of README, CHANGELOG and docs that the program can confirm or refute."""

from __future__ import annotations

import re
from functools import partial

import pytest
from benchmarks import accuracy, peers
from tests.docs.measured import FLIGHTS, ROOT, SAMPLES, Flight, a_flown_plan, a_plan, first_command, row_of

from rotorid.models.rotors import layout_names
from rotorid.search.catalog import searches
from rotorid.vehicles.catalog import VEHICLES

RECORD = peers.load()
NUMBERS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


def page(name: str) -> str:
    """A page on one line, so that a sentence is found wherever it is broken."""
    return re.sub(r"\s+", " ", (ROOT / name).read_text(encoding="utf-8"))


def count(name: str, sentence: str) -> int:
    """The number at ``{n}`` in a sentence of a page, in digits or in words."""
    found = re.findall(re.escape(sentence).replace(r"\{n\}", r"(\w+)"), page(name))
    assert len(found) == 1, f"{name} says {len(found)} times: {sentence}"
    return int(found[0]) if found[0].isdigit() else NUMBERS.index(found[0].lower())


FLYING = [name for name in VEHICLES if name != "rig"]


@pytest.mark.parametrize(
    ("name", "sentence", "is_so"),
    [
        ("CHANGELOG.md", "a library of {n}, or a TOML file", len(layout_names())),
        ("CHANGELOG.md", "- {n} searches with one interface", len(searches())),
        ("CHANGELOG.md", "- {n} vehicles with sources", len(FLYING)),
        ("docs/what-it-does.md", "[{n} multirotors](simulation.md)", len(FLYING)),
    ],
)
def test_things_are_as_many_as_is_said(name: str, sentence: str, is_so: int) -> None:
    assert count(name, sentence) == is_so


@pytest.mark.usefixtures("shared_data")
def test_the_readme_shows_what_the_first_command_prints() -> None:
    assert SAMPLES["first command"].shown == first_command(), "renew it with `python -m tests.docs.measured`"


@pytest.mark.parametrize(
    "flight",
    [flight if place == 0 else pytest.param(flight, marks=pytest.mark.slow) for place, flight in enumerate(FLIGHTS)],
    ids=lambda flight: flight.title,
)
@pytest.mark.usefixtures("shared_data")
def test_the_table_of_accuracy_shows_what_is_identified(flight: Flight) -> None:
    assert row_of(flight) in SAMPLES["known truths"].shown, "renew it with `python -m tests.docs.measured`"


def test_the_plan_of_the_page_is_what_the_command_prints() -> None:
    assert SAMPLES["a plan"].shown == a_plan(), "renew it with `python -m tests.docs.measured 'a plan'`"


@pytest.mark.slow
def test_the_flown_plan_of_the_page_is_what_is_identified() -> None:
    assert SAMPLES["a flown plan"].shown == a_flown_plan(), "renew it with `python -m tests.docs.measured`"


@pytest.mark.parametrize("name", ["beside peers", "accuracy beside peers"])
def test_tables_beside_peers_show_the_record(name: str) -> None:
    assert SAMPLES[name].shown == SAMPLES[name].made(), f"renew it with `python -m tests.docs.measured '{name}'`"


def test_every_number_beside_peers_has_its_command_and_its_day() -> None:
    for work, methods in RECORD.items():
        for method, told in methods.items():
            assert re.fullmatch(r"\d{4}-\d{2}-\d{2}", str(told["day"])), (work, method)
            module = str(told["command"]).split()[2]
            assert str(told["command"]).startswith("python -m benchmarks.")
            assert (ROOT / f"{module.replace('.', '/')}.py").is_file(), (work, method)


def test_what_the_page_says_of_peers_is_so_in_the_record() -> None:
    calm, gusts, _ = peers.JOBS
    size = partial(peers.size_of, RECORD)
    ours = {calm: "rotorid, then output error", gusts: "rotorid, then prediction error"}
    for work, mine in ours.items():
        others = [method for method in RECORD[work] if not method.startswith("rotorid")]
        assert size(work, mine) < min(size(work, one) for one in others), "it is bold in docs/accuracy.md"
    assert size(gusts, accuracy.TUNED) > size(gusts, "SIPPY CVA"), "the page says that it is worse"
    farther = size(gusts, accuracy.DIRECT) / size(gusts, ours[gusts])
    assert round(farther) == count("docs/peers.md", "{n} times as far in gusts as ours")
    assert all(size(work, "rotorid, response alone") < size(work, accuracy.DIRECT) for work in (calm, gusts))


def test_speed_beside_peers_is_that_of_the_table_of_accuracy() -> None:
    told = page("docs/accuracy.md").partition("## Speed")[2]
    for work, method in (
        ("spectra", "rotorid"),
        ("spectra", "scipy"),
        ("DataFlash", "rotorid"),
        ("DataFlash", "pymavlink"),
    ):
        assert f"{RECORD[work][method]['seconds']} s" in told
    assert f"| {RECORD['frequency fit']['python-control']['times']}, **misses its bar of 40**" in told


def test_gains_beside_rules_are_those_of_the_study() -> None:
    told = page("docs/tuning-study.md")
    named = {"rotorid": "rotorid tune", "SIMC": "SIMC, λ 1", "Quicktune": "ArduPilot Quicktune"}
    for method, one in RECORD["gains, roll"].items():
        row = re.search(rf"\| {named.get(method, method)}, roll \|([^|]*\|){{5}}", told)
        assert row is not None, method
        _, unstable, peaks, _, stiffness, _ = [cell.strip() for cell in row[0].split("|")][2:]
        assert (float(unstable), float(stiffness)) == (one["unstable"], one["stiffness"])
        assert [float(peak) for peak in peaks.split("/")[1:]] == [one["M_s_50"], one["M_s_90"]]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["rotorid, response alone", "rotorid, then output error", accuracy.DIRECT])
def test_the_record_is_what_is_measured(method: str) -> None:
    calm, job = peers.JOBS[0], accuracy.jobs()[0]
    flights = [job.fly(seed) for seed in range(accuracy.SEEDS)]
    if method in job.ours:
        truth = job.truth.response(accuracy.OMEGA_RAD_S)
        found = accuracy.errors([job.ours[method](flown) for flown in flights], truth)
    else:
        direct = accuracy.direct_peer(job, accuracy.SECOND_ORDER)
        found = accuracy.best_tuned(direct, [flown.record for flown in flights], accuracy.held(job.truth))
    # Other processors round otherwise, and an optimizer stops a little elsewhere.
    assert found.size == pytest.approx(peers.size_of(RECORD, calm, method), rel=1e-2)
