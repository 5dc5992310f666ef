"""Flights as cards ask for them, with a pilot in wind and lost records: gains within their intervals, and by what."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import pytest
from tests.twins.card_flights import BAND_RAD_S, GAIN, SETPOINT, SWEPT, Card, cards, fly, record_of, truth

import rotorid
from rotorid.errors import InsufficientDataError
from rotorid.signal.excitations import rich_excitations
from rotorid.typing import Axis


class Estimated(NamedTuple):
    """A gain of a flight over its truth, in deviations, and what it was measured with; without a number a refusal."""

    card: Card
    axis: Axis
    deviations: float | None
    std_percent: float
    instrument: str
    band_rad_s: tuple[float, float]

    @property
    def within(self) -> bool:
        return self.deviations is not None and abs(self.deviations) <= 2.0

    @property
    def faulty(self) -> str:
        """What is wrong with the instrument: another than that of the sweep, or one outside of its band."""
        if self.deviations is None:
            return ""
        wanted = f"{self.axis}_excitation" if self.card.declared else SETPOINT[self.axis]
        if self.instrument != wanted:
            return f"{self.instrument} instead of {wanted}"
        # A sweep that is found by its half periods is known to a tenth of its end.
        low, high = 0.5 * BAND_RAD_S[0], 1.1 * BAND_RAD_S[1]
        return "" if low <= self.band_rad_s[0] and self.band_rad_s[1] <= high else f"used over {self.band_rad_s}"


def estimated(card: Card) -> list[Estimated]:
    log, known = record_of(card, fly(card)), truth(card)
    found = []
    for axis in SWEPT:
        try:
            model = rotorid.identify(log, f"rate.{axis}")
        except InsufficientDataError:
            found.append(Estimated(card, axis, None, 0.0, "", (0.0, 0.0)))
            continue
        gain = model.parameters[GAIN[axis]]
        assert gain.std is not None
        assert model.band_rad_s is not None
        off = (gain.value - known[axis]) / gain.std
        percent = 100.0 * gain.std / abs(gain.value)
        (instrument,) = model.provenance.instruments
        found.append(Estimated(card, axis, off, percent, instrument, model.band_rad_s))
    return found


@pytest.mark.parametrize("number", [2, 11])
def test_two_cards_give_their_gains(number: int) -> None:
    """One that declares its sweeps, and one whose program sends them as set-points of the attitude."""
    card = list(cards())[number]
    log = record_of(card, fly(card))
    for axis in SWEPT:
        (sweep,) = rich_excitations(log, axis)
        assert sweep.signal == (f"{axis}_excitation" if card.declared else SETPOINT[axis])
    for one in estimated(card):
        assert one.within, one
        assert one.faulty == ""
        assert one.std_percent < 4.0


@pytest.mark.slow
def test_gains_of_forty_cards_lie_within_their_intervals() -> None:
    found = [one for card in cards() for one in estimated(card)]
    told = [one for one in found if one.deviations is not None]
    for vehicle in dict.fromkeys(one.card.vehicle for one in found):
        own = [one for one in found if one.card.vehicle == vehicle]
        shares = sorted(one.std_percent for one in own if one.deviations is not None)
        print(vehicle, Counter(one.within for one in own), f"std {shares[len(shares) // 2]:.2f} %, {shares[-1]:.1f} %")
        print([round(one.deviations or 0.0, 2) for one in own])
    assert [one.faulty for one in told if one.faulty] == []
    # Refusals count as misses.
    assert sum(one.within for one in found) >= 0.93 * len(found)
