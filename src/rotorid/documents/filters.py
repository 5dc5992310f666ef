"""Filters as documents hold them: flown and proposed values, with what each change costs and saves."""

from __future__ import annotations

from rotorid.documents.base import Document
from rotorid.loops.filter_choice import FilterProposal
from rotorid.models.autopilots.betaflight_settings import command_line_name


class FilterDocument(Document):
    """A parameter of a filter: flown (null where the log has none) and proposed, equal where it stays.

    ``costs_deg`` is the phase that its change costs at the crossover, of roll, pitch and yaw the largest, and
    ``saves_percent`` what it saves of the noise at the motors, each with its 95 % interval. Parameters that change
    together have the same numbers; negative ones give phase back, or add noise.
    """

    flown: float | None
    proposed: float
    costs_deg: float
    costs_deg_interval: tuple[float, float]
    saves_percent: float
    saves_percent_interval: tuple[float, float]


def filter_documents(proposal: FilterProposal | None) -> dict[str, FilterDocument]:
    """Parameters of the filters that were looked at; none where the log does not show what they do."""
    if proposal is None:
        return {}
    found = {
        name: FilterDocument(
            flown=value,
            proposed=value,
            costs_deg=0.0,
            costs_deg_interval=(0.0, 0.0),
            saves_percent=0.0,
            saves_percent_interval=(0.0, 0.0),
        )
        for name, value in proposal.offered.items()
    }
    for part in proposal.parts:
        cost, save = part.costs_deg, part.saves_percent
        found |= {
            name: FilterDocument(
                flown=flown,
                proposed=new,
                costs_deg=cost.value,
                costs_deg_interval=(cost.lower, cost.upper),
                saves_percent=save.value,
                saves_percent_interval=(save.lower, save.upper),
            )
            for name, (flown, new) in part.values.items()
        }
    return {command_line_name(name): document for name, document in found.items()}
