"""The recursion that arrays cannot express. Importing this module imports Numba: do it inside a function."""

from __future__ import annotations

from numba import njit

from rotorid.typing import FloatArray


@njit(cache=True)
def run_sections(sections: FloatArray, values: FloatArray, memory: FloatArray) -> None:
    """Run channels through sections of second order, one after the other, in place; transposed direct form II.

    ``sections`` has rows ``b0 b1 b2 1 a1 a2``; ``values`` are of shape ``(channels, samples)`` and ``memory``, which
    is changed as well, of shape ``(channels, sections, 2)``.
    """
    for channel in range(values.shape[0]):
        for sample in range(values.shape[1]):
            given = values[channel, sample]
            for section in range(sections.shape[0]):
                answer = sections[section, 0] * given + memory[channel, section, 0]
                memory[channel, section, 0] = (
                    sections[section, 1] * given - sections[section, 4] * answer + memory[channel, section, 1]
                )
                memory[channel, section, 1] = sections[section, 2] * given - sections[section, 5] * answer
                given = answer
            values[channel, sample] = given
