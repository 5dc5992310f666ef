"""The page of ``track``: whether a gain changed in flight, what and when; then the gain over time and its model."""

from __future__ import annotations

from rotorid.data.display import capital
from rotorid.data.quantity import significant, with_error
from rotorid.documents.track import TrackDocument, silent, track_document
from rotorid.fleets.names import shown, words_of
from rotorid.identifying.tracking import FlightTracking
from rotorid.plot.tracking import followed_gain
from rotorid.report.findings import finding_rows
from rotorid.report.frame import Picture, drawn, render

WHY = {"stick": "too little stick movement", "air": "rougher air than in the reference"}
_POWERS = {"roll": "L_roll", "pitch": "M_pitch", "yaw": "N_yaw"}


def render_track(found: FlightTracking) -> str:
    """The page as one HTML file."""
    document = track_document(found)
    tracking = found.tracking
    picture = Picture(
        key="gain",
        description=f"Gain of {found.model} relative to the reference, with a band of two standard deviations",
        figure=drawn(
            followed_gain,
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
        title=f"{found.model} in {found.log}",
        sentences=sentences(document),
        picture=picture,
        document=document,
        remarks=finding_rows(document.findings),
        step_percent=f"{100.0 * float(str(document.provenance.settings['step_share'])):.0f}",
        parameters=parameter_rows(document),
        significant=significant,
    )


def sentences(document: TrackDocument) -> list[str]:
    """The answer in a sentence, then what else was found."""
    power = words_of(document.model, _POWERS.get(document.axis, "gain"))
    steps, lines = document.steps, []
    if steps:
        lines += [
            f"Changed at about {step.since_s:.0f} s: {power} {'fell' if step.ratio < 1.0 else 'rose'} to "
            f"{_percent(step.ratio, step.std)} of its value in the reference (detected at {step.at_s:.0f} s)."
            for step in steps
        ]
    elif document.verdict == "changed" and document.gain is not None:
        lines.append(f"Changed without a clear step: {power} ends at {_end(document)}.")
    elif document.verdict == "unchanged":
        lines.append(f"No change found: {power} {_within(document)}.")
    elif document.told_s > 0.0:
        share = document.detectable_share
        limit = "" if share is None else f" below {100.0 * share:.0f} %"
        lines.append(f"Not enough data to detect a change of {power}{limit}.")
    else:
        lines.append(f"Not enough data after the reference to detect a change of {power}.")
    if document.gain is not None and (steps or document.verdict != "changed"):
        lines.append(f"{capital(power)} at the end: {_end(document)}.")
    lines += [
        f"Mean {trim.channel.replace('_', ' ')} went from {significant(trim.before)} to {significant(trim.after)} "
        f"(detected at {trim.at_s:.0f} s). Usual causes: a damaged propeller, a shifted load, or a change of wind."
        for trim in document.trims
    ]
    lost_s = sum(gap.stop_s - gap.start_s for gap in document.cannot_tell)
    if lost_s > 0.0:
        reasons = " or ".join(WHY[why] for why in dict.fromkeys(gap.why for gap in document.cannot_tell))
        lines.append(f"No verdict for {lost_s:.0f} s: {reasons}.")
    if any(gap.why == "air" for gap in document.cannot_tell):
        lines.append("The wind rose after the reference. To track that part too, cut the log there.")
    return lines


def parameter_rows(document: TrackDocument) -> list[tuple[str, str, str]]:
    """Parameters of the tracked model: name with its words, value with its error, unit."""
    rows = []
    for name, value in document.parameters.items():
        quantity = shown(document.model, name, document.parameter_units.get(name, "1"))
        rows.append((quantity.label, with_error(value, document.parameter_stds.get(name)), quantity.unit))
    return rows


def _percent(ratio: float, std: float | None) -> str:
    return f"{with_error(100.0 * ratio, None if std is None else 100.0 * std)} %"


def _end(document: TrackDocument) -> str:
    assert document.gain is not None
    return f"{_percent(document.gain.value, document.gain.std)} of its value in the reference"


def _within(document: TrackDocument) -> str:
    """The change that the end of the flight would have shown."""
    share = document.detectable_share
    return "did not change" if share is None else f"did not change by {100.0 * share:.0f} % or more"
