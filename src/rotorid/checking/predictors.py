"""Which predictor a model has."""

from __future__ import annotations

from rotorid.checking.candidate import Candidate
from rotorid.checking.linear import LinearPredictor
from rotorid.checking.motor_speed import MotorSpeedPredictor
from rotorid.checking.nonlinear import NonlinearPredictor
from rotorid.checking.predictions import Predictor
from rotorid.models.families import family_of


def predictor_of(candidate: Candidate) -> Predictor:
    """How a model predicts flights: by its motors, by its equations, or about a trim."""
    if candidate.flight is not None:
        return candidate.flight
    if candidate.motors is not None:
        return candidate.motors
    if candidate.nonlinear is None:
        return LinearPredictor(candidate)
    if family_of(candidate.nonlinear.name).needs == "motor speeds":
        return MotorSpeedPredictor(candidate.nonlinear)
    return NonlinearPredictor(candidate.nonlinear)
