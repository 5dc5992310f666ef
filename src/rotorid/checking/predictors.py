"""Which predictor a model has."""

from __future__ import annotations

from rotorid.checking.candidate import Candidate
from rotorid.checking.linear import LinearPredictor
from rotorid.checking.nonlinear import NonlinearPredictor
from rotorid.checking.predictions import Predictor


def predictor_of(candidate: Candidate) -> Predictor:
    """How a model predicts flights: by its motors, by its equations, or about a trim."""
    if candidate.motors is not None:
        return candidate.motors
    return NonlinearPredictor(candidate.nonlinear) if candidate.nonlinear is not None else LinearPredictor(candidate)
