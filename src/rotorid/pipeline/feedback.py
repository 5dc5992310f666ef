"""Remarks on feedback in the input."""

from __future__ import annotations

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.response import FrequencyResponse
from rotorid.pipeline.measure import Measured
from rotorid.typing import BoolArray

_BIAS_LIMIT_DB = 1.0


def feedback_bias(measured: Measured, used: BoolArray) -> tuple[Finding, ...]:
    """How far direct estimates lie from the joint ones where those were used.

    One warning for each response that feedback biases seriously; where there is none, one remark on the worst.
    """
    if measured.beside is None or not used.any():
        return ()
    pairs = np.argwhere(used.any(axis=-1))
    judged = [_judged(measured.response, measured.beside, used, int(y), int(u)) for y, u in pairs]
    serious = tuple(finding for finding in judged if finding.severity == "warning")
    return serious or (max(judged, key=lambda finding: finding.numbers["rms_db"]),)


def _judged(response: FrequencyResponse, beside: FrequencyResponse, used: BoolArray, y: int, u: int) -> Finding:
    points = used[y, u]
    decibel = 20.0 * np.log10(np.abs(beside.values[y, u, points] / response.values[y, u, points]))
    worst = float(decibel[np.argmax(np.abs(decibel))])
    typical = float(np.sqrt(np.mean(decibel**2)))
    serious = typical > _BIAS_LIMIT_DB
    return Finding(
        kind="closed_loop_bias",
        severity="warning" if serious else "info",
        where=f"{response.outputs[y]}/{response.inputs[u]}",
        message=(
            f"The joint estimate with {', '.join(response.instruments)} was used. A direct estimate would differ by "
            f"{typical:.1f} dB rms and {worst:+.1f} dB at most in the used band"
            + (
                ": feedback biases it, unless the instrument contains feedback itself."
                if serious
                else ", so feedback hardly biases this flight."
            )
        ),
        numbers={"largest_db": worst, "rms_db": typical},
    )
