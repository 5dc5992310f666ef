"""Hundreds of truncations and flipped bits of every format: one bar for all, and what each can know of its damage."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from tests.hostile.damage import Campaign, Tally, run
from tests.hostile.samples import SAMPLES

from rotorid.errors import LogError
from rotorid.io import read

QUICK = Campaign(truncations=40, flips=90)
THOROUGH = Campaign(truncations=2000, flips=6000, seed=1)

CUT_BETWEEN: Mapping[str, float] = {
    # A cut between two messages, lines or keys leaves a whole file; the share of such places is one per message length.
    "ULog": 0.95,
    "DataFlash": 0.95,
    "tlog": 0.95,
    "ulog2csv": 0.9,
    "mapping": 0.95,
    # A number that is cut in its digits is a number, and a last line needs no end.
    "CSV": 0.5,
}
"""Least share of truncations that are said, where it is not all of them."""

CHECKED: Mapping[str, float] = dict.fromkeys(("Crazyflie", "NPZ", "NPZ compressed", "gzip", "xz", "bzip2", "zip"), 1.0)
"""Formats with a checksum over everything that matters: every flipped bit that changes a sample is said."""

CRASHING = frozenset({"MAT v5", "HDF5", "Parquet"})
"""Formats whose parsers are foreign machine code: they may take the sandbox's child with them."""


def judged(name: str, campaign: Campaign, folder: Path) -> Tally:
    """The tally, once it was found to hold nothing that must never be."""
    tally = run(SAMPLES[name](), campaign, folder, seconds=3600.0)
    assert not tally.faults, f"{len(tally.faults)} faults, such as {tally.faults[0]}"
    assert not tally.crashes or name in CRASHING
    assert tally.truncations.total() == campaign.truncations
    assert tally.flips.total() == min(campaign.flips, 8 * len(SAMPLES[name]().content))
    return tally


@pytest.mark.parametrize("campaign", [QUICK, pytest.param(THOROUGH, marks=pytest.mark.slow)], ids=["quick", "thorough"])
@pytest.mark.parametrize("name", SAMPLES)
def test_damage_is_a_sound_record_or_one_sentence_and_is_said(name: str, campaign: Campaign, tmp_path: Path) -> None:
    tally = judged(name, campaign, tmp_path)
    assert tally.said("truncations") >= CUT_BETWEEN.get(name, 1.0)
    assert tally.said("flips") >= CHECKED.get(name, 0.0)
    # Without any notice of flipped bits a reader would look at nothing but values.
    assert tally.flips["said"] + tally.flips["refused"] + tally.flips["crash"] > 0


def test_truncations_of_a_real_px4_log_are_said(unpacked: Callable[[str], Path]) -> None:
    """The bar is 95 of 100; a cut that is not seen is one that falls between two messages."""
    from rotorid.io.px4.ulog import walk

    whole = unpacked("px4/sample_log_small.ulg").read_bytes()
    cuts = list(Campaign(truncations=200, flips=0).variants(whole))[1:]
    said = sum(len(cut) < 17 or bool(walk(cut).damage) for cut in cuts)
    assert said >= 0.95 * len(cuts)


@pytest.mark.slow
def test_a_parser_that_crashes_is_one_sentence_of_its_parent(tmp_path: Path) -> None:
    """The first flip on which the MAT parser takes its process with it, given to the real sandbox."""
    sample = SAMPLES["MAT v5"]()
    campaign = Campaign(truncations=0, flips=505)
    crashes = run(sample, campaign, tmp_path, seconds=600.0).crashes
    if not crashes:
        pytest.skip("this version of SciPy survived all of the flipped bits")
    variants = list(campaign.variants(sample.content))
    # What wild memory holds decides whether one process crashes on it or another one refuses it.
    said = []
    for crash in crashes[:8]:
        (tmp_path / "flight.mat").write_bytes(variants[crash])
        with pytest.raises(LogError, match=r"flight\.mat cannot be read: the parser") as caught:
            read(tmp_path / "flight.mat")
        assert caught.value.needed
        assert caught.value.remedy
        said.append(str(caught.value))
    if not any("the parser crashed on it" in sentence for sentence in said):
        pytest.skip("in the sandbox, this version of SciPy refused what it had crashed on before")
