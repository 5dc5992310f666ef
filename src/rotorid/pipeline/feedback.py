"""Remarks on feedback in the input."""

from __future__ import annotations

import numpy as np

from rotorid.data.findings import Finding
from rotorid.pipeline.measure import Measured
from rotorid.typing import BoolArray

_BIAS_LIMIT_DB = 1.0


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
