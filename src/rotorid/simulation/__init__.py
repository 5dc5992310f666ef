"""Time responses: a linear model on given inputs, and a hover flight in closed loop."""

from rotorid.simulation.hover_flight import (
    SILENT,
    Excitation,
    Flight,
    HoverController,
    HoverVehicle,
    SensorNoise,
    fly,
    gauss_markov,
)
from rotorid.simulation.linear import simulate_linear

__all__ = [
    "SILENT",
    "Excitation",
    "Flight",
    "HoverController",
    "HoverVehicle",
    "SensorNoise",
    "fly",
    "gauss_markov",
    "simulate_linear",
]
