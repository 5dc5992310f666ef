"""Files written whole or not at all, and the hash that names a file's content."""

from __future__ import annotations

import hashlib
import io
import secrets
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from rotorid.errors import UsageError
from rotorid.typing import AnyArray


def write_atomically(path: Path, data: bytes | str) -> None:
    """Write a file so that a reader sees the old content or the new one, never a part.

    The data go to a temporary name in the same folder, which then replaces ``path`` in one step. Missing folders are
    made.

    Parameters
    ----------
    path
        File to write or replace.
    data
        Content; text is encoded as UTF-8.

    Raises
    ------
    UsageError
        The place cannot be written.
    """
    content = data.encode("utf-8") if isinstance(data, str) else data
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with temporary.open("xb") as file:
                file.write(content)
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise UsageError(
            f"{path} cannot be written: {error.strerror or error}",
            needed="a folder with space that this user may write to",
            remedy="choose another place",
        ) from error


def write_npz(path: Path, arrays: Mapping[str, AnyArray]) -> None:
    """Write named arrays as a compressed ``.npz`` without pickles, atomically.

    Parameters
    ----------
    path
        File to write or replace.
    arrays
        Name to array of numbers or of text; an array of Python objects is refused.

    Raises
    ------
    UsageError
        The place cannot be written.
    ValueError
        An array holds Python objects.
    """
    pickled = [name for name, array in arrays.items() if np.asarray(array).dtype.hasobject]
    if pickled:
        raise ValueError(f"arrays of Python objects cannot be stored: {', '.join(pickled)}")
    buffer = io.BytesIO()
    # Not numpy.savez: it takes names for its own keywords, and stamps the file with the hour, so that equal results
    # would differ.
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.lib.format.write_array(member, np.asarray(array), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), member.getvalue(), zipfile.ZIP_DEFLATED)
    write_atomically(path, buffer.getvalue())


def sha256_of(path: Path) -> str:
    """SHA-256 of a file's content, as hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
