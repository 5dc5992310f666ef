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
BAND = "rgba(43, 127, 192, 0.22)"
SHADE = "rgba(213, 94, 0, 0.10)"

FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"


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
