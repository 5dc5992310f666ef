"""Pictures of the flights behind a result: what was commanded, what answered, and where the maneuvers were."""

from __future__ import annotations

from collections.abc import Sequence

from rotorid.pipeline.document import ManeuverDocument
from rotorid.pipeline.identification import Segment
from rotorid.plot.excitation import timeline
from rotorid.report.picture import Picture


def timelines(
    segments: Sequence[Segment],
    maneuvers: Sequence[ManeuverDocument],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    key: str,
) -> tuple[Picture, ...]:
    """One picture for each record, since each has its own clock.

    Parameters
    ----------
    segments
        The data, which may reach into the quiet time around their maneuvers, or over several of them.
    maneuvers
        What to shade.
    inputs, outputs
        Channels to draw.
    key
        Identifiers of the pictures are this and a number.
    """
    by_record: dict[str, list[Segment]] = {}
    for segment in segments:
        by_record.setdefault(segment.record, []).append(segment)
    return tuple(
        Picture(
            key=f"{key}-{number}",
            description=f"Inputs and outputs over time in {record}, maneuvers shaded",
            figure=timeline(
                within,
                inputs=inputs,
                outputs=outputs,
                shaded=[(one.start_s, one.stop_s) for one in maneuvers if one.record == record],
            ),
        )
        for number, (record, within) in enumerate(by_record.items())
    )
