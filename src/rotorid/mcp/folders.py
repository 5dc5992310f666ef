"""The folders that a user named at start: the only places that a call may name.

A call names a place by its path inside a folder, with the label of the folder in front where there are several. A path
that leaves the folders is refused before anything is opened, also behind a link, and whether it exists is not answered.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from rotorid.data.display import cut
from rotorid.errors import UsageError, listed
from rotorid.letters import visible

MOST_ENTRIES, MOST_DEPTH = 20_000, 6
"""Files and folders that a list looks at, and how deep it looks."""

MAINS = {
    "review.json": "review",
    "result.json": "identify",
    "results.json": "identify",
    "verification.json": "verify",
    "tune.json": "tune",
    "export.json": "export",
}
"""The file that makes a folder a result, and the tool that wrote it."""

Kind: TypeAlias = Literal["file", "folder", "any"]


@dataclass(frozen=True)
class Folders:
    """Folders that may be read, and the one below which results are written.

    Parameters
    ----------
    roots
        The folders by label, without links in their paths.
    out
        Where results go.
    taken
        Folders there that calls which still run will write.

    Raises
    ------
    UsageError
        A path leaves the folders, in each method that takes one.
    """

    roots: dict[str, Path]
    out: Path
    taken: frozenset[Path] = frozenset()

    def find(self, name: str, kind: Kind = "any") -> Path:
        """The place that a call names, with its links resolved.

        Parameters
        ----------
        name
            A path inside the folders, or an absolute one that leads there.
        kind
            What must be there.
        """
        given = self._candidate(name)
        try:
            real = given.resolve()
        except (OSError, RuntimeError, ValueError):
            raise self._outside(name) from None
        self._require_inside(real, name)
        # Of a name that no file system takes these say no, where those of a path raise.
        is_file, is_folder = os.path.isfile(real), os.path.isdir(real)  # noqa: PTH112, PTH113
        if not {"file": is_file, "folder": is_folder, "any": is_file or is_folder}[kind]:
            what = "file or folder" if kind == "any" else kind
            raise UsageError(f"there is no {what} {_shown(name)}", remedy="the tool files lists what there is")
        return real

    def new(self, name: str) -> Path:
        """The folder of results of a name, which may not exist yet; a link leads to no other place."""
        real = (self.out / name).resolve()
        if not real.is_relative_to(self.out):
            raise self._outside(name)
        return real

    def is_free(self, place: Path) -> bool:
        """Whether nothing is at a place for results, and no call will write there."""
        return place not in self.taken and not place.exists()

    def name_of(self, path: Path) -> str:
        """A place as calls name it."""
        for label, root in self.roots.items():
            if path.is_relative_to(root):
                inside = path.relative_to(root).as_posix()
                return visible(inside if len(self.roots) == 1 else f"{label}/{inside}")
        return visible(path.name)

    def entries(self) -> Iterator[Path]:
        """Visible files and folders of all folders, in the order of their names; links are not among them."""
        left = MOST_ENTRIES
        for root in self.roots.values():
            level = [root]
            for _ in range(MOST_DEPTH):
                below: list[Path] = []
                for folder in level:
                    for entry in _visible(folder):
                        left -= 1
                        if left < 0:
                            return
                        path = Path(entry.path)
                        below += [path] if entry.is_dir(follow_symlinks=False) else []
                        yield path
                level = below

    def _candidate(self, name: str) -> Path:
        path = Path(name)
        if path.is_absolute():
            return path
        if len(self.roots) == 1:
            return next(iter(self.roots.values())) / path
        label, _, rest = name.partition("/")
        if label not in self.roots:
            raise UsageError(
                f"{_shown(name)} does not begin with a folder", needed=listed([f"{label}/" for label in self.roots])
            )
        return self.roots[label] / rest

    def _require_inside(self, real: Path, name: str) -> None:
        inside = [real.relative_to(root) for root in self.roots.values() if real.is_relative_to(root)]
        if all(_is_hidden(path) for path in inside):
            raise self._outside(name)

    def _outside(self, name: str) -> UsageError:
        return UsageError(
            f"{_shown(name)} is outside the folders named at start",
            needed=f"a visible path inside {listed([*self.roots])}, not behind a link that leads out",
        )


def named_folders(given: Sequence[Path], out: Path | None = None) -> Folders:
    """The folders of a server.

    Parameters
    ----------
    given
        Folders that may be read.
    out
        Where results go, inside one of them; ``rotorid-out`` in the first by default.

    Raises
    ------
    UsageError
        One is no folder, or results would go elsewhere.
    """
    roots: dict[str, Path] = {}
    for folder in given:
        if not folder.is_dir():
            raise UsageError(f"there is no folder {visible(str(folder))}", remedy="name a folder of logs")
        real = folder.resolve()
        if real in roots.values():
            continue
        label = name = visible(real.name) or "root"
        number = 2
        while label in roots:
            label, number = f"{name}-{number}", number + 1
        roots[label] = real
    if not roots:
        raise UsageError("no folder was named", remedy="rotorid mcp FOLDER")
    place = (next(iter(roots.values())) / "rotorid-out" if out is None else out).resolve()
    if not any(place.is_relative_to(root) for root in roots.values()):
        raise UsageError(
            f"--out {visible(str(out or place))} is outside the named folders", remedy="name its folder too"
        )
    if all(_is_hidden(place.relative_to(root)) for root in roots.values() if place.is_relative_to(root)):
        raise UsageError(f"--out {visible(str(out))} is hidden", needed="a folder that the tools can read again")
    return Folders(roots, place)


def _is_hidden(inside: Path) -> bool:
    return any(part.startswith(".") for part in inside.parts)


def _shown(name: str) -> str:
    """What a call named, in quotes."""
    return repr(cut(visible(name), 100))


def _visible(folder: Path) -> list[os.DirEntry[str]]:
    try:
        with os.scandir(folder) as entries:
            found = [entry for entry in entries if not entry.name.startswith(".") and not entry.is_symlink()]
    except OSError:
        return []
    return sorted(found, key=lambda entry: entry.name)
