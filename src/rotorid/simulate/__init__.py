"""Time responses: a linear model on given inputs, and a hover flight in closed loop."""

from rotorid.simulate.controller import HoverController
from rotorid.simulate.flight import SILENT, Excitation, Flight, SensorNoise, fly
from rotorid.simulate.linear import simulate_linear
from rotorid.simulate.turbulence import gauss_markov
from rotorid.simulate.vehicle import HoverVehicle

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
