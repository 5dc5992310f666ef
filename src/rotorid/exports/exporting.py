"""The verb ``export``: a vehicle in the files of a target, and vehicles drawn from the covariance of its results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING

from rotorid.errors import ModelError, UsageError
from rotorid.exports.settings import ExportSettings
from rotorid.exports.target import Exported
from rotorid.exports.targets import Target, target_named

if TYPE_CHECKING:
    from rotorid.exports.learners import DrawnFiles
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.models.rotors import RotorLayout
    from rotorid.results.model import IdentifiedModel
    from rotorid.simulation.multirotor_flight import Aircraft


def export(
    what: JoinedVehicle | IdentifiedModel | Sequence[IdentifiedModel],
    target: str,
    choices: ExportSettings | None = None,
    *,
    given: Mapping[str, float] | None = None,
    layout: RotorLayout | None = None,
    like: Aircraft | None = None,
) -> Exported:
    """A vehicle in the files of another tool.

    Parameters
    ----------
    what
        An identified model, several of one vehicle, or what was joined from them.
    target
        Name of the target, see :data:`rotorid.exports.targets.TARGETS`.
    choices
        Delay, rate, name.
    given, layout
        Numbers and rotors that the results do not hold, for :func:`rotorid.flying.vehicle_from_results.joined_vehicle`.
    like
        A vehicle that gives what is missing then.

    Raises
    ------
    UsageError
        There is no such target, it needs a number that is not known, or it has no place for a choice.
    ModelError
        The target cannot hold the vehicle.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> known = {"m": 1.2, "I_xx": 0.012, "I_yy": 0.012, "I_zz": 0.02, "c_2": 9.0, "kappa": 0.02, "arm": 0.25}
    >>> exported = export([], "gazebo", given=known, layout=library_layout("quad.x"))
    >>> sorted(exported.files)
    ['22002_gz_vehicle', 'vehicle.world.sdf', 'vehicle/model.config', 'vehicle/model.sdf']
    """
    found, chosen = target_named(target), choices or ExportSettings()
    _require_supported_choices(found, chosen)
    vehicle = joined(what, chosen, given=given, layout=layout, like=like)
    if found.name in _OF_BOTH_HALVES:
        vehicle = _with_both_halves(vehicle)
    made: Exported = import_module(f"rotorid.exports.{found.module}").export(vehicle, chosen)
    return made


_OF_BOTH_HALVES = ("matlab", "control", "json")
"""Targets that hold any number of linear models."""


def _with_both_halves(vehicle: JoinedVehicle) -> JoinedVehicle:
    """The vehicle with the model of its whole motion after those of both halves of it."""
    from rotorid.flying.model_from_results import joined_halves

    whole = joined_halves(vehicle.models)
    if whole is None:
        return vehicle
    return replace(vehicle, models=(*vehicle.models, whole), findings=(*vehicle.findings, *whole.findings))


def _require_supported_choices(target: Target, choices: ExportSettings) -> None:
    """Refuse choices that the target has no place for, so that no answer says that they were heeded."""
    if not target.states and (choices.delay == "states" or choices.pade_order is not None):
        raise UsageError(
            f"{target.name} cannot have delays as states",
            needed="matlab, control, fmu or json",
            remedy="use --delay-as-lag instead of --pade" if target.lag else "leave --pade out",
        )
    if not target.states and choices.sample_rate_hz is not None:
        raise UsageError(
            f"{target.name} has no sample rate",
            needed="matlab, control, fmu or json",
            remedy="leave --sample-rate out",
        )
    if choices.delay == "lag" and not target.lag:
        raise UsageError(
            f"{target.name} has no motor lag to which the delay could be added",
            needed="a target with motor lag",
            remedy="leave --delay-as-lag out",
        )


def export_draws(
    models: Sequence[IdentifiedModel],
    target: str,
    choices: ExportSettings,
    count: int,
    *,
    seed: int = 0,
    given: Mapping[str, float] | None = None,
    layout: RotorLayout | None = None,
    like: Aircraft | None = None,
) -> tuple[list[Exported], int]:
    """Vehicles drawn from the covariance of the results, and how many draws were impossible.

    Parameters
    ----------
    models, target, choices, given, layout, like
        As for :func:`export`.
    count
        How many vehicles.
    seed
        Of the draws.

    Raises
    ------
    UsageError
        The vehicle needs a number that is not known, so that every draw does.
    ModelError
        Hardly any draw is a vehicle.
    """
    import numpy as np

    from rotorid.exports.draws import draws, require_possible

    identified = _made(models, choices, given, layout, like)
    export(identified, target, choices)

    def made(drawn: Sequence[IdentifiedModel]) -> Exported:
        vehicle = _made(drawn, choices, given, layout, like)
        require_possible(vehicle, identified)
        return export(vehicle, target, choices)

    return draws(models, count, made, rng=np.random.default_rng(seed))


def draw_files(drawn: Sequence[Exported], target: str, choices: ExportSettings) -> DrawnFiles:
    """Files of drawn vehicles: one with all of them where the target has such a format, else a numbered folder each.

    Parameters
    ----------
    drawn
        Of :func:`export_draws`.
    target, choices
        As there.
    """
    from rotorid.exports.learners import DrawnFiles

    found = target_named(target)
    if found.together and drawn:
        made: DrawnFiles = import_module(f"rotorid.exports.{found.module}").together(drawn, choices.names)
        return made
    digits = len(str(len(drawn)))
    return DrawnFiles(
        files={
            f"draws/{number:0{digits}}/{name}": content
            for number, item in enumerate(drawn, start=1)
            for name, content in item.files.items()
        }
    )


def joined(
    what: JoinedVehicle | IdentifiedModel | Sequence[IdentifiedModel],
    choices: ExportSettings,
    *,
    given: Mapping[str, float] | None = None,
    layout: RotorLayout | None = None,
    like: Aircraft | None = None,
) -> JoinedVehicle:
    """What is exported, under the name that was chosen, with draws for the intervals of what follows from it.

    Parameters
    ----------
    what
        A vehicle that was made of results, or the results.
    choices
        Settings of the export.
    given
        Constants of the vehicle that the user knows, by name.
    layout
        Places of its rotors, where the results do not say them.
    like
        Vehicle that stands for what no result says.
    """
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.results.model import as_models

    if isinstance(what, JoinedVehicle):
        return what
    models = as_models(what)
    vehicle = _made(models, choices, given, layout, like)
    if vehicle.multirotor is None or not any(model.bounds.names for model in models):
        return vehicle
    import numpy as np

    from rotorid.exports.draws import draws, require_possible

    def made(drawn: Sequence[IdentifiedModel]) -> JoinedVehicle:
        found = _made(drawn, choices, given, layout, like)
        require_possible(found, vehicle)
        return found

    try:
        drawn, _ = draws(models, _DRAWS, made, rng=np.random.default_rng(0))
    except ModelError:
        # Known too badly for an interval: the numbers themselves are written with their own.
        return vehicle
    return replace(vehicle, draws=tuple(drawn))


def _made(
    models: Sequence[IdentifiedModel],
    choices: ExportSettings,
    given: Mapping[str, float] | None,
    layout: RotorLayout | None,
    like: Aircraft | None,
) -> JoinedVehicle:
    """The vehicle of results, with numbers of a similar one where there is one."""
    from rotorid.flying.user_vehicles import own_vehicle
    from rotorid.flying.vehicle_from_results import joined_vehicle

    if like is None:
        return joined_vehicle(models, given=given, name=choices.names, layout=layout)
    return own_vehicle(models, like=like, given=given, name=choices.names, layout=layout).joined


_DRAWS = 100
"""Of which a standard deviation is known to 7 %."""
