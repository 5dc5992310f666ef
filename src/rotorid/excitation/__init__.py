"""Test inputs: what is added to a command so that a flight can answer. Pure functions, no vehicle, no data."""

from rotorid.excitation.doublet import doublet, multistep, three_two_one_one
from rotorid.excitation.sweep import logarithmic_sweep, pilot_sweep

__all__ = ["doublet", "logarithmic_sweep", "multistep", "pilot_sweep", "three_two_one_one"]
