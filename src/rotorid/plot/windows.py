"""Which window of a composite carries which frequency."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.errors import UsageError
from rotorid.plot.curves import Style, line
from rotorid.plot.figure import Figure, Trace
from rotorid.plot.stack import Panel, stacked
from rotorid.plot.theme import BESIDE, DASHES, SERIES, translucent
from rotorid.plot.view import Frequency, View
from rotorid.typing import FloatArray

_AREA_OPACITY = 0.55
_LOG_AXIS = {"type": "log", "dtick": "D2", "exponentformat": "none", "tickformat": "~r"}


def window_contributions(
    omega_rad_s: FloatArray,
    windows_s: Sequence[float],
    share: FloatArray,
    errors: FloatArray,
    *,
    composite_error: FloatArray | None = None,
    frequency: Frequency = "rad/s",
) -> Figure:
    r"""Share of each window length in a composite response, beside the random error of each window alone.

    Where the windows are combined with weights :math:`W_i`, the share is :math:`W_i^2 / \sum_j W_j^2`
    (``rotorid.spectral.composite.window_weights``). Windows of one record share its data: the error of the composite
    lies below the best single window by less than independent windows would bring.

    Parameters
    ----------
    omega_rad_s
        Positive frequencies, rising, shape ``(f,)``.
    windows_s
        Window lengths.
    share
        Shape ``(windows, f)``, from 0 to 1, drawn stacked in percent; frequencies that no window carries are left
        out.
    errors
        Relative standard deviation of the magnitude of each window alone, same shape; not finite where a window does
        not count.
    composite_error
        That of the composite, shape ``(f,)``.
    frequency
        Unit of the picture.

    Raises
    ------
    UsageError
        A shape does not fit, a share is negative, or the unit is unknown.

    Examples
    --------
    >>> share = np.array([[0.8, 0.0], [0.2, 1.0]])
    >>> figure = window_contributions(np.array([1.0, 10.0]), [20.0, 5.0], share, np.full((2, 2), 0.1))
    >>> [(trace["name"], trace["y"]) for trace in figure["data"][:2]]
    [('20 s', [80.0, 0.0]), ('5 s', [20.0, 100.0])]
    """
    view = View(frequency=frequency)
    _require(len(windows_s), omega_rad_s, share, errors, composite_error)
    names = [f"{window:.4g} s" for window in windows_s]
    carried = np.isfinite(share).all(axis=0) & (share.sum(axis=0) > 0.0)
    areas = [
        _area(view, omega_rad_s[carried], row[carried], name, SERIES[number % len(SERIES)])
        for number, (name, row) in enumerate(zip(names, share, strict=True))
    ]
    single = [
        line(
            view,
            omega_rad_s,
            _positive(row),
            Style(name=name, color=SERIES[number % len(SERIES)], dash=DASHES[number % len(DASHES)]),
        )
        for number, (name, row) in enumerate(zip(names, errors, strict=True))
    ]
    if composite_error is not None:
        style = Style(name="composite", color=BESIDE, width=3.5, legend=True)
        # Below the single windows, so that the one that carries it stays in sight.
        single.insert(0, line(view, omega_rad_s, _positive(composite_error), style))
    panels = (
        Panel(label="Share in the composite [%]", traces=areas, height_px=170, axis={"range": [0, 100], "dtick": 25}),
        Panel(label="Random error of each window alone", traces=single, height_px=190, axis=_LOG_AXIS),
    )
    return stacked(panels, x_axis=view.axis(omega_rad_s))


def _require(
    windows: int, omega_rad_s: FloatArray, share: FloatArray, errors: FloatArray, composite_error: FloatArray | None
) -> None:
    shape = (windows, omega_rad_s.size)
    for name, came, needed in (
        ("share", share.shape, shape),
        ("errors", errors.shape, shape),
        ("composite_error", shape[1:] if composite_error is None else composite_error.shape, shape[1:]),
    ):
        if came != needed:
            raise UsageError(f"{name} came with the shape {came}", needed=f"the shape {needed}")
    if np.nanmin(share, initial=0.0) < 0.0:
        raise UsageError("a negative share of a window came", needed="shares from 0 to 1")


def _positive(values: FloatArray) -> FloatArray:
    return np.where(values > 0.0, values, np.nan)


def _area(view: View, omega_rad_s: FloatArray, share: FloatArray, name: str, color: str) -> Trace:
    drawn = line(view, omega_rad_s, 100.0 * share, Style(name=name, color=color, width=0.8, legend=True, unit="%"))
    return {**drawn, "stackgroup": "share", "fillcolor": translucent(color, _AREA_OPACITY)}
