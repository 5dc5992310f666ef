"""Bode pictures of measured responses and the model, those on the axis of their input first."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from rotorid.pipeline.identification import Identification
from rotorid.plot.bode import bode
from rotorid.plot.quantity import quantity
from rotorid.report.picture import Picture, in_all_units

_ON_AXIS = {
    "roll_command": ("p", "phi", "v", "ay", "p_dot", "v_dot"),
    "pitch_command": ("q", "theta", "u", "ax", "q_dot", "u_dot"),
    "yaw_command": ("r", "psi", "r_dot"),
    "thrust_command": ("w", "az", "w_dot"),
}
_MOST_UNFOLDED = 4


@dataclass(frozen=True, kw_only=True, slots=True)
class ModelPictures:
    """Pictures in sight, and those that fold away: what one axis does to another."""

    leading: tuple[Picture, ...]
    folded: tuple[Picture, ...]


def on_axis(output: str, input: str) -> bool:
    """Whether an output belongs to the axis of an input; every output does where the input has no axis.

    Examples
    --------
    >>> on_axis("q", "pitch_command"), on_axis("az", "pitch_command"), on_axis("az", "motor_3")
    (True, False, True)
    """
    return input not in _ON_AXIS or output in _ON_AXIS[input]


def by_axis(pairs: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """Pairs ``(output, input)`` with those on axis first, and of these by input, else in their order."""
    inputs = list(dict.fromkeys(input for _, input in pairs))
    return sorted(pairs, key=lambda pair: (not on_axis(*pair), inputs.index(pair[1])))


def model_pictures(identified: Identification, *, anchor: str) -> ModelPictures:
    """A picture of each fitted response; a few are all in sight.

    Parameters
    ----------
    identified
        What ``identify`` found.
    anchor
        Prefix of the identifiers on the page.
    """
    response = identified.response
    pairs = by_axis(
        [
            (output, input)
            for u, input in enumerate(response.inputs)
            for y, output in enumerate(response.outputs)
            if identified.fitted[y, u].any()
        ]
    )
    pictures = tuple(
        _picture(identified, f"{anchor}-response-{number}", output, input)
        for number, (output, input) in enumerate(pairs)
    )
    leading = sum(on_axis(*pair) for pair in pairs)
    if len(pairs) <= _MOST_UNFOLDED or not leading:
        leading = len(pairs)
    return ModelPictures(leading=pictures[:leading], folded=pictures[leading:])


def _picture(identified: Identification, key: str, output: str, input: str) -> Picture:
    draw = partial(
        bode,
        identified.response,
        output=output,
        input=input,
        model=identified.model_response,
        beside=identified.beside,
        fitted=identified.fitted,
        least_coherence=identified.least_coherence,
    )
    description = f"Bode plot of {quantity(output).words} over {quantity(input).words}, measured and model"
    return in_all_units(draw, key=key, description=description, converted=True)
