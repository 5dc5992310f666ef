"""Several plans side by side: which of them tells most about which parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.flight_plan import FlightPlan
from rotorid.data.immutable import Immutable, read_only
from rotorid.design.choices import FitChoices
from rotorid.design.loop import LoopModel
from rotorid.design.prediction import Prediction, predict
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.models.structure import LinearStructure
from rotorid.typing import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison(Immutable):
    """What several plans will tell about the same parameters.

    Parameters
    ----------
    plans
        Their names.
    duration_s
        Their lengths, shape ``(plans,)``.
    parameters
        Free parameters of the structure.
    percent
        Standard deviations in percent of the values, shape ``(plans, parameters)``; infinite where a plan does not
        show a parameter.
    predictions
        What stands behind it; ``None`` for a plan that could not support the model.
    refused
        Why not, by the name of the plan.
    """

    plans: tuple[str, ...]
    duration_s: FloatArray
    parameters: tuple[str, ...]
    percent: FloatArray
    predictions: tuple[Prediction | None, ...]
    refused: Mapping[str, str]

    def __post_init__(self) -> None:
        self._set(
            duration_s=read_only(self.duration_s, np.float64, ndim=1),
            percent=read_only(self.percent, np.float64, ndim=2),
            refused=self.refused,
        )

    @property
    def best(self) -> Mapping[str, str]:
        """The plan that tells most about each parameter that any of them shows."""
        least = self.percent.argmin(axis=0)
        return {
            name: self.plans[row]
            for p, (name, row) in enumerate(zip(self.parameters, least, strict=True))
            if np.isfinite(self.percent[row, p])
        }

    @property
    def percent_of_a_minute(self) -> FloatArray:
        r"""What a minute of each plan is worth, :math:`p \sqrt{T / 60}`, as if errors fell with the root of time."""
        return np.asarray(self.percent * np.sqrt(self.duration_s / 60.0)[:, None])


def compare_plans(
    structure: LinearStructure,
    values: Mapping[str, float],
    loop: LoopModel,
    plans: Sequence[FlightPlan],
    *,
    choices: FitChoices | None = None,
) -> Comparison:
    """Predict several plans for the same vehicle and model.

    Parameters
    ----------
    structure, values, loop, choices
        As for :func:`rotorid.design.prediction.predict`.
    plans
        At least one, each of its own name.

    Raises
    ------
    UsageError
        There is no plan, or two have one name.

    Examples
    --------
    >>> from rotorid.design.known_loops import axis_loop
    >>> from rotorid.design.spectrum import White
    >>> from rotorid.excitation.planned import planned, sequence
    >>> from rotorid.models.rate import rate_model
    >>> roll, truth = rate_model("rate.roll"), {"L_roll": 80.0, "L_p": -4.0, "T_motor": 0.05, "tau_roll": 0.006}
    >>> loop = axis_loop(roll, truth, None, White(std=(0.1,), sample_rate_hz=200.0))
    >>> def sweeps(name: str, amplitude: float) -> FlightPlan:
    ...     one = planned("roll", "pilot_sweep", start_s=0.0, amplitude=amplitude, duration_s=40.0,
    ...                   sample_rate_hz=200.0, band_rad_s=(1.0, 50.0))
    ...     return sequence(name, [one])
    >>> compare_plans(roll, truth, loop, [sweeps("soft", 0.05), sweeps("hard", 0.1)]).best["L_roll"]
    'hard'
    """
    names = tuple(plan.name for plan in plans)
    if not plans or len(set(names)) < len(names):
        raise UsageError(f"the plans {', '.join(names) or '(none)'} came", needed="at least one, each of its own name")
    predictions: list[Prediction | None] = []
    refused = {}
    for plan in plans:
        try:
            predictions.append(predict(structure, values, loop, plan, choices=choices))
        except InsufficientDataError as error:
            predictions.append(None)
            refused[plan.name] = str(error)
    free = structure.parameters.free
    percent = np.full((len(plans), len(free)), np.inf)
    for row, prediction in zip(percent, predictions, strict=True):
        for one in prediction.parameters if prediction is not None else ():
            row[free.index(one.name)] = one.percent
    return Comparison(
        plans=names,
        duration_s=np.array([plan.duration_s for plan in plans]),
        parameters=free,
        percent=percent,
        predictions=tuple(predictions),
        refused=refused,
    )
