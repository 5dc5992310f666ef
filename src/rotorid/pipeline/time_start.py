"""Where a time-domain fit begins: the frequency-domain fit of the same data, and the start values of the structure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.errors import InsufficientDataError, ModelError
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.fitting import Fitted, fit_with_bounds
from rotorid.pipeline.instruments import Flown
from rotorid.pipeline.inverse import pose_screened
from rotorid.pipeline.measure import Measured, measure
from rotorid.pipeline.settings import IdentifySettings
from rotorid.pipeline.time_records import TimeRecords
from rotorid.typing import ComplexArray, FloatArray


class FrequencySide(NamedTuple):
    """What the frequency domain says about the same data.

    Parameters
    ----------
    measured
        Responses, or ``None`` where they could not be estimated.
    fitted
        The fit in the frequency domain, or ``None`` where there is none.
    why_not
        Why there is no fit, in words; empty where there is one.
    """

    measured: Measured | None = None
    fitted: Fitted | None = None
    why_not: str = ""


def frequency_side(
    structure: LinearStructure,
    flown: Sequence[Flown],
    settings: IdentifySettings,
    progress: Callable[[str], None] = lambda _: None,
    *,
    fits: bool = True,
    searches: bool = False,
) -> FrequencySide:
    """Measure responses and fit them, as far as the data support that.

    Parameters
    ----------
    structure, flown, settings, progress
        As for :func:`rotorid.pipeline.identify.identify`.
    fits
        Whether to fit the structure; one without start values of its own cannot be.
    searches
        Whether the search that the settings ask for belongs here, and not to the fit in time.
    """
    measured = None
    try:
        measured = measure(
            flown, inputs=structure.inputs, outputs=structure.outputs, settings=settings, progress=progress
        )
        if not fits:
            return FrequencySide(measured)
        progress(f"fitting {structure.name} in the frequency domain")
        problem = pose_screened(structure, measured, settings, flown).problem
        own = settings if searches else replace(settings, search=None, evaluations=None, starts="default")
        return FrequencySide(measured, fit_with_bounds(problem, measured, own, progress))
    except (InsufficientDataError, ModelError) as error:
        return FrequencySide(measured, None, error.came.rstrip("."))


def held_response(omega_rad_s: FloatArray, records: TimeRecords) -> ComplexArray:
    r"""Response of the hold of the inputs, :math:`(1 - e^{-j \omega T}) / (j \omega T)`, shape ``(f,)``.

    It is one for inputs that were joined by lines. Responses between samples contain it. A simulation with held inputs
    has it apart from the model.
    """
    if records.hold == "first":
        return np.ones(omega_rad_s.size, dtype=np.complex128)
    half = 0.5 * omega_rad_s / records.data[0].sample_rate_hz
    return np.asarray(np.sinc(half / np.pi) * np.exp(-1j * half), dtype=np.complex128)
