"""Every part of a review fails alone: its reason stands in its place, and all other parts are as they were."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

import rotorid
from rotorid.documents.base import to_json
from rotorid.documents.review import review_document
from rotorid.errors import STRICT, InsufficientDataError, ModelError, UsageError
from rotorid.flying.simulation import everyday_plan
from rotorid.report.review import render_reviews
from rotorid.reviewing import assembly, flight, loops, margins, motors, noise
from rotorid.reviewing import tracking as following
from rotorid.reviewing.cards import cards
from rotorid.reviewing.values import Review
from rotorid.vehicles.catalog import aircraft

WHY = "A reason of its own"
ERRORS: dict[str, Callable[[], Exception]] = {
    "insufficient": lambda: InsufficientDataError(WHY, remedy="log more"),
    "usage": lambda: UsageError(WHY, remedy="name it with --layout"),
    "model": lambda: ModelError(WHY),
    "value": lambda: ValueError(WHY),
    "linalg": lambda: np.linalg.LinAlgError(WHY),
}
MAKERS = {
    ("flight", assembly, "flight"): "flight",
    ("logging", assembly, "logging"): "logging",
    ("oscillations", assembly, "check_oscillations"): "oscillations",
    ("loops", assembly, "loops"): "loops",
    ("loops.p", loops, "_measure_loop"): "loops",
    ("margins", assembly, "margins"): "margins",
    ("margins.roll", margins, "rate_loop"): "margins",
    ("noise", assembly, "noise"): "noise",
    ("noise.vibration", noise, "_vibration"): "noise",
    ("noise.maps", noise, "_spectra"): "noise",
    ("motors", assembly, "motors"): "motors",
    ("tracking", assembly, "tracking"): "tracking",
    ("tracking.phi", following, "_tracked"): "tracking",
    ("channels", assembly, "channel_agreement"): "findings",
    ("control", assembly, "control_of"): "control",
    ("motors.events", motors, "_events"): "motors",
    ("motors.output_delay_s", motors, "_delay"): "motors",
    ("motors.thrust_coefficient", motors, "weight_balance"): "motors",
    ("flight.battery", flight, "_battery"): "flight",
    ("flight.thrust_to_weight", flight, "_thrust"): "flight",
    ("flight.drag", flight, "tilt_drag"): "flight",
    ("vehicle", assembly, "vehicle"): "vehicle",
    ("next_commands", assembly, "next_commands"): "next_commands",
}
"""Part by its name, with what makes it, to the field of the review that may change."""

DEPENDS = {
    "loops": {"noise", "next_commands"},
    "margins": {"filters"},
    "oscillations": {"calm", "next_commands"},
    "vehicle": {"next_commands"},
    "flight": {"next_commands", "drag", "wind"},
}
"""Fields that follow from another one."""

SLOW = ("loops", "margins", "filters", "noise", "motors")
"""Parts that are made once: they follow from the log alone, or from numbers that no error changes."""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> rotorid.FlightRecord:
    plan = everyday_plan(aircraft("px4_quad"), duration_s=30.0, level=0.5, seed=3)
    path = tmp_path_factory.mktemp("log") / "a.ulg"
    rotorid.write_log(path, rotorid.simulate("px4_quad", plan, seed=3), format="ulg")
    return rotorid.read(path)


@pytest.fixture(scope="module")
def known() -> dict[str, object]:
    """The slow parts, as the whole review made them."""
    return {}


@pytest.fixture(scope="module", autouse=True)
def whole(log: rotorid.FlightRecord, known: dict[str, object]) -> Review:
    with pytest.MonkeyPatch.context() as patch:
        for name in SLOW:
            patch.setattr(assembly, name, _kept(name, known))
        review = rotorid.review(log, models=False)
    assert known.keys() == set(SLOW)
    return review


@pytest.fixture
def tolerant(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(STRICT, raising=False)


@pytest.mark.parametrize(
    ("maker", "kind"),
    # All parts go through one door, which is tried with every error; each part is, with one of each sort.
    [(maker, kind) for maker in MAKERS for kind in (ERRORS if maker[0] == "noise" else ("usage", "value"))],
    ids=lambda value: value if isinstance(value, str) else value[0],
)
def test_a_part_that_fails_leaves_all_others_as_they_were(
    maker: tuple[str, ModuleType, str],
    kind: str,
    log: rotorid.FlightRecord,
    whole: Review,
    known: dict[str, object],
    tolerant: None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    part, module, name = maker
    failing = part.partition(".")[0]
    # Filters follow from margins, and from nothing else that may fail.
    made_anew = {"margins", "filters"} if failing == "margins" else {failing}
    for slow, made in known.items():
        if slow not in made_anew:
            monkeypatch.setattr(assembly, slow, _giving(made))
    monkeypatch.setattr(module, name, _raising(ERRORS[kind]))
    broken = rotorid.review(log, models=False)
    field = MAKERS[maker]
    allowed = {field, "cannot_tell", "findings", *DEPENDS.get(field, ())}
    before, after = (review_document(review).model_dump(mode="json", by_alias=True) for review in (whole, broken))
    changed = {key for key in before if before[key] != after[key]}
    assert changed - {"cards"} <= allowed, changed
    reasons = [gap for gap in broken.cannot_tell if WHY in gap.why]
    assert any(gap.what == part or gap.what.startswith(f"{part.partition('.')[0]}.") for gap in reasons)
    assert broken.flight.flights == whole.flight.flights
    # "To do:" and "; " go before a remedy.
    assert not [gap.remedy for gap in whole.cannot_tell if gap.remedy.endswith(".") or gap.remedy[:2].istitle()]
    faulty = kind in ("value", "linalg")
    assert faulty == any(finding.kind == "internal_error" for finding in broken.findings)
    assert all("--layout" not in gap.remedy or "rotorid identify" in gap.remedy for gap in reasons)
    assert WHY in to_json(review_document(broken))
    if kind == "usage":
        assert WHY in render_reviews([broken])


@pytest.mark.parametrize(
    ("module", "name", "key"),
    [
        (assembly, "loops", "tracking"),
        (assembly, "margins", "margins"),
        (assembly, "noise", "noise"),
        (assembly, "motors", "motors"),
    ],
)
def test_the_card_of_a_part_that_failed_says_why(
    module: ModuleType,
    name: str,
    key: str,
    log: rotorid.FlightRecord,
    known: dict[str, object],
    tolerant: None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for slow, made in known.items():
        if (name, slow) != ("margins", "filters"):
            monkeypatch.setattr(assembly, slow, _giving(made))
    monkeypatch.setattr(module, name, _raising(ERRORS["usage"]))
    found = {card.key: card for card in cards(rotorid.review(log, models=False))}
    assert found[key].state == "cannot"
    assert found[key].headline == f"{WHY}."


def test_a_test_sees_a_fault(
    log: rotorid.FlightRecord, known: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    for slow, made in known.items():
        monkeypatch.setattr(assembly, slow, _giving(made))
    monkeypatch.setattr(assembly, "noise", _raising(ERRORS["value"]))
    with pytest.raises(ValueError, match=WHY):
        rotorid.review(log, models=False)


def test_a_picture_that_cannot_be_drawn_leaves_the_page(
    whole: Review, tolerant: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rotorid.report.review.spectra", _raising(ERRORS["value"]))
    page = render_reviews([whole])
    assert WHY in page
    assert "-step-rates" in page


def _kept(name: str, known: dict[str, object]) -> Callable[..., object]:
    make = getattr(assembly, name)

    def makes(*arguments: object, **options: object) -> object:
        known[name] = make(*arguments, **options)
        return known[name]

    return makes


def _giving(made: object) -> Callable[..., object]:
    return lambda *_, **__: made


def _raising(make: Callable[[], Exception]) -> Callable[..., object]:
    def fails(*_: object, **__: object) -> object:
        raise make()

    return fails
