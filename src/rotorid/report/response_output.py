"""Write what a run of ``response`` answers: all files complete, or none."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rotorid.io.store import write_atomically, write_npz
from rotorid.pipeline.response import Responses
from rotorid.report.output import measured_arrays, to_json, write_together
from rotorid.report.response_page import render_responses


def write_responses(folder: Path, result: Responses, *, title: str) -> None:
    """Write ``response.json``, ``responses.npz`` and ``report.html``, all or none.

    Parameters
    ----------
    folder
        Where they go; it is made when missing. Files of the same names are replaced.
    result
        What to write.
    title
        Heading of the report.
    """
    write_together(
        folder,
        {
            "response.json": lambda path: write_atomically(path, to_json(result.document)),
            "responses.npz": lambda path: write_npz(path, arrays(result)),
            "report.html": lambda path: write_atomically(path, render_responses(result, title=title)),
        },
    )


def arrays(result: Responses) -> dict[str, np.ndarray]:
    """Arrays of ``responses.npz``; no pickles, names as plain text."""
    diagnostics = result.measured.diagnostics
    found = measured_arrays(result.response, result.measured.beside) | {
        "used": result.used,
        "window_share": diagnostics.share,
        "window_error": diagnostics.window_error,
        "multiple_coherence": diagnostics.multiple_coherence,
        "leakage": diagnostics.leakage,
        "input_coherence": diagnostics.input_coherence,
        "condition": diagnostics.condition,
    }
    for axis, loop in result.loops.items():
        if loop.loop is not None:
            found |= {
                f"{axis}_loop_omega_rad_s": loop.loop.omega_rad_s,
                f"{axis}_loop_values": loop.loop.values[0, 0],
                f"{axis}_loop_random_error": loop.loop.random_error[0, 0],
            }
    return found
