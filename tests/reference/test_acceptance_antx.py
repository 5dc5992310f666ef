"""What the first release promises on a real rig: a number from the random binary signal, none from the slow sweep."""

from __future__ import annotations

from pathlib import Path

import pytest

import rotorid
from rotorid.documents.result import result_document
from rotorid.errors import InsufficientDataError
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.parsing import parse_segment

BAND = (8.0, 80.0)
PRBS = parse_segment("pitch:50:76")
SWEEP = parse_segment("pitch:132.9:158")


def rig(shared_data: Path, name: str) -> rotorid.FlightRecord:
    return rotorid.read(shared_data / "antx" / name, mapping=shared_data / "antx" / "map.toml")


@pytest.fixture(scope="module")
def prbs(shared_data: Path) -> rotorid.FlightRecord:
    return rig(shared_data, "prbs.mat")


@pytest.fixture(scope="module")
def sweep(shared_data: Path) -> rotorid.FlightRecord:
    return rig(shared_data, "sweep.mat")


@pytest.mark.parametrize(
    "settings",
    [
        IdentifySettings(band_rad_s=BAND, segments=(PRBS,)),
        IdentifySettings(band_rad_s=BAND),
        IdentifySettings(band_rad_s=BAND, estimate="direct"),
    ],
    ids=["segment of the manifest", "found by itself", "direct"],
)
def test_random_binary_signal_gives_gain_and_total_delay(
    settings: IdentifySettings, prbs: rotorid.FlightRecord
) -> None:
    document = result_document(rotorid.identify([prbs], "rate.pitch", settings=settings))
    parameters = document.parameters
    assert parameters["M_pitch"].value == pytest.approx(285.0, rel=0.03)
    assert parameters["tau_pitch"].value + parameters["T_motor"].value == pytest.approx(27.8e-3, abs=1.5e-3)
    assert document.cost is not None
    assert document.cost.average < 10.0


def test_random_binary_signal_is_found_by_itself(prbs: rotorid.FlightRecord) -> None:
    (maneuver,) = rotorid.find_excitations(prbs, "pitch")
    assert maneuver.kind == "random_binary"
    # The signal begins and ends at its resting value, up to one bit of it unseen on either side.
    assert (maneuver.start_s, maneuver.stop_s) == pytest.approx((PRBS.start_s, PRBS.stop_s), abs=1.5)


@pytest.mark.parametrize("segments", [(), (SWEEP,)], ids=["found", "given"])
@pytest.mark.parametrize("band", [None, BAND, (2.0, 60.0)], ids=["no band", "8:80", "2:60"])
def test_slow_sweep_is_refused_whatever_is_asked(
    segments: tuple[rotorid.Maneuver, ...], band: tuple[float, float] | None, sweep: rotorid.FlightRecord
) -> None:
    # The coherence stays high to 60 rad/s, but what is there is noise that the controller turned into a command.
    settings = IdentifySettings(band_rad_s=band, segments=segments)
    with pytest.raises(InsufficientDataError, match="no excitation above 6 rad/s") as refused:
        rotorid.identify([sweep], "rate.pitch", settings=settings)
    assert refused.value.exit_code == 1
    (finding,) = refused.value.findings
    assert (finding.kind, finding.severity) == ("no_excitation", "error")
    # The sweep stops at 6 rad/s; the given segment ends 1.4 s earlier, when it has reached 5.7 rad/s.
    assert 5.6 <= finding.numbers["highest_rad_s"] <= 6.3
