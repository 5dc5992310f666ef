"""Controllers from a file, for logs without the gains."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from rotorid.data.axes import RATE_OF
from rotorid.data.base import Immutable
from rotorid.errors import ModelError, UsageError
from rotorid.io.documents import DocumentError, parse_toml, read_text
from rotorid.models.controller import FILTERS, RateController
from rotorid.models.toml_source import Source
from rotorid.typing import Axis


@dataclass(frozen=True, kw_only=True)
class GivenController(Immutable):
    """A controller from a file.

    Parameters
    ----------
    controller
        Gains and filters.
    setpoint
        Channel that drives it; empty for the outermost set-point that is logged and explains the command.
    """

    controller: RateController
    setpoint: str = ""

    def __str__(self) -> str:
        numbers = ((item.name, getattr(self.controller, item.name)) for item in fields(self.controller))
        arguments = [f"{name}={value!r}" for name, value in numbers if value]
        return " ".join([*arguments, *([f"setpoint={self.setpoint}"] if self.setpoint else [])])


def read_controllers(path: Path) -> dict[Axis, GivenController]:
    """Read the controllers of a TOML file, one table for each axis.

    ::

        [pitch]
        proportional_s = 0.15
        integral = 0.2
        angle_1_s = 6.0
        setpoint = "theta_setpoint"

    Parameters
    ----------
    path
        The file. Its fields are those of :class:`rotorid.models.controller.RateController`, and ``setpoint``.

    Raises
    ------
    UsageError
        The file cannot be read, is not TOML, or has wrong values; the message names the line.
    """
    text = read_text(path, needed="a TOML file with gains")
    try:
        table = parse_toml(text)
    except DocumentError as error:
        raise UsageError(
            f"{path.name} is not valid TOML: {error}", needed="[pitch] and proportional_s = 0.15"
        ) from error
    source = Source(text=text, where=path.name)
    try:
        found = {
            _axis(name, source): _given(source.table(value, (name,)), name, source) for name, value in table.items()
        }
    except ModelError as error:
        raise UsageError(error.came, needed=error.needed, remedy=error.remedy) from None
    if not found:
        raise UsageError(f"no controller in {path.name}", needed=f"a table [{'], ['.join(RATE_OF)}]")
    return found


def _axis(name: str, source: Source) -> Axis:
    if name not in RATE_OF:
        raise source.unknown("axis", name, RATE_OF, (name,))
    return name  # type: ignore[return-value]


def _given(table: Mapping[str, Any], axis: str, source: Source) -> GivenController:
    known = [item.name for item in fields(RateController) if item.name not in FILTERS]
    values: dict[str, Any] = {}
    for name, value in table.items():
        if name not in (*known, "setpoint"):
            raise source.unknown("field of a controller", name, (*known, "setpoint"), (axis, name))
        if name in ("derivative_of_error", "late_integral", "late_angle"):
            if not isinstance(value, bool):
                raise source.error((axis, name), f"{name} is {value!r}", needed="true or false")
            values[name] = value
        elif name != "setpoint":
            values[name] = source.number(value, (axis, name))
    if "proportional_s" not in values:
        raise source.error((axis,), f"[{axis}] lacks proportional_s", needed="the gain on the rate")
    try:
        controller = RateController(**values)
    except UsageError as error:
        raise source.error((axis,), error.came, needed=error.needed) from None
    return GivenController(
        controller=controller, setpoint=source.text_of(table.get("setpoint", ""), (axis, "setpoint"))
    )
