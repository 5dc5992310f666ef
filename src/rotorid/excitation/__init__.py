"""Test inputs: what is added to a command so that a flight can answer. Pure functions, no vehicle, no data."""

from rotorid.excitation.multisines import (
    Multisine,
    energy_share,
    halved,
    harmonics_in,
    interleaved,
    multisine,
    power_law,
    relative_peak_factor,
)
from rotorid.excitation.plan import planned, sequence, together
from rotorid.excitation.sweep import logarithmic_sweep, pilot_sweep
from rotorid.excitation.switching import (
    balanced_three_two_one_one,
    band_of_rise_time,
    doublet,
    multistep,
    random_binary,
    share_of_sign,
    three_two_one_one,
    two_one_one,
)

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
