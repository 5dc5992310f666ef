"""What all tests share: where the flight data are, and how they are unpacked."""

from __future__ import annotations

import gc
import json
import lzma
import os
from collections.abc import Callable, Generator, Iterator
from pathlib import Path

import pytest
from _pytest.doctest import DoctestItem, DoctestModule
from tests.flights_read_once import ReadOnce, reads_anew

# No test looks as somebody prefers it.
os.environ["ROTORID_SETTINGS"] = ""
# A fault in one part of an answer does not end the others for users; tests must see it.
os.environ["ROTORID_STRICT"] = "1"

# What collecting the tests makes stays until the end: no search for garbage goes through it.
gc.disable()

HERE = Path(__file__).resolve().parent

LONG_S = 10.0
"""Files whose tests take longer begin first, so that no worker waits at the end for a long one."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int | None:
    """One worker more than processors: while a test waits for a browser or another process, one computes."""
    return None if "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ else (os.cpu_count() or 1) + 1


@pytest.hookimpl(wrapper=True)
def pytest_collect_file(file_path: Path) -> Generator[None, list[pytest.Collector], list[pytest.Collector]]:
    """Search files for examples only where some are: of a thousand test files few have any."""
    found = yield
    return found if b">>>" in file_path.read_bytes() else [one for one in found if not isinstance(one, DoctestModule)]


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put tests that share a browser in a row, then the files with the longest tests, by the table of durations.

    What the package offers has its examples where it is defined, and only there the names that they use.
    """
    offered = HERE.parent / "src" / "rotorid" / "__init__.py"
    items[:] = [
        item for item in items if not (isinstance(item, DoctestItem) and item.path == offered and "." in item.name)
    ]
    known = json.loads((HERE / "durations.json").read_text(encoding="utf-8"))
    took_s = {HERE.parent / name: seconds for name, seconds in known.items() if seconds > LONG_S}
    items.sort(key=lambda item: (HERE / "browser" not in item.path.parents, -took_s.get(item.path, 0.0)))


@pytest.hookimpl(trylast=True)
def pytest_collection_finish(session: pytest.Session) -> None:
    gc.collect()
    gc.freeze()
    gc.enable()


DATA = Path(os.environ.get("ROTORID_DATA", HERE.parent.parent / "shared" / "data"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the real and simulated flights, or a skip with the reason."""
    if not DATA.is_dir():
        pytest.skip(f"no flight data at {DATA}; set ROTORID_DATA to their folder")
    return DATA


@pytest.fixture(scope="session")
def unpacked_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where all workers find what was unpacked."""
    base = tmp_path_factory.getbasetemp()
    return (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "unpacked"


@pytest.fixture(scope="session")
def unpacked(shared_data: Path, unpacked_folder: Path) -> Callable[[str], Path]:
    """Path of a data file, unpacked once for all workers when it is an ``.xz``."""

    def path_of(name: str) -> Path:
        source = shared_data / name
        if source.suffix != ".xz":
            return source
        target = unpacked_folder / source.relative_to(shared_data).with_suffix("")
        if not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            # Another worker may want it at the same time, and finds a whole file or none.
            part = target.with_name(f"{target.name}.{os.getpid()}")
            part.write_bytes(lzma.decompress(source.read_bytes()))
            part.rename(target)
        return target

    return path_of


@pytest.fixture(scope="session")
def read_once(unpacked_folder: Path) -> ReadOnce:
    from rotorid.io import registry

    return ReadOnce(registry._read, [DATA, unpacked_folder])


@pytest.fixture(scope="module", autouse=True)
def flights_are_read_once(request: pytest.FixtureRequest, read_once: ReadOnce) -> Iterator[None]:
    """The same record each time a flight of the data folder is read, except in tests of the readers."""
    with pytest.MonkeyPatch.context() as patch:
        if not reads_anew(request.path, HERE.parent):
            patch.setattr("rotorid.io.registry._read", read_once)
        yield
