"""What a careful engineer remarks on a PX4 log before using it, with the logging parameter to change."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rotorid.data.findings import Finding
from rotorid.data.record import Topic

_PROFILE = "SDLOG_PROFILE = 25 (bits 0 default set, 3 system identification, 4 high rate)"
_NEEDED = {
    "p": "the body rates p, q, r (vehicle_angular_velocity)",
    "roll_command": "what the mixer receives (vehicle_torque_setpoint, before 2022 actuator_controls_0)",
    "thrust_command": "the collective thrust (vehicle_thrust_setpoint, before 2022 actuator_controls_0)",
}


def findings_of(topics: Sequence[Topic], facts: Mapping[str, Any]) -> Iterator[Finding]:
    """Damage, dropouts, missing channels and slow topics of a log.

    Parameters
    ----------
    topics
        What was read.
    facts
        What the container says: ``damage``, ``dropouts``, ``size_bytes``, ``parameters``.
    """
    yield from _damage(facts["damage"], facts["size_bytes"])
    yield from _dropouts(facts["dropouts"])
    yield from _missing(topics)
    yield from _slow(topics, facts["parameters"].get("SDLOG_PROFILE"))


def _damage(damage: Sequence[tuple[int, int, str]], size_bytes: int) -> Iterator[Finding]:
    if not damage:
        return
    lost = sum(stop - start for start, stop, _ in damage)
    first, _, reason = damage[0]
    places = "in one place" if len(damage) == 1 else f"in {len(damage)} places"
    yield Finding(
        kind="corrupt_log",
        severity="warning",
        where=f"byte {first}",
        message=f"The file is damaged {places}, first at byte {first} of {size_bytes}: {reason}. {lost} bytes were "
        "left out; what stands around them was read. Copy the log again from the vehicle if that is possible.",
        numbers={"first_byte": first, "lost_bytes": lost, "places": len(damage), "size_bytes": size_bytes},
    )


def _dropouts(dropouts: Sequence[tuple[float, float]]) -> Iterator[Finding]:
    if not dropouts:
        return
    total_s = sum(duration for _, duration in dropouts)
    at_s, longest_s = max(dropouts, key=lambda drop: drop[1])
    yield Finding(
        kind="gap",
        severity="warning" if longest_s > 0.0 else "info",
        where="logger",
        message=f"The logger lost data {len(dropouts)} times, {total_s:.3f} s in all and {longest_s:.3f} s at most, at "
        f"{at_s:.2f} s. A faster SD card or fewer topics (SDLOG_PROFILE) help.",
        numbers={"dropouts": len(dropouts), "lost_s": total_s, "longest_s": longest_s, "longest_at_s": at_s},
    )


def _missing(topics: Sequence[Topic]) -> Iterator[Finding]:
    held = {channel.name for topic in topics for channel in topic.channels}
    for name, meaning in _NEEDED.items():
        if name not in held:
            yield Finding(
                kind="missing_channel",
                severity="warning",
                where=name,
                message=f"The log does not hold {meaning}. Set {_PROFILE} before the next flight.",
            )


def _slow(topics: Sequence[Topic], profile: float | None) -> Iterator[Finding]:
    gyro_hz = next((topic.sample_rate_hz for topic in topics if topic.row("p") is not None), 0.0)
    commands = [topic for topic in topics if any(channel.name.endswith("_command") for channel in topic.channels)]
    for topic in commands:
        if 0.0 < topic.sample_rate_hz < 0.5 * gyro_hz:
            now = "" if profile is None else f" (it is {profile:g})"
            yield Finding(
                kind="rate_too_low",
                severity="warning",
                where=topic.name,
                message=f"{topic.name} was logged at {topic.sample_rate_hz:.0f} Hz and the rates at {gyro_hz:.0f} Hz: "
                f"the slower one limits the band and adds delay. Set {_PROFILE}{now} before the next flight.",
                numbers={"rate_hz": topic.sample_rate_hz, "gyro_rate_hz": gyro_hz},
            )
