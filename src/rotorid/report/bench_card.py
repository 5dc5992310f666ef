"""The card of a plan for a rig: one page at the bench. What moves, how far, when to stop."""

from __future__ import annotations

import math

from rotorid import __version__
from rotorid.data.display import listed
from rotorid.data.quantity import significant, with_error
from rotorid.flying.bench_designs import ANGLES, BenchDesign
from rotorid.report.frame import CARD_POLICY, asset

FILE = "bench-card.html"


def bench_card(design: BenchDesign) -> dict[str, str]:
    """The card as one self-contained HTML file, by its name.

    Parameters
    ----------
    design
        The plan, its limit and what it measures.
    """
    import jinja2
    from markupsafe import Markup

    from rotorid.report.flight_card import band_words, input_picture

    settings, plan = design.settings, design.plan
    log = listed(["time", *(part.motor for part in plan.inputs), *(ANGLES[axis] for axis in settings.axes)])
    sweeps = [
        {
            "motor": part.motor,
            "axis": part.axis,
            "size": f"± {significant(part.amplitude)} {'of full output' if part.unit == '1' else part.unit}",
            "band": band_words(part),
            "begin": f"{part.start_s:.0f}",
            "length": f"{part.stop_s - part.start_s:.0f}",
            "picture": input_picture([[part]], (part.start_s, part.stop_s), description=f"sweep of {part.motor}"),
        }
        for part in plan.inputs
    ]
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    page = environment.from_string(asset("templates/bench_card.html")).render(
        policy=CARD_POLICY,
        style=Markup(asset("flight_card.css")),
        version=__version__,
        name=plan.name,
        source=settings.source,
        duration=f"{plan.duration_s:.0f}",
        limit=f"{math.degrees(settings.limit_rad):.0f}°",
        reached=f"{math.degrees(design.reached_rad):.1f}°",
        sweeps=sweeps,
        before=[
            "Pivot free of friction; propellers undamaged; nobody in their plane",
            "Way to cut the motors tried",
            "Controller keeps the rig level; add each column of plan.csv behind it",
            f"Log at 100 Hz: {log}, and the columns of plan.csv as {plan.inputs[0].signal} and so on",
        ],
        model=design.model,
        bounds=[
            {"name": name, "value": with_error(one.value, one.std), "unit": one.unit}
            for name, one in design.expected.items()
        ],
    )
    return {FILE: page}
