"""How a fit in time went, in words."""

from __future__ import annotations

from rotorid.pipeline.document import FitDocument, ResultDocument
from rotorid.report.motor_words import method_sentences
from rotorid.report.numbers import significant

_METHODS = {
    "output_error": "Output error: the model was simulated from the inputs alone, and what is left of the outputs was "
    "minimized, weighed by the covariance that it has.",
    "prediction_error": "Prediction error: the model predicted every sample from those before it, with a noise model "
    "that was fitted too, so that feedback biases nothing.",
    "equation_error": "Equation error: the equations of motion were fitted to measured accelerations and states. Noise "
    "in the states biases that.",
}
_HOLDS = {
    "zero": "Inputs were held between their samples, as the commands were sent.",
    "first": "Inputs were joined by straight lines between their samples.",
}


def time_sentences(document: ResultDocument, fit: FitDocument) -> tuple[str, ...]:
    """The method, what inputs did between samples, how the solver ended, and the color of the residuals."""
    outcome = fit.outcome.rstrip(".")
    count = "1 evaluation" if fit.evaluations == 1 else f"{fit.evaluations} evaluations"
    if document.motors is not None:
        last = f"The last search ended after {count}: {outcome[:1].lower()}{outcome[1:]}."
        return (*method_sentences(document), last)
    sentences = [_METHODS.get(document.method, "")]
    if document.hold:
        sentences.append(_HOLDS[document.hold])
    if document.pieces_s is not None:
        sentences.append(f"The simulation began anew every {significant(document.pieces_s)} s.")
    sentences.append(f"The solver ended after {count}: {outcome[:1].lower()}{outcome[1:]}.")
    if document.residuals and document.residuals.memory:
        sentences.append(
            f"Residuals remember some {document.residuals.memory} samples; for that standard deviations are "
            f"{significant(document.residuals.inflation, digits=2)} times those of white residuals."
        )
    return tuple(sentences)
