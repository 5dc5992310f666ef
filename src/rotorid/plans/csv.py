"""The test inputs of a plan as one table over time, and how the text files of a plan are written.

:func:`plan_csv` makes the table. Scripts and parameter files of the autopilots are made from templates
(:func:`filled`), with numbers of single precision and names from elsewhere made safe.
"""

from __future__ import annotations

import math
import re
from importlib.resources import files
from typing import Any

import numpy as np

from rotorid.data.flight_plan import FlightPlan
from rotorid.plans.facts import column_name
from rotorid.typing import FloatArray

FILE = "plan.csv"


def plan_csv(plan: FlightPlan) -> dict[str, str]:
    """A CSV file with a column of time and one for each place where test inputs are added.

    Inputs that enter at the same place add up; everything is zero in between. The table spans the whole plan, with the
    last rest, at the fastest rate of the inputs.

    Returns
    -------
    dict[str, str]
        File name to text. Time in s from the beginning of the plan; columns in SI units, named in the header as
        ``roll_excitation [1]`` or ``pitch_rate_setpoint [rad/s]``. Seven significant digits.

    Examples
    --------
    >>> from rotorid.data.flight_plan import PlannedInput
    >>> step = PlannedInput(axis="roll", shape="doublet", start_s=0.5, values=[0.1, -0.1], sample_rate_hz=2.0,
    ...                     amplitude=0.1)
    >>> print(plan_csv(FlightPlan(name="short", inputs=(step,), trim_s=0.5))["plan.csv"], end="")
    time [s],roll_excitation [1]
    0,0
    0.5,0.1
    1,-0.1
    1.5,0
    """
    time_s, columns = table(plan)
    units = {column_name(planned): planned.unit for planned in plan.inputs}
    header = ",".join(["time [s]", *(f"{name} [{units[name]}]" for name in columns)])
    row = ",".join(["%.10g", *["%.7g"] * len(columns)])
    values = zip(time_s.tolist(), *(samples.tolist() for samples in columns.values()), strict=True)
    return {FILE: "\n".join([header, *(row % cells for cells in values), ""])}


def table(plan: FlightPlan, *, sample_rate_hz: float | None = None) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Time, shape ``(rows,)``, and the sum of the inputs at each place, each of that shape; see :func:`plan_csv`."""
    rate_hz = sample_rate_hz or max(planned.sample_rate_hz for planned in plan.inputs)
    # A row more than a rounding below the end is a row that is flown.
    time_s = np.arange(int(np.ceil(plan.duration_s * rate_hz - 1e-6))) / rate_hz
    columns: dict[str, FloatArray] = {}
    for planned in plan.inputs:
        name = column_name(planned)
        columns[name] = columns.get(name, np.zeros(time_s.size)) + planned.at(time_s)
    return time_s, columns


def filled(template: str, **values: Any) -> str:
    """A template filled with values; a value that is missing is an error.

    Parameters
    ----------
    template
        Name of a file among the templates.
    values
        What it shows.
    """
    import jinja2

    environment = jinja2.Environment(
        autoescape=False,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.from_string(
        files("rotorid.plans").joinpath("templates", template).read_text(encoding="utf-8")
    ).render(**values)


def number(value: float) -> str:
    """A number that keeps all digits of a single-precision parameter, without an exponent where it is readable.

    Examples
    --------
    >>> number(0.15), number(60.0), number(1.0 / 3.0)
    ('0.15', '60', '0.333333333')
    """
    return f"{value:.9g}"


def number_above(value: float) -> str:
    """The least number of four digits that a magnitude does not exceed.

    Examples
    --------
    >>> number_above(145.069853), number_above(0.05), number_above(0.0)
    ('145.1', '0.05', '0')
    """
    if not value:
        return "0"
    step = 10.0 ** (math.floor(math.log10(abs(value))) - 3)
    return f"{math.ceil(abs(value) / step - 1e-6) * step:.4g}"


def one_line(text: str) -> str:
    r"""Text from elsewhere that may stand in a comment: no line break can end it, and nothing but plain characters.

    A percent sign stands apart from what follows, so that nothing takes both for a place to fill in.

    Examples
    --------
    >>> one_line('my quad\nSID_AXIS,13')
    'my quad SID_AXIS,13'
    >>> one_line("50%(prog)s")
    '50% (prog)s'
    """
    return re.sub(r"%(?=\S)", "% ", re.sub(r"[^\w .,;:+\-()/=%]+", " ", text)).strip()


def file_stem(text: str) -> str:
    """A name that is safe as a part of a file name.

    Examples
    --------
    >>> file_stem("Roll & pitch, 2nd/try")
    'roll-pitch-2nd-try'
    """
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "plan"
