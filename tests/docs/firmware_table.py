"""The table of ArduPilot's versions in ``docs/design.md``: ``python tests/docs/firmware_table.py`` writes it again."""

from __future__ import annotations

import re
from pathlib import Path

from rotorid.autopilots.ardupilot.system_id import RULES, EntryRule, start_mode
from rotorid.autopilots.firmware import Version

PAGE = Path(__file__).resolve().parents[2] / "docs" / "design.md"
TABLE = re.compile(r"(?<=<!-- written by tests/docs/firmware_table.py -->\n)(?:\|.*\n)*")


def firmware_table() -> str:
    """One row a rule."""
    rows = [
        f"| {_versions(rule)} | {rule.axes[0]} to {rule.axes[-1]} | "
        f"{', '.join(mode.words for mode in rule.accepted) or 'any, in flight'} | {start_mode(rule.axes[0]).words} | "
        f"{rule.throttle} | {rule.says} |"
        for rule in RULES
    ]
    head = "| Copter | `SID_AXIS` | SYSTEMID is entered from | a run begins in | throttle | it refuses with |"
    return "\n".join([head, "|---|---|---|---|---|---|", *rows]) + "\n"


def _versions(rule: EntryRule) -> str:
    if rule.before is None:
        return f"{_named(rule.since)} and later"
    major, minor = rule.before
    return f"{_named(rule.since)} to {_named((major, minor - 1))}"


def _named(version: Version) -> str:
    return f"{version[0]}.{version[1]}"


def refilled(text: str) -> str:
    """The page with the table of today."""
    return TABLE.sub(lambda _: firmware_table(), text)


if __name__ == "__main__":
    PAGE.write_text(refilled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
