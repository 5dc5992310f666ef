"""Remarks on what else moved: feedback in the input, and commands of other axes."""

from __future__ import annotations

import numpy as np

from rotorid.data.findings import Finding
from rotorid.pipeline.measure import Measured
from rotorid.typing import BoolArray

_BIAS_LIMIT_DB = 1.0
_CORRELATION_LIMIT = 0.5


def feedback_bias(measured: Measured, used: BoolArray) -> tuple[Finding, ...]:
    """How far the direct estimate lies from the joint one where the joint one was used."""
    if measured.beside is None or not used.any():
        return ()
    ratio = np.abs(measured.beside.values[used] / measured.response.values[used])
    decibel = 20.0 * np.log10(ratio)
    worst = float(decibel[np.argmax(np.abs(decibel))])
    instruments = ", ".join(measured.response.instruments)
    typical = float(np.sqrt(np.mean(decibel**2)))
    serious = typical > _BIAS_LIMIT_DB
    return (
        Finding(
            kind="closed_loop_bias",
            severity="warning" if serious else "info",
            where=f"{measured.response.outputs[0]}/{measured.response.inputs[0]}",
            message=(
                f"The joint estimate with {instruments} was used. A direct estimate would differ by {typical:.1f} dB "
                f"rms and {worst:+.1f} dB at most in the fitted band"
                + (": feedback biases it." if serious else ", so feedback hardly biases this flight.")
            ),
            numbers={"largest_db": worst, "rms_db": typical},
        ),
    )


def correlated_inputs(measured: Measured, used: BoolArray) -> tuple[Finding, ...]:
    """Commands of other axes that moved along: a model of one input takes their effect for its own."""
    points = used.any(axis=(0, 1))
    findings = []
    for name, coherence in measured.cross_coherence.items():
        mean = float(np.mean(coherence[points])) if points.any() else 0.0
        if mean > _CORRELATION_LIMIT:
            findings.append(
                Finding(
                    kind="correlated_inputs",
                    severity="warning",
                    where=f"{name}, {measured.response.inputs[0]}",
                    message=(
                        f"{name} moved along with the excitation (mean coherence {mean:.2f} in the fitted band). What "
                        f"it does to {', '.join(measured.response.outputs)} is taken for an effect of "
                        f"{', '.join(measured.response.inputs)}."
                    ),
                    numbers={"mean_coherence": mean, "limit": _CORRELATION_LIMIT},
                )
            )
    return tuple(findings)
