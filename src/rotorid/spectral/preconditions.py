"""Whether data can support an estimate at all; what is wrong is said with its name before anything is computed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.history import TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.spectral.spectra import SpectralMatrix


def require_finite(records: Sequence[TimeHistory]) -> None:
    """Refuse samples that are not numbers: one of them would spread over every frequency.

    Raises
    ------
    InsufficientDataError
        With the finding ``gap``.
    """
    for record in records:
        for name, samples in zip(record.names, record.values, strict=True):
            missing = int(np.count_nonzero(~np.isfinite(samples)))
            if missing:
                message = f"{name} holds {missing} samples that are not finite numbers."
                raise InsufficientDataError(
                    f"{name} with {missing} samples that are not finite numbers came",
                    needed="a record without gaps",
                    remedy="cut the segment around them",
                    findings=[
                        Finding(kind="gap", severity="error", where=name, message=message, numbers={"samples": missing})
                    ],
                )


def require_motion(records: Sequence[TimeHistory]) -> None:
    """Refuse channels that never change.

    Raises
    ------
    InsufficientDataError
        With the finding ``no_excitation``.
    """
    for row, name in enumerate(records[0].names):
        # The mean of a constant is off by a rounding error, so its spectrum would not be exactly zero.
        if all(record.values.shape[1] == 0 or np.ptp(record.values[row]) == 0.0 for record in records):
            raise InsufficientDataError(
                f"{name} is constant over the whole maneuver",
                needed="a channel that moves",
                remedy="check the wiring of the log and the segment",
                findings=[Finding(kind="no_excitation", severity="error", where=name, message=f"{name} never moves.")],
            )


def require_windows(
    matrices: Sequence[SpectralMatrix], records: Sequence[TimeHistory], windows_s: Sequence[float]
) -> None:
    """Refuse records in which no window that supports the band fits often enough.

    Raises
    ------
    InsufficientDataError
        With the finding ``record_too_short``.
    """
    if matrices:
        return
    longest, shortest = max(record.duration_s for record in records), min(windows_s)
    raise InsufficientDataError(
        f"records of at most {longest:.3g} s came",
        needed=f"two periods of the band inside windows of {shortest:.3g} s and more, and several such windows",
        remedy="give longer segments, shorter windows or a higher band",
        findings=[
            Finding(
                kind="record_too_short",
                severity="error",
                where="record",
                message=f"No window of {shortest:.3g} s and more supports the band on a record of {longest:.3g} s.",
                numbers={"record_s": longest, "window_s": shortest},
            )
        ],
    )
