r"""What all targets of linear models share: the models without delays, their names, and what is held of them.

A tool that has no delays of its own gets them as states, unless lags or none at all were asked for
(:mod:`rotorid.simulation.rational_model`). The round trip is that of the matrices as they are written: the largest gain
in the middle of the band that was fitted, the fastest pole, and the delay that the exported model has at the upper end
of the band,

.. math:: \tau_e = -\frac{1}{\omega} \arg \frac{T_e(j\omega)}{T_0(j\omega)}

with :math:`T_0` the model without delays.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, warn
from rotorid.errors import UsageError
from rotorid.exports.settings import ExportSettings
from rotorid.exports.target import Compared, Fidelity, KeptDelays, table_lines
from rotorid.simulation.rational_model import (
    USUAL_BAND_RAD_S,
    RationalModel,
    pade_phase_error,
    right_up_to,
    sufficient_order,
)
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.results.model import IdentifiedModel

LONGEST_NAME = 31
"""Of a variable in a file of MATLAB."""

_NOTHING_S = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class NamedModel(Immutable):
    """A model as another tool gets it.

    Parameters
    ----------
    name
        Of a variable.
    plant
        Without delays, continuous.
    exported
        As it was chosen: with delays as states, as lags or without them, continuous or sampled.
    pade_order
        Of the approximations of its delays as states.
    right_up_to_rad_s
        Frequency up to which their phase matters.
    """

    name: str
    model: IdentifiedModel
    plant: RationalModel
    exported: RationalModel
    pade_order: int
    right_up_to_rad_s: float

    @property
    def band_rad_s(self) -> tuple[float, float]:
        """Fitted frequencies."""
        return self.model.band_rad_s or USUAL_BAND_RAD_S

    @property
    def omega_rad_s(self) -> FloatArray:
        """Frequencies up to the end of the band."""
        return np.geomspace(0.1 * self.band_rad_s[1], self.band_rad_s[1], 50)

    @property
    def pade_error_deg(self) -> float:
        """Largest error of the phase of a response by the approximation of its delays."""
        return math.degrees(pade_phase_error(self.model.system, self.pade_order, self.right_up_to_rad_s))

    @property
    def delays_s(self) -> FloatArray:
        """Of each response, shape ``(y, u)``; negative ones count as none, and so do those of no response at all."""
        system = self.model.system
        late = np.maximum(system.output_delays_s, 0.0)[:, None] + np.maximum(system.input_delays_s, 0.0)
        responds = np.abs(self.plant.response(self.omega_rad_s[-1:]))[..., 0] > 0.0
        return np.asarray(np.where(responds, late, 0.0))


def named_models(vehicle: JoinedVehicle, choices: ExportSettings) -> tuple[NamedModel, ...]:
    """The models of a vehicle under names that programs can have.

    Raises
    ------
    UsageError
        There is none, or two would have one name.
    ModelError
        A model has no proper state space.

    Examples
    --------
    >>> variable_name("hover.longitudinal")
    'hover_longitudinal'
    """
    if not vehicle.models:
        raise UsageError("no model to export", needed="a result of identify with a model")
    named = [named_model(model, choices) for model in vehicle.models]
    names = [model.name for model in named]
    for model in named:
        if names.count(model.name) > 1:
            raise UsageError(
                f"two results have the same name {model.name}",
                needed="results of different models",
                remedy="export them one by one",
            )
    return tuple(named)


def named_model(model: IdentifiedModel, choices: ExportSettings) -> NamedModel:
    """A model as it is exported.

    Raises
    ------
    ModelError
        It has no proper state space.
    """
    top = right_up_to(model.system, model.band_rad_s)
    order = choices.pade_order or sufficient_order(model.system, top)
    return NamedModel(
        name=variable_name(model.name),
        model=model,
        plant=model.rational(delays="none"),
        exported=model.rational(delays=choices.model_delay, pade_order=order, sample_rate_hz=choices.sample_rate_hz),
        pade_order=order,
        right_up_to_rad_s=top,
    )


def variable_name(name: str) -> str:
    """A name of letters, digits and underscores."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    return (plain if plain[:1].isalpha() else f"model_{plain}")[:LONGEST_NAME]


def compared_models(
    models: Sequence[NamedModel], choices: ExportSettings, *, own_delays: bool = False
) -> tuple[Compared, ...]:
    """Rows of the round trip.

    Parameters
    ----------
    models
        What is exported.
    choices
        What becomes of delays.
    own_delays
        Whether the target has delays of its own, which are exact.
    """
    return tuple(row for model in models for row in _rows(model, choices, own_delays=own_delays))


def _rows(model: NamedModel, choices: ExportSettings, *, own_delays: bool) -> Iterator[Compared]:
    system, exported = model.model.system, model.exported
    middle = math.sqrt(model.band_rad_s[0] * model.band_rad_s[1])
    sampled: Fidelity = "exact" if exported.sample_time_s is None else "approximated"
    gain, now = np.abs(system.response(np.array([middle]))), np.abs(exported.response(np.array([middle])))
    at = np.unravel_index(int(gain.argmax()), gain.shape)
    fidelity: Fidelity = "approximated" if choices.model_delay == "lag" else sampled
    label = f"{model.model.name}: gain at {middle:.3g} rad/s"
    yield Compared(name=label, unit="1", identified=float(gain[at]), exported=float(now[at]), held=fidelity)
    count = len(model.plant.A)
    if count:
        was, own = np.abs(system.poles()).max(), np.linalg.eigvals(exported.A[:count, :count]).astype(np.complex128)
        step_s = exported.sample_time_s
        fastest = float(np.abs(own if step_s is None else np.log(own) / step_s).max())
        yield Compared(
            name=f"{model.model.name}: fastest pole",
            unit="rad/s",
            identified=float(was),
            exported=fastest,
            held="exact" if exported.sample_time_s is None or was * exported.sample_time_s < 1.0 else "approximated",
        )
    if model.delays_s.max(initial=0.0) > _NOTHING_S:
        yield _delay_row(model, choices, own_delays=own_delays)


def _delay_row(model: NamedModel, choices: ExportSettings, *, own_delays: bool) -> Compared:
    top = model.band_rad_s[1]
    late = model.delays_s
    at = np.unravel_index(int(late.argmax()), late.shape)
    late_s = float(late[at])
    fidelity: Fidelity
    if own_delays:
        now_s, fidelity = late_s, "exact"
    elif choices.model_delay == "none":
        now_s, fidelity = 0.0, "not"
    else:
        without = model.model.rational(delays="none", sample_rate_hz=choices.sample_rate_hz)
        omega = np.array([top])
        ratio = complex(model.exported.response(omega)[(*at, 0)] / without.response(omega)[(*at, 0)])
        turns = round((top * late_s + float(np.angle(ratio))) / math.tau)
        now_s, fidelity = (math.tau * turns - float(np.angle(ratio))) / top, "approximated"
    return Compared(
        name=f"{model.model.name}: delay at {top:.3g} rad/s", unit="s", identified=late_s, exported=now_s, held=fidelity
    )


def early(models: Sequence[NamedModel]) -> tuple[Finding, ...]:
    """A remark on every model with a delay below zero."""
    found = []
    for model in models:
        lowest = min(
            model.model.system.input_delays_s.min(initial=0.0), model.model.system.output_delays_s.min(initial=0.0)
        )
        if lowest < -_NOTHING_S:
            message = f"{model.model.name} has a delay of {1e3 * lowest:.3g} ms, which is negligible."
            found.append(warn("export_compromise", model.model.name, message, delay_s=float(lowest)))
    return tuple(found)


def delay_words(models: Sequence[NamedModel], choices: ExportSettings) -> list[str]:
    """How delays are exported, in sentences."""
    late = [model for model in models if model.delays_s.max(initial=0.0) > _NOTHING_S]
    if not late:
        return []
    if choices.model_delay == "none":
        worst = 1e3 * max(float(model.delays_s.max()) for model in late)
        return [f"Delays of up to {worst:.3g} ms are left out (--no-delay): margins are too large."]
    if choices.model_delay == "lag":
        return ["Delays are lags (--delay-as-lag): the phase is right at low frequencies only."]
    if choices.sample_rate_hz is not None:
        return ["Delays are exact, as memory of past inputs."]
    return ["Delays are states, by Padé approximations:", *pade_words(late)]


def pade_words(models: Sequence[NamedModel]) -> list[str]:
    """Order, error of the phase and range of the Padé approximations of each model with a delay."""
    return [
        f"{model.model.name}: order {model.pade_order}, phase error {model.pade_error_deg:.2g} deg up to "
        f"{model.right_up_to_rad_s:.3g} rad/s."
        for model in models
        if model.delays_s.max(initial=0.0) > _NOTHING_S
    ]


def kept_delays(models: Sequence[NamedModel], choices: ExportSettings) -> dict[str, KeptDelays]:
    """What became of the delays of each model that has some, by its name."""
    approximated = choices.model_delay == "states" and choices.sample_rate_hz is None
    return {
        model.model.name: KeptDelays(
            longest_s=float(model.delays_s.max()),
            kept=choices.model_delay,
            pade_order=model.pade_order if approximated else None,
            phase_error_deg=model.pade_error_deg if approximated else None,
            up_to_rad_s=model.right_up_to_rad_s if approximated else None,
        )
        for model in models
        if model.delays_s.max(initial=0.0) > _NOTHING_S
    }


def air_words(models: Iterable[IdentifiedModel]) -> list[str]:
    """A sentence where a result knows the air, of which a model about hover has next to nothing."""
    return [
        f"{model.name} is linear about hover here: of the air it has the inflow of climb alone."
        for model in models
        if model.flight is not None
    ]


def description(item: NamedModel) -> list[str]:
    """Lines on a model: what it is, where it holds, its parameters with their standard deviations."""
    model = item.model
    low, high = item.band_rad_s
    lines = [f"{model.name}: {', '.join(model.structure.inputs)} to {', '.join(model.structure.outputs)}"]
    lines += [
        "SI units and radians; axes forward, right, down; inputs and outputs are differences from trim.",
        f"Fitted from {low:.3g} to {high:.3g} rad/s." if model.band_rad_s else "Fitted in time.",
        *(f"Log: {name}" for name in _log_names(model)),
    ]
    for name, found in model.parameters.items():
        if found.status != "dropped":
            spread = "" if found.std is None else f" +- {found.std:.2g}"
            lines.append(f"{name} = {found.value:.6g}{spread} {found.unit}".rstrip())
    return [harmless(line) for line in lines]


def harmless(text: str) -> str:
    """A text on one line that ends no comment and no string: names of files and models may be anything.

    Examples
    --------
    >>> harmless("a log" + chr(10) + "import os")
    'a log import os'
    """
    plain = "".join(letter if letter.isprintable() else " " for letter in text)
    return plain.replace('"' * 3, "'" * 3).replace(chr(92), "/")


def _log_names(model: IdentifiedModel) -> list[str]:
    from pathlib import Path

    return [Path(path).name for path in model.provenance.inputs]


def headed(title: str, rows: Sequence[Compared], sentences: Sequence[str]) -> list[str]:
    """Lines at the head of a file: its title, the round trip, what was left out."""
    lines = [title, "", *table_lines(rows), *(["", *sentences] if sentences else [])]
    return [harmless(line) for line in lines]


def measured(model: IdentifiedModel) -> Mapping[str, FloatArray] | None:
    """The measured response where all of it is a number; ``None`` where there is none."""
    response = model.data.response
    there = np.isfinite(response.values).all(axis=(0, 1)) if response.values.size else np.zeros(0, dtype=bool)
    if not there.any():
        return None
    return {
        "omega_rad_s": np.asarray(response.omega_rad_s[there]),
        "real": np.asarray(response.values.real[..., there]),
        "imag": np.asarray(response.values.imag[..., there]),
        "coherence": np.nan_to_num(response.coherence[..., there]),
    }
