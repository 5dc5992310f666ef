"""The child of `rotorid.io.sandbox`: limits itself, runs one parser, writes arrays and JSON, ends.

Run as ``python -m rotorid.io.sandbox_worker FOLDER``; the folder holds ``job.json`` and receives ``arrays.npz`` and
``answer.json``.
"""

from __future__ import annotations

import errno
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.errors import LogError
from rotorid.io.confinement import confine
from rotorid.io.sandbox import PROTECTIONS, extract_here


def main(folder: Path) -> None:
    """Do the job of the folder and leave the answer there."""
    job = json.loads((folder / "job.json").read_text(encoding="utf-8"))
    path = Path(job["path"])
    active = confine(readable=[path], writable=folder, limits=job["limits"], parent=job["parent"])
    answer = {"names": [], "facts": active} if job["parser"] == PROTECTIONS else _answer(job, folder)
    (folder / "answer.json").write_text(json.dumps(answer), encoding="utf-8")


def _answer(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    try:
        found = extract_here(job["parser"], Path(job["path"]), job["options"])
        if any(array.dtype.hasobject for array in found.arrays.values()):
            raise TypeError("an array contains Python objects, which are not read")
        np.savez(folder / "arrays.npz", **{f"a{index}": array for index, array in enumerate(found.arrays.values())})  # type: ignore[arg-type]
    except LogError as error:
        return {"refused": {"came": error.came, "needed": error.needed, "remedy": error.remedy}}
    except MemoryError:
        return {"failure": f"it asked for more than {job['limits']['RLIMIT_AS'] >> 20} MiB of memory", "full": True}
    except RecursionError:
        return {"failure": "its definitions are nested without end"}
    except OSError as error:
        if error.errno in (errno.EFBIG, errno.ENOSPC, errno.EDQUOT):
            return {"failure": f"its arrays could not be put down ({error.strerror})", "full": True}
        return {"failure": f"the parser refused it ({type(error).__name__}: {str(error)[:200]})"}
    # A foreign parser may raise anything at all; here, at the border, all of it means that the file is unreadable.
    except Exception as error:
        return {"failure": f"the parser refused it ({type(error).__name__}: {str(error)[:200]})"}
    return {"names": list(found.arrays), "facts": dict(found.facts)}


if __name__ == "__main__":
    main(Path(sys.argv[1]))
