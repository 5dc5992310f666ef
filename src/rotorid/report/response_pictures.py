"""The pictures of a run of ``response``, each in all units."""

from __future__ import annotations

from functools import partial

import numpy as np

from rotorid.pipeline.loops import AxisLoop
from rotorid.pipeline.response import Responses
from rotorid.plot.bands import coherence_map
from rotorid.plot.bode import bode
from rotorid.plot.curves import runs
from rotorid.plot.loops import MINUS_3_DB, Crossing, broken_loop, disturbance_rejection
from rotorid.plot.quantity import quantity
from rotorid.plot.windows import window_contributions
from rotorid.report.picture import Picture, in_all_units, over_frequency
from rotorid.report.timelines import timelines
from rotorid.spectral.log_curve import Estimated
from rotorid.spectral.loop import sensitivity
from rotorid.typing import Axis, FloatArray


def bands_picture(result: Responses) -> Picture:
    """Unbroken usable bands of all responses; where points are missing between two, the bar breaks."""
    response = result.response
    usable = {
        (output, input): [_span(response.omega_rad_s, run) for run in runs(result.used[y, u])]
        for y, output in enumerate(response.outputs)
        for u, input in enumerate(response.inputs)
    }
    return over_frequency(
        partial(coherence_map, usable, asked=result.measured.asked_rad_s),
        key="bands",
        description="Usable bands of all responses over frequency",
    )


def _span(omega_rad_s: FloatArray, run: slice) -> tuple[float, float]:
    inside = omega_rad_s[run]
    if inside.size > 1:
        return float(inside[0]), float(inside[-1])
    # A lonely point stands for the half steps to its neighbors: a bar needs a width.
    below, above = omega_rad_s[max(run.start - 1, 0)], omega_rad_s[min(run.stop, omega_rad_s.size - 1)]
    return float(np.sqrt(below * inside[0])), float(np.sqrt(inside[0] * above))


def response_pictures(result: Responses) -> tuple[Picture, ...]:
    """A Bode picture of each response of which something can be used, over the direct estimate."""
    return tuple(
        in_all_units(
            partial(
                bode,
                result.response,
                output=output,
                input=input,
                beside=result.measured.beside,
                fitted=result.used,
                least_coherence=result.least_coherence,
            ),
            key=f"response-{number}",
            description=f"Bode plot of {quantity(output).words} over {quantity(input).words}",
            converted=True,
        )
        for number, (output, input) in enumerate(_usable(result))
    )


def window_pictures(result: Responses) -> tuple[Picture, ...]:
    """Which window carries which frequency of each response of which something can be used."""
    response, diagnostics = result.response, result.measured.diagnostics
    pictures = []
    for number, (output, input) in enumerate(_usable(result)):
        row = response.pair(output, input)
        draw = partial(
            window_contributions,
            response.omega_rad_s,
            diagnostics.windows_s,
            diagnostics.share[row],
            diagnostics.window_error[row],
            composite_error=response.random_error[row],
        )
        words = f"Windows behind {quantity(output).words} over {quantity(input).words}"
        pictures.append(over_frequency(draw, key=f"windows-{number}", description=words, converted=True))
    return tuple(pictures)


def _usable(result: Responses) -> list[tuple[str, str]]:
    """Outputs and inputs of the responses of which something can be used."""
    response = result.response
    return [(response.outputs[y], response.inputs[u]) for y, u in np.argwhere(result.used.any(axis=-1))]


def loop_pictures(axis: Axis, loop: AxisLoop) -> tuple[Picture, ...]:
    """The broken loop with its margins and the sensitivity with its bandwidth; none where the loop was not seen."""
    if loop.loop is None:
        return ()
    margins, rejection = loop.margins, loop.rejection
    broken = partial(
        broken_loop,
        loop.loop.omega_rad_s,
        loop.loop.values[0, 0],
        random_error=loop.loop.random_error[0, 0],
        gain_crossovers=[_crossing(c.omega_rad_s, c.phase_margin_rad) for c in margins.gain_crossovers]
        if margins
        else (),
        phase_crossovers=[_crossing(c.omega_rad_s, c.gain_margin) for c in margins.phase_crossovers] if margins else (),
    )
    response = sensitivity(loop.loop)
    at = Estimated(value=10.0 ** (MINUS_3_DB / 20.0), std=0.0)
    rejected = partial(
        disturbance_rejection,
        response.omega_rad_s,
        response.values[0, 0],
        random_error=response.random_error[0, 0],
        bandwidth=_crossing(rejection.bandwidth_rad_s, at) if rejection and rejection.bandwidth_rad_s else None,
        peak=_crossing(rejection.peak_omega_rad_s, rejection.peak)
        if rejection and rejection.peak_omega_rad_s and rejection.peak
        else None,
    )
    return (
        in_all_units(broken, key=f"loop-{axis}", description=f"Broken {axis} loop with its margins"),
        in_all_units(rejected, key=f"rejection-{axis}", description=f"Sensitivity of the {axis} loop"),
    )


def _crossing(where: Estimated, what: Estimated) -> Crossing:
    return Crossing(omega_rad_s=where.value, omega_std_rad_s=where.std, value=what.value, value_std=what.std)


def timeline_pictures(result: Responses) -> tuple[Picture, ...]:
    """The flights, with the maneuvers shaded that entered the estimate."""
    document = result.document
    return timelines(
        result.segments,
        [record for record in document.records if record.used],
        inputs=document.inputs,
        outputs=document.outputs,
        key="timeline",
    )
