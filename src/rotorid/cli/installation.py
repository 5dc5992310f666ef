"""Whether this installation works, and what to do if not.

Only Python's own modules are imported here; each check imports what it tests.
"""

from __future__ import annotations

import json as json_text
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from importlib import import_module, metadata
from pathlib import Path
from typing import Literal, TypeAlias

from rotorid import __version__
from rotorid.data.quantity import with_error

SCHEMA = "rotorid.doctor/1"

State: TypeAlias = Literal["ok", "missing", "broken"]

OLDEST, NEWEST = (3, 11), (3, 14)
"""Versions of Python that rotorid is tested with."""

CORE = ("numpy", "scipy", "numba", "pydantic", "typer", "rich", "jinja2")
EXTRAS: Mapping[str, tuple[str, ...]] = {
    "figures": ("matplotlib",),
    "parquet": ("pyarrow",),
    "hdf5": ("h5py",),
    "search": ("cmaes",),
    "control": ("control",),
    "export": ("control", "mujoco", "fmpy"),
    "ros": ("rosbags", "lz4", "zstandard"),
    "lab": ("fastapi", "uvicorn"),
    "mcp": ("mcp",),
    "cluster": ("dask", "distributed", "fsspec", "pyarrow"),
    "docs": ("sphinx", "furo", "myst_nb", "latex2mathml"),
}
"""Extra to the modules that it brings."""

_GIB = 1 << 30
_LEAST_MEMORY_B, _LEAST_ROOM_B = 2 * _GIB, _GIB

_PATIENCE_S = 300.0
"""Time that the self test has."""

_TOO_FAR = 4.0
"""Standard deviations from the truth at which the self test fails."""


@dataclass(frozen=True, kw_only=True)
class Check:
    """Result of a check, and what to do.

    Parameters
    ----------
    state
        ``missing`` is optional, ``broken`` is not.
    said
        What was found.
    remedy
        What to do about it.
    """

    group: str
    name: str
    state: State
    said: str
    remedy: str = ""


def examine(*, self_test: bool = True, json: bool = False, verbose: bool = False) -> bool:
    """Run and print all checks, and return whether nothing is broken.

    Parameters
    ----------
    self_test
        Whether to simulate and identify a flight.
    json
        Whether to print JSON instead of lines.
    verbose
        Whether to print every check, instead of those that need attention and a line for the others of a group.
    """
    checks: list[Check] = []
    for look in (_python, _core, _extras, _machine, _cache, _settings, _sandbox, *((_self_test,) if self_test else ())):
        found = _without_fail(look)
        checks += found
        if not json:
            _print(found if verbose else _gathered(found))
    healthy = all(check.state != "broken" for check in checks)
    if json:
        document = {"schema": SCHEMA, "sound": healthy, "checks": [asdict(check) for check in checks]}
        sys.stdout.write(json_text.dumps(document, indent=2) + "\n")
    else:
        print("This installation is sound." if healthy else "This installation is broken: fix what is marked BROKEN.")
    return healthy


def _without_fail(look: Callable[[], list[Check]]) -> list[Check]:
    try:
        return look()
    # Whatever is broken in an installation may raise anything; that is what is being looked for.
    except Exception as error:
        name = look.__name__.strip("_").replace("_", " ")
        return [Check(group=name, name=name, state="broken", said=_sentence(error), remedy=_REINSTALL)]


_REINSTALL = "pip install --force-reinstall rotorid"


def _sentence(error: BaseException) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"


def _gathered(checks: list[Check]) -> list[Check]:
    """What needs attention, and one line for all other checks of a group."""
    fine: dict[str, list[Check]] = {}
    for check in checks:
        if check.state == "ok":
            fine.setdefault(check.group, []).append(check)
    lines = [
        same[0] if len(same) == 1 else Check(group=group, name=f"{len(same)} checks", state="ok", said=_names(same))
        for group, same in fine.items()
    ]
    return [*lines, *(check for check in checks if check.state != "ok")]


def _names(checks: list[Check]) -> str:
    """The checks of one group in a line, with what was found where that is short."""
    long = {"extra", "sandbox"}
    return ", ".join(check.name if check.group in long else f"{check.name} {check.said}" for check in checks)


def _print(checks: list[Check]) -> None:
    for check in checks:
        mark = {"ok": "ok     ", "missing": "missing", "broken": "BROKEN "}[check.state]
        print(f"{mark}  {check.group:10} {check.name:12} {check.said}".rstrip())
        if check.remedy:
            print(f"{'':9}{'':11}{'':12} {check.remedy}")
    sys.stdout.flush()


def _python() -> list[Check]:
    version = platform.python_version()
    known = OLDEST <= sys.version_info[:2] <= NEWEST
    asked = f"Python {'.'.join(map(str, OLDEST))} to {'.'.join(map(str, NEWEST))}"
    return [
        Check(group="version", name="rotorid", state="ok", said=__version__),
        Check(
            group="version",
            name="python",
            state="ok" if known else "broken",
            said=f"{version} on {platform.system()} {platform.machine()}",
            remedy="" if known else f"rotorid is tested with {asked}",
        ),
    ]


def _core() -> list[Check]:
    return [_module(name) for name in CORE]


def _module(name: str) -> Check:
    """A library that rotorid cannot do without, imported."""
    try:
        import_module(name)
        return Check(group="library", name=name, state="ok", said=metadata.version(name))
    # A broken library may raise anything while it is imported.
    except Exception as error:
        remedy = f"pip install --force-reinstall {name}"
        return Check(group="library", name=name, state="broken", said=_sentence(error), remedy=remedy)


def _extras() -> list[Check]:
    found = []
    for extra, modules in EXTRAS.items():
        wrong = {name: why for name in modules if (why := _why_not(name))}
        # A library that is there and does not load is as good as none: what needs it says so by itself.
        found.append(
            Check(
                group="extra",
                name=extra,
                state="missing" if wrong else "ok",
                said="; ".join(f"{name} {why}" for name, why in wrong.items()) or ", ".join(map(_named, modules)),
                remedy=f"pip install 'rotorid[{extra}]'" if wrong else "",
            )
        )
    return found


def _why_not(module: str) -> str:
    """Why a module is not available; it is not imported, as some take seconds."""
    from importlib.util import find_spec

    if find_spec(module) is None:
        return "is not installed"
    try:
        metadata.version(module)
    except metadata.PackageNotFoundError:
        return "is there without its version"
    return ""


def _named(module: str) -> str:
    return f"{module} {metadata.version(module)}"


def _machine() -> list[Check]:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    checks = [Check(group="machine", name="cores", state="ok", said=str(cores))]
    memory = _memory_b()
    if memory is not None:
        enough = memory >= _LEAST_MEMORY_B
        remedy = "" if enough else "close other programs: logs above 100 MB and motor models need 2 GiB"
        answer = f"{memory / _GIB:.1f} GiB free"
        checks.append(
            Check(group="machine", name="memory", state="ok" if enough else "missing", said=answer, remedy=remedy)
        )
    place = Path(tempfile.gettempdir())
    room = shutil.disk_usage(place).free
    enough = room >= _LEAST_ROOM_B
    remedy = "" if enough else "free some space, or set TMPDIR to another folder: compressed logs are unpacked there"
    answer = f"{room / _GIB:.1f} GiB free in {place}"
    with tempfile.TemporaryFile() as file:
        file.write(b"rotorid")
    checks.append(
        Check(group="machine", name="temporary", state="ok" if enough else "missing", said=answer, remedy=remedy)
    )
    return [*checks, _browser()]


def _browser() -> Check:
    """What prints pages for ``--pdf``."""
    from rotorid.errors import UsageError
    from rotorid.report.printing import require_browser

    try:
        return Check(group="machine", name="browser", state="ok", said=require_browser())
    except UsageError:
        remedy = "install Chromium, Chrome or Edge for --pdf, or print pages from your own browser"
        return Check(group="machine", name="browser", state="missing", said="none for --pdf", remedy=remedy)


def _memory_b() -> int | None:
    """Available memory in bytes; ``None`` if the system does not report it."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        return next(int(line.split()[1]) << 10 for line in lines if line.startswith("MemAvailable"))
    except (OSError, ValueError, StopIteration):
        return None


def _cache() -> list[Check]:
    """Where compiled code is kept: without such a place every command compiles anew, for a minute."""
    from rotorid.compiling import kept_in

    places = kept_in()
    for place in places:
        there = next((path for path in (place, *place.parents) if path.exists()), place)
        if os.access(there, os.W_OK):
            return [Check(group="cache", name="compiled", state="ok", said=str(place))]
    remedy = "set NUMBA_CACHE_DIR to a writable folder"
    answer = f"{' and '.join(map(str, places))} cannot be written, so each command compiles again"
    return [Check(group="cache", name="compiled", state="missing", said=answer, remedy=remedy)]


_PROTECTIONS: Mapping[str, str] = {
    "limits": "memory, time and size of files are limited",
    "parent": "a reader ends with the command",
    "no_new_privileges": "a reader gains no rights",
    "files": "a reader sees only the log",
    "network": "a reader has no network",
    "processes": "a reader starts no programs",
}


def _settings() -> list[Check]:
    """The file of preferences, where there is one."""
    from rotorid.cli.preferences import Preferences, place, preferences
    from rotorid.errors import UsageError

    file = place()
    try:
        answer = "none" if preferences() == Preferences() else str(file)
    except UsageError as error:
        remedy = f"correct or remove {file}"
        return [Check(group="settings", name="preferences", state="broken", said=str(error), remedy=remedy)]
    return [Check(group="settings", name="preferences", state="ok", said=answer)]


def _sandbox() -> list[Check]:
    from rotorid.io.sandbox import protections

    missing = "not available on this system: only read .mat, ROS bag and Parquet files that you trust"
    return [
        Check(
            group="sandbox",
            name=name.removeprefix("no_new_"),
            state="ok" if active else "missing",
            said=_PROTECTIONS.get(name, ""),
            remedy="" if active else missing,
        )
        for name, active in protections().items()
    ]


def _self_test() -> list[Check]:
    """A flight made, written, read and identified, in a process of its own: a library that crashes ends that one."""
    started_s = time.monotonic()
    child = subprocess.run(
        [sys.executable, "-c", "from rotorid.flying.self_test import main; main()"],
        capture_output=True,
        text=True,
        timeout=_PATIENCE_S,
        check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(entry for entry in sys.path if entry)},
    )
    seconds = time.monotonic() - started_s
    if child.returncode != 0:
        last = (child.stderr.strip().splitlines() or ["no message"])[-1]
        answer = f"ended with code {child.returncode}: {last[:200]}"
        return [Check(group="self test", name="identify", state="broken", said=answer, remedy=_REINSTALL)]
    found = json_text.loads(child.stdout.strip().splitlines()[-1])
    wrong = {name: estimate for name, estimate in found.items() if not abs(estimate["off"]) <= _TOO_FAR}
    answer = ", ".join(
        f"{name} {with_error(estimate['value'], estimate['std'])} {estimate['unit']} (true {estimate['truth']:.4g})"
        for name, estimate in found.items()
    )
    remedy = "please report this output" if wrong else ""
    return [
        Check(
            group="self test",
            name="identify",
            state="broken" if wrong else "ok",
            said=f"{answer} in {seconds:.0f} s",
            remedy=remedy,
        )
    ]
