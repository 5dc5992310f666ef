"""What a maneuver excited: auto-spectral densities of instrument, input and output."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rotorid.data.channel import STANDARD_UNITS
from rotorid.errors import UsageError
from rotorid.plot.curves import Style, line
from rotorid.plot.figure import Figure, Trace
from rotorid.plot.quantity import Quantity, quantity
from rotorid.plot.stack import Panel, stacked
from rotorid.plot.theme import BESIDE, INPUT, MEASURED, MODEL
from rotorid.plot.view import Frequency, Magnitude, View, decibels
from rotorid.typing import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Density:
    """The auto-spectral density of one channel.

    Parameters
    ----------
    channel
        Its name, which decides words and unit.
    values
        One-sided density in SI units squared per hertz, shape ``(f,)``.
    """

    channel: str
    values: FloatArray


def input_spectrum(
    omega_rad_s: FloatArray,
    density: FloatArray,
    *,
    input: str,
    instrument: Density | None = None,
    output: Density | None = None,
    noise: FloatArray | None = None,
    excited: Sequence[tuple[float, float]] = (),
    frequency: Frequency = "rad/s",
    magnitude: Magnitude = "dB",
) -> Figure:
    r"""Auto-spectral densities of what drove the vehicle and what it answered.

    The noise of the output is what the input does not explain, :math:`G_{vv} = (1 - \gamma^2) G_{yy}`. With feedback
    a part of the noise returns through the input, and the coherence then understates it.

    Parameters
    ----------
    omega_rad_s
        Positive frequencies, rising, shape ``(f,)``.
    density
        One-sided density of the input in its SI unit squared per hertz, shape ``(f,)``; drawn in units of paper
        (degrees instead of radians), in decibels :math:`10\log_{10}`.
    input
        Name of the input channel.
    instrument
        Density of the injected test signal; it has a panel of its own where its unit is another one.
    output
        Density of the output, in a panel of its own.
    noise
        Density of the part of the output that the input does not explain, SI units, shape ``(f,)``.
    excited
        Bands in rad/s to shade.
    frequency, magnitude
        Units of the picture.

    Raises
    ------
    UsageError
        A shape does not fit, there is a noise without an output, or a unit is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> figure = input_spectrum(np.array([1.0, 10.0]), np.array([0.1, 0.001]), input="roll_command")
    >>> figure["data"][0]["y"], figure["layout"]["annotations"][0]["text"]
    ([-10.0, -30.0], 'Density of roll command [dB re 1/Hz]')
    """
    view = View(frequency=frequency, magnitude=magnitude)
    curves = {"density": density, "noise": noise, "instrument": instrument, "output": output}
    for name, came in curves.items():
        values = came.values if isinstance(came, Density) else came
        if values is not None and values.shape != omega_rad_s.shape:
            raise UsageError(f"{name} came with the shape {values.shape}", needed=f"the shape {omega_rad_s.shape}")
    if noise is not None and output is None:
        raise UsageError("a noise density came without its output", needed="the density of the output too")
    driven = [("input", Density(channel=input, values=density), INPUT, "solid")]
    groups = [driven]
    if instrument is not None:
        told = ("instrument", instrument, MODEL, "7 3")
        one_unit = STANDARD_UNITS.get(instrument.channel) == STANDARD_UNITS.get(input)
        groups = [[*driven, told]] if one_unit else [[told], driven]
    if output is not None:
        groups.append([("output", output, MEASURED, "solid")])
    if noise is not None and output is not None:
        unexplained = Density(channel=output.channel, values=noise)
        groups[-1].append(("not explained by the input", unexplained, BESIDE, "2 2"))
    panels = [_panel(view, omega_rad_s, group, excited) for group in groups]
    return stacked(panels, x_axis=view.axis(omega_rad_s))


def _panel(
    view: View,
    omega_rad_s: FloatArray,
    group: Sequence[tuple[str, Density, str, str]],
    excited: Sequence[tuple[float, float]],
) -> Panel:
    papers = [quantity(density.channel) for _, density, _, _ in group]
    words = " and ".join(dict.fromkeys(paper.words for paper in papers))
    traces: list[Trace] = []
    for (name, density, color, dash), paper in zip(group, papers, strict=True):
        level = decibels(paper.factor**2 * density.values, of_power=True)
        style = Style(name=name, color=color, dash=dash, legend=True, unit=_unit(view, paper))
        traces.append(line(view, omega_rad_s, view.height(level, decibels=10.0), style))
    return Panel(
        label=f"Density of {words} [{_unit(view, papers[0])}]",
        traces=traces,
        height_px=190,
        axis={"rangemode": "tozero"} if view.magnitude == "linear" else {},
        shaded=view.bands(excited),
    )


def _unit(view: View, paper: Quantity) -> str:
    density = f"({paper.unit})²/Hz" if paper.unit else "1/Hz"
    return f"dB re {density}" if view.magnitude == "dB" else density
