"""What a log says about places and serial numbers, and no record keeps: results are passed on, homes are not.

Channels are relative by their names: `north`, `east` and `down` count from the origin of the autopilot's estimator. Its
parameters, though, may hold a home, a simulator's launch site, the declination there, or the number of a board.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

_PLACE = re.compile(
    r"(^|_)(LAT|LON|LNG|LATITUDE|LONGITUDE|OPOS|ORIG|ORIGIN|HOME)\d*(_|$)"
    r"|(^|_)MAG_DECL(_|$)|^COMPASS_DEC$|^SIH_LOC_|^BCN_ALT$"
)
_OWNER = re.compile(r"(^|_)(SERIAL_NUM|UUID)(_|$)")


def without_places(parameters: Mapping[str, float]) -> dict[str, float]:
    """The parameters that say neither where on Earth the flight was, nor which board flew.

    Parameters
    ----------
    parameters
        Name to value, as any autopilot names them.

    Examples
    --------
    >>> without_places({"SIH_LOC_LAT0": 47.4, "SIM_OPOS_LNG": 149.2, "BRD_SERIAL_NUM": 7.0, "MOT_THST_EXPO": 0.65})
    {'MOT_THST_EXPO': 0.65}
    """
    return {name: value for name, value in parameters.items() if not _PLACE.search(name) and not _OWNER.search(name)}
