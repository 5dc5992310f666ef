"""Which order a black box is given by the records it is fitted to."""

from __future__ import annotations

import logging

from rotorid.fits.time.fit import unknowns_of
from rotorid.fitting.black_box.fit import StartPlan
from rotorid.flights.segments import TimeRecords
from rotorid.models.black_box import black_box, black_box_pairs
from rotorid.models.structure import LinearStructure
from rotorid.results.summary import OrderChoice, OrderRow, finite
from rotorid.settings.identifying import IdentifySettings
from rotorid.verification.orders import HIGHEST_ORDER, OrderComparison, compare_orders

_PROGRESS = logging.getLogger("rotorid.progress")


def chosen_order(
    structure: LinearStructure, records: TimeRecords, settings: IdentifySettings
) -> tuple[LinearStructure, OrderChoice]:
    """A black box of the order that predicts unseen data best, and the table that led to it.

    Parameters
    ----------
    structure
        ``black_box:auto``, of first order: one for each input and its output, or one for all.
    records
        What it will be fitted to.
    settings
        Whose seed counts.

    Raises
    ------
    InsufficientDataError
        The records are too short to hold any part of them out.
    """
    decoupled = len(structure.states) > 1
    delays = any(name.startswith("tau") for name in structure.parameters.names)

    def say(order: int) -> None:
        _PROGRESS.info(f"black boxes of order {order}", extra={"done": order - 1, "total": HIGHEST_ORDER})

    found = compare_orders(
        records.data,
        inputs=structure.inputs,
        outputs=structure.outputs,
        decoupled=decoupled,
        delays=delays,
        hold=records.hold,
        unknowns=unknowns_of(structure),
        plan=StartPlan(seed=settings.seed),
        progress=say,
    )
    if decoupled:
        pairs = tuple(zip(structure.inputs, structure.outputs, strict=True))
        return black_box_pairs(found.order, pairs, delays=delays), _table(found)
    return black_box(found.order, structure.inputs, structure.outputs, delays=delays), _table(found)


def _table(found: OrderComparison) -> OrderChoice:
    return OrderChoice(
        order=found.order,
        best=found.best,
        rows=tuple(
            OrderRow(
                order=score.order,
                parameters=score.parameters,
                fitted_percent=finite(score.fitted_percent),
                unseen_percent=finite(score.unseen_percent),
                unseen_std=finite(score.unseen_error),
                behind_percent=finite(score.behind_percent),
                behind_std=finite(score.behind_error),
                aic=finite(score.aic),
                bic=finite(score.bic),
                color=finite(score.color),
                refused=score.refused,
            )
            for score in found.scores
        ),
        held_out=found.records,
        chance=found.chance,
    )
