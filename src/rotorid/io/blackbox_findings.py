"""Remarks of the blackbox reader: what was lost, which flights there are, and what had to be assumed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rotorid.data.findings import Finding
from rotorid.data.record import Topic
from rotorid.errors import LogError
from rotorid.io.blackbox_channels import QUAD_X
from rotorid.io.blackbox_decode import Flight

_NEEDED = (
    ("p", "the gyro is not logged, so that no response can be measured; enable it with blackbox_disable_gyro = OFF"),
    ("az", "the accelerometer is not logged; enable it with blackbox_disable_acc = OFF"),
    (
        "roll_command",
        "neither the motors nor the sums of the controllers are logged; enable them with blackbox_disable_motors = OFF",
    ),
)


def findings_of(
    flights: Sequence[Flight], unread: Sequence[tuple[int, LogError]], topics: Sequence[Topic]
) -> tuple[Finding, ...]:
    """All remarks on a log; ``flights`` and ``topics`` with the preferred flight first."""
    return (
        *_others(flights),
        *(_unread(number, error) for number, error in unread),
        *(finding for flight in flights for finding in _damage(flight)),
        *_missing(topics[0]),
        *_geometry(flights[0]),
    )


def _others(flights: Sequence[Flight]) -> Iterator[Finding]:
    if len(flights) < 2:
        return
    first, *others = flights
    listed = ", ".join(f"flight {flight.number} ({_span(flight)})" for flight in others)
    yield Finding(
        kind="several_flights",
        severity="info",
        where="log",
        message=f"the log holds {len(flights)} flights; the longest, flight {first.number} ({_span(first)}), comes "
        f"first, and the others are {listed}",
        numbers={"flights": len(flights), "longest_s": first.duration_s},
    )


def _span(flight: Flight) -> str:
    return f"{flight.time_s[0]:.1f} to {flight.time_s[-1]:.1f} s"


def _unread(number: int, error: LogError) -> Finding:
    return Finding(
        kind="corrupt_log",
        severity="warning",
        where=f"flight {number}",
        message=f"flight {number} was left out: {error.came}",
        numbers={"flight": number},
    )


def _damage(flight: Flight) -> Iterator[Finding]:
    damage, where = flight.damage, f"flight {flight.number}"
    if damage.skipped_bytes:
        yield Finding(
            kind="corrupt_log",
            severity="warning",
            where=where,
            message=f"{damage.skipped_bytes} bytes in {damage.places} places of {where} are not frames and were "
            f"skipped, the first {damage.first_byte} bytes after its beginning; {damage.lost_frames} frames are "
            "missing, and the format has no checksum to vouch for the others",
            numbers={
                "bytes": damage.skipped_bytes,
                "places": damage.places,
                "first_byte": damage.first_byte,
                "lost_frames": damage.lost_frames,
            },
        )
    elif damage.lost_frames:
        yield Finding(
            kind="gap",
            severity="warning",
            where=where,
            message=f"{damage.lost_frames} frames of {where} were never written: the logger could not keep up; lower "
            "the logging rate (blackbox_sample_rate) or use a faster card",
            numbers={"lost_frames": damage.lost_frames, "frames": len(flight.frames)},
        )
    if damage.cut_bytes or not damage.ended:
        yield Finding(
            kind="corrupt_log",
            severity="info",
            where=where,
            message=f"{where} was not closed: it ends without the logger's last word, and {damage.cut_bytes} bytes of "
            "an incomplete frame were skipped",
            numbers={"bytes": damage.cut_bytes, "frames": len(flight.frames)},
        )


def _missing(topic: Topic) -> Iterator[Finding]:
    for name, message in _NEEDED:
        if topic.row(name) is None:
            yield Finding(kind="missing_channel", severity="warning", where=topic.name, message=message)


def _geometry(flight: Flight) -> Iterator[Finding]:
    if sum(name.startswith("motor[") for name in flight.fields) != len(QUAD_X):
        return
    known = {"yaw_motors_reversed", "yaw_motor_direction"} & set(flight.header.values)
    turning = "" if known else ", and that the first motor turns clockwise seen from above"
    yield Finding(
        kind="assumed_geometry",
        severity="info",
        where=f"flight {flight.number}",
        message="the commands are the mix of the four motors, which are taken to be those of a quad X: rear right, "
        f"front right, rear left, front left; the log does not say so{turning}",
    )
