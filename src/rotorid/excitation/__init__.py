"""Test inputs: what is added to a command so that a flight can answer. Pure functions, no vehicle, no data."""

from rotorid.excitation.doublet import (
    balanced_three_two_one_one,
    doublet,
    multistep,
    three_two_one_one,
    two_one_one,
)
from rotorid.excitation.harmonics import halved, harmonics_in, interleaved, power_law
from rotorid.excitation.multisine import Multisine, multisine
from rotorid.excitation.planned import planned, sequence, together
from rotorid.excitation.random_binary import band_of_rise_time, random_binary, share_of_sign
from rotorid.excitation.spectrum import energy_share, relative_peak_factor
from rotorid.excitation.sweep import logarithmic_sweep, pilot_sweep

__all__ = [
    "Multisine",
    "balanced_three_two_one_one",
    "band_of_rise_time",
    "doublet",
    "energy_share",
    "halved",
    "harmonics_in",
    "interleaved",
    "logarithmic_sweep",
    "multisine",
    "multistep",
    "pilot_sweep",
    "planned",
    "power_law",
    "random_binary",
    "relative_peak_factor",
    "sequence",
    "share_of_sign",
    "three_two_one_one",
    "together",
    "two_one_one",
]
