"""What ``result.json`` says of motors beside parameters."""

from __future__ import annotations

from pydantic import Field

from rotorid.pipeline.document_base import Document


class DerivedDocument(Document):
    """A quantity that follows from the parameters."""

    value: float
    std: float
    unit: str


class ExcitationDocument(Document):
    """How far the motors explain the slow motion of a stretch: a correlation up to 5 Hz, and the axes that counted."""

    record: str
    start_s: float
    stop_s: float
    sample_rate_hz: float
    correlation: dict[str, float]
    counted: list[str]


class BothWaysDocument(Document):
    """An inertia by acceleration on torque and by torque on acceleration: plain, and without the bias of noise."""

    axis: str
    parameter: str
    unit: str
    plain: tuple[float, float]
    corrected: tuple[float, float]
    std: tuple[float, float]
    agrees: bool


class MotorsDocument(Document):
    """Motors, rotors and thrust of a fit of ``physical.motors``.

    ``outputs`` says what the motors are known by (``output``, ``thrust_demand`` or ``speed``), ``source`` where from.
    ``rotors`` are positions forward, right and down, in meters where ``arm_m`` is known and else in units of the arm,
    with the direction of their torque (+1 turns the nose right). ``derived`` holds thrust of a rotor at the mean output
    of the flights (``thrust_hover``), its slope there, thrust at full output and that over weight; ``flown_outputs`` is
    the range of the outputs but for one percent at each end, beyond which thrust is extrapolated. ``scale`` names what
    fixed the scale of mass, thrust and inertia, or is ``null``: then all three are per kilogram.
    """

    layout: str
    arm_m: float | None
    rotors: list[list[float]]
    spins: list[float]
    outputs: str
    source: str
    outputs_rate_hz: float
    curve: str
    curve_assumed: bool = False
    reference_v: float | None = None
    hover_output: float
    flown_outputs: tuple[float, float]
    scale: str | None
    derived: dict[str, DerivedDocument] = Field(default_factory=dict)
    both_ways: list[BothWaysDocument] = Field(default_factory=list)
    excitation: list[ExcitationDocument] = Field(default_factory=list)
