"""Colors and lines of all pictures.

The trace colors follow Okabe and Ito (*Color Universal Design*, 2008), shifted until each has a contrast of at least
3 : 1 on white and on near-black, so that one figure serves light and dark pages; only the template changes.
"""

from __future__ import annotations

from typing import Any

MEASURED = "#2b7fc0"
MODEL = "#d55e00"
INPUT = "#0b8f6d"
BESIDE = "#8a8f98"
SHADE = "rgba(213, 94, 0, 0.10)"

SERIES = (MEASURED, MODEL, INPUT, "#bf3993", "#8c624d", "#8149f2")
"""Colors of curves of equal rank, apart even for eyes that lack a kind of cone; dashes and symbols differ too."""

DASHES = ("solid", "7 3", "2 2", "9 3 2 3", "4 2", "12 3")
SYMBOLS = ("circle", "diamond", "square", "triangle-up", "x", "cross")

FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"


def translucent(color: str, opacity: float) -> str:
    """A color of this theme with an opacity, for bands and areas.

    Examples
    --------
    >>> translucent("#2b7fc0", 0.2)
    'rgba(43, 127, 192, 0.2)'
    """
    red, green, blue = (int(color[at : at + 2], 16) for at in (1, 3, 5))
    return f"rgba({red}, {green}, {blue}, {opacity:g})"


def template(*, dark: bool = False) -> dict[str, Any]:
    """The plotly template of light or dark pages; backgrounds are transparent, the page paints them."""
    ink, quiet, grid, panel = (
        ("#d7dae0", "#a3a9b4", "#2a2f37", "#20242b") if dark else ("#24292f", "#59616b", "#e4e7eb", "#ffffff")
    )
    axis = {
        "gridcolor": grid,
        "linecolor": grid,
        "zerolinecolor": grid,
        "zerolinewidth": 1,
        "tickcolor": grid,
        "tickfont": {"color": quiet, "size": 11},
        "title": {"font": {"color": quiet, "size": 12}},
        "automargin": True,
    }
    return {
        "layout": {
            "font": {"family": FONT, "color": ink, "size": 12},
            "paper_bgcolor": "rgba(0,0,0,0)",
            "plot_bgcolor": "rgba(0,0,0,0)",
            "colorway": [MEASURED, MODEL, INPUT, BESIDE],
            "xaxis": axis,
            "yaxis": axis,
            "hoverlabel": {"bgcolor": panel, "bordercolor": grid, "font": {"family": FONT, "color": ink, "size": 12}},
            "modebar": {"color": quiet, "activecolor": ink, "bgcolor": "rgba(0,0,0,0)"},
            "legend": {"bgcolor": "rgba(0,0,0,0)"},
        }
    }
