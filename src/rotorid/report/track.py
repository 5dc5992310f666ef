"""The page of ``track``: a gain over a flight with its band, steps, trims, and what could not be told."""

from __future__ import annotations

from rotorid.data.quantity import significant, with_error
from rotorid.documents.track import TrackDocument, silent, track_document
from rotorid.identifying.tracking import FlightTracking
from rotorid.plot.tracking import followed_gain
from rotorid.report.frame import Picture, render
from rotorid.report.parts import finding_rows

WHY = {"stick": "the stick hardly moved", "air": "the air was rougher than in the reference"}


def render_track(found: FlightTracking) -> str:
    """The page as one HTML file."""
    document = track_document(found)
    tracking = found.tracking
    picture = Picture(
        key="gain",
        description=f"Gain of {found.model} over that of the reference, with its band of two standard deviations",
        figure=followed_gain(
            tracking.time_s,
            tracking.ratio,
            tracking.std,
            steps=[step.at_s for step in tracking.steps],
            silent=[(start_s, stop_s) for start_s, stop_s, _ in silent(found)],
            rougher=tracking.rougher,
            level=tracking.level,
        ),
    )
    return render(
        "track.html",
        logs=document.provenance.inputs,
        pictures=[picture],
        title=f"{found.model} through {found.log}",
        sentences=sentences(document),
        picture=picture,
        document=document,
        remarks=finding_rows(document.findings),
        step_percent=f"{100.0 * float(str(document.provenance.settings['step_share'])):.0f}",
        significant=significant,
        with_error=with_error,
    )


def sentences(document: TrackDocument) -> list[str]:
    """What happened, in words; the first is the answer."""
    steps, lines = document.steps, []
    if steps:
        lines += [
            f"The gain changed at about {step.since_s:.0f} s to {with_error(step.ratio, step.std)} of the reference "
            f"(seen at {step.at_s:.0f} s)."
            for step in steps
        ]
    elif document.verdict == "changed" and document.gain is not None:
        gain = with_error(document.gain.value, document.gain.std)
        lines.append(f"The gain changed without a clear step: at the end it is {gain} of the reference.")
    elif document.verdict == "unchanged":
        lines.append(f"No change of the gain was found: {_would_be_found(document)}.")
    elif document.told_s > 0.0:
        lines.append(f"Not enough data to say whether the gain changed: {_would_be_found(document)}.")
    else:
        lines.append("Not enough data after the reference to say whether the gain changed.")
    lines += [
        f"{trim.channel} at rest moved from {significant(trim.before)} to {significant(trim.after)}, seen at "
        f"{trim.at_s:.0f} s: a propeller, the center of gravity, or wind that turned."
        for trim in document.trims
    ]
    lost_s = sum(gap.stop_s - gap.start_s for gap in document.cannot_tell)
    if lost_s > 0.0:
        reasons = " or ".join(WHY[why] for why in dict.fromkeys(gap.why for gap in document.cannot_tell))
        lines.append(f"No verdict for {lost_s:.0f} s: {reasons}.")
    if any(gap.why == "air" for gap in document.cannot_tell):
        lines.append("Wind rose after the reference: cut the log there, and track the rest as a log of its own.")
    return lines


def _would_be_found(document: TrackDocument) -> str:
    """The change that the end of the flight would show."""
    share = document.detectable_share
    return "the end of the flight shows no change" if share is None else f"from {100.0 * share:.0f} % on it would show"
