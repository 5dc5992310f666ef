"""Write what an identification answers: all files complete, or none."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.io.store import write_atomically, write_npz
from rotorid.pipeline.document_base import Document
from rotorid.pipeline.identification import Identification
from rotorid.report.page import render_report


def to_json(document: Document) -> str:
    """A document as JSON text, with the names of its schema."""
    return document.model_dump_json(by_alias=True, indent=2) + "\n"


def write_results(
    folder: Path, identification: Identification, *, title: str, truth: Mapping[str, float] | None = None
) -> None:
    """Write ``result.json``, ``responses.npz``, ``model.toml`` and ``report.html``, all or none.

    Parameters
    ----------
    folder
        Where they go; it is made when missing. Files of the same names are replaced.
    identification
        What to write.
    title
        Heading of the report.
    truth
        True values of parameters, where they are known.
    """
    write_together(
        folder,
        {
            "result.json": lambda path: write_atomically(path, to_json(identification.document)),
            "responses.npz": lambda path: write_npz(path, response_arrays(identification)),
            "model.toml": lambda path: write_atomically(path, identification.model_toml),
            "report.html": lambda path: write_atomically(
                path, render_report([identification], title=title, truth=truth)
            ),
        },
    )


def write_together(folder: Path, files: Mapping[str, Callable[[Path], None]]) -> None:
    """Write several files into a folder: all complete, or none.

    The files are made in a temporary folder inside the target and moved there one by one when all of them are complete:
    no file is ever partial, and a run that fails leaves the files of the run before.

    Parameters
    ----------
    folder
        Where they go; it is made when missing. Files of the same names are replaced.
    files
        Name of each file to what writes it.

    Raises
    ------
    UsageError
        The folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        making = Path(tempfile.mkdtemp(prefix=".making-", dir=folder))
    except OSError as error:
        raise UsageError(
            f"{folder} cannot be written: {error.strerror}",
            needed="a folder to write to",
            remedy="choose it with --out",
        ) from error
    try:
        for name, write in files.items():
            write(making / name)
        for file in sorted(making.iterdir()):
            file.replace(folder / file.name)
    finally:
        shutil.rmtree(making)


def write_overview_report(
    path: Path, identifications: Sequence[Identification], *, title: str, truth: Mapping[str, float] | None = None
) -> None:
    """Write one report about several identifications."""
    write_atomically(path, render_report(identifications, title=title, truth=truth))


def response_arrays(identification: Identification) -> dict[str, np.ndarray]:
    """Arrays of ``responses.npz``, without pickles; of a fit in time also its records, as ``record_0_time_s`` ..."""
    arrays = measured_arrays(identification.response, identification.beside)
    for number, one in enumerate(identification.simulated):
        parts = {"time_s": one.time_s, "inputs": one.inputs, "measured": one.measured, "simulated": one.simulated}
        arrays |= {f"record_{number}_{name}": values for name, values in parts.items()}
    return arrays | {"model": identification.model_response, "fitted": identification.fitted}


def measured_arrays(response: FrequencyResponse, beside: FrequencyResponse | None) -> dict[str, np.ndarray]:
    """Arrays of measured responses, and of the direct estimate beside joint ones."""
    arrays = {
        "omega_rad_s": response.omega_rad_s,
        "values": response.values,
        "coherence": response.coherence,
        "random_error": response.random_error,
        "covariance": response.covariance,
        "inputs": np.array(response.inputs),
        "outputs": np.array(response.outputs),
        "instruments": np.array(response.instruments, dtype=np.str_),
        "estimate": np.array(response.estimate),
        "windows_s": np.array(response.windows_s),
        "processing": np.array(response.processing, dtype=np.str_),
    }
    if beside is not None:
        arrays |= {
            "direct_values": beside.values,
            "direct_coherence": beside.coherence,
            "direct_random_error": beside.random_error,
        }
    return arrays
