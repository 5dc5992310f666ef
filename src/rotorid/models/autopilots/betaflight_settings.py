"""Names of Betaflight's settings: those of a log's header and those of its command line, which differ and were changed.

References
----------
``src/main/cli/settings.c`` and ``src/main/blackbox/blackbox.c`` of betaflight/betaflight, 4.0 to 2025.12.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from rotorid.autopilots.firmware import Version

LOW_PASSES = ("PT1", "BIQUAD", "PT2", "PT3")
"""Words of the command line for the types of a low-pass, which headers have as numbers."""

NAMED_BY_NUMBER: Version = (4, 3)
"""From this version on low-passes are lpf1 and lpf2, and may be of the last two types."""

_ANGLE_P_SINCE: Version = (4, 5)
_ENDS, _NOTCHES = ("min", "max"), (1, 2)

COMMAND_LINE: Mapping[str, str] = MappingProxyType(
    {
        "dterm_filter_type": "dterm_lowpass_type",
        "dterm_filter2_type": "dterm_lowpass2_type",
        "gyro_soft_type": "gyro_lowpass_type",
        "gyro_soft2_type": "gyro_lowpass2_type",
        **{f"dterm_lowpass_dyn_hz_{k}": f"dyn_lpf_dterm_{end}_hz" for k, end in enumerate(_ENDS)},
        **{f"gyro_lowpass_dyn_hz_{k}": f"dyn_lpf_gyro_{end}_hz" for k, end in enumerate(_ENDS)},
        **{
            f"{of}_lpf1_dyn_hz_{k}": f"{of}_lpf1_dyn_{end}_hz"
            for of in ("dterm", "gyro")
            for k, end in enumerate(_ENDS)
        },
        **{
            f"gyro_notch_{what}_{k}": f"gyro_notch{n}_{what}"
            for what in ("hz", "cutoff")
            for k, n in enumerate(_NOTCHES)
        },
    }
)
"""Filter in a header to its name at the command line, where the two differ. A header's names show its version."""

_HEADER: Mapping[str, str] = MappingProxyType(
    {
        **{shown: name for name, shown in COMMAND_LINE.items() if not name.startswith("gyro_soft")},
        # As results had them once.
        **{f"dterm_lowpass_dyn_{end}_hz": f"dterm_lowpass_dyn_hz_{k}" for k, end in enumerate(_ENDS)},
    }
)

MOVING_GYRO = tuple(f"gyro_{prefix}_dyn_hz_{k}" for prefix in ("lpf1", "lowpass") for k in range(2))
"""A low-pass of the gyro whose cutoff follows the throttle, in a header."""


def command_line_name(name: str) -> str:
    """The command line's name of a filter in a header.

    Examples
    --------
    >>> [command_line_name(name) for name in ("gyro_notch_hz_0", "dterm_filter_type", "dterm_notch_hz")]
    ['gyro_notch1_hz', 'dterm_lowpass_type', 'dterm_notch_hz']
    """
    return COMMAND_LINE.get(name, name)


def header_name(name: str) -> str:
    """The header's name of a filter, by that of the command line or its own.

    Examples
    --------
    >>> header_name("gyro_lpf1_dyn_min_hz"), header_name("gyro_lpf1_dyn_hz_0")
    ('gyro_lpf1_dyn_hz_0', 'gyro_lpf1_dyn_hz_0')
    """
    return _HEADER.get(name, name)


def angle_name(version: Version) -> str:
    """The command line's name of the angle gain."""
    return "angle_p_gain" if version >= _ANGLE_P_SINCE else "angle_level_strength"


def is_type(name: str) -> bool:
    """Whether a setting is the type of a low-pass, by either of its names."""
    return name.startswith(("gyro_", "dterm_")) and name.endswith("_type")


def types_of(version: Version) -> tuple[str, ...]:
    """Types of a low-pass that a version has."""
    return LOW_PASSES if version >= NAMED_BY_NUMBER else LOW_PASSES[:2]
