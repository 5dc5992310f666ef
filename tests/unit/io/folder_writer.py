"""Sets of files that bear one number each; as a program, written one after the other until it is killed."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from rotorid.io.folders import ResultKind, making, target_folder

NAMES = ("a.txt", "b.txt", "pictures/c.svg")


def fill(place: Path, number: int) -> None:
    """A set in which every file bears the same number, some pages long."""
    for name in NAMES:
        (place / name).parent.mkdir(exist_ok=True)
        (place / name).write_text(f"{number}" * 2000, encoding="utf-8")
    listed = {"schema": "rotorid.set/1", "number": number, "files": ["a.txt"]}
    (place / "set.json").write_text(json.dumps(listed), encoding="utf-8")


def listed(document: Any) -> dict[str, str | None]:
    return dict.fromkeys(document["files"])


LISTED = ResultKind(mains=("set.json",), schema="rotorid.set/", files=("b.txt", "pictures/*"), listed=listed)


def write(folder: Path, number: int, *, force: bool = False, numbered: bool = False) -> Path:
    target = target_folder(None if numbered else folder, folder, LISTED, force=force)
    with making(target) as made:
        fill(made.place, number)
    return made.folder


if __name__ == "__main__":
    place, current = Path(sys.argv[1]), int(sys.argv[2])
    print("ready", flush=True)
    while True:
        write(place, current)
        current += 2
