"""Compilation of kernels that make no arrays. Importing this module imports Numba."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

Kernel = TypeVar("Kernel", bound=Callable[..., object])


def bare(**options: Any) -> Callable[[Kernel], Kernel]:
    """Compile a kernel without the counting of references.

    Numba counts who holds an array wherever a kernel takes a row or a field, with instructions that lock the bus: in
    the loop of a flight that was a third of the time. A kernel that makes no array needs none of it, and Numba refuses
    to compile one that does. The option has no public name; Numba's own sorting is compiled so.

    Parameters
    ----------
    options
        More for ``njit``, such as ``forceinline`` and ``fastmath``.
    """
    untyped: Any = njit
    compiled: Callable[[Kernel], Kernel] = untyped(cache=True, nogil=True, error_model="numpy", _nrt=False, **options)
    return compiled
