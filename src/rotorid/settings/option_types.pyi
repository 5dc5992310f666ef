"""Options of the verbs as keywords, for editors; ``tests.api.option_types`` writes this."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict

from rotorid.autopilots.autopilot import LogFormat
from rotorid.data.record import Maneuver
from rotorid.data.sensor_filters import SensorFilter
from rotorid.fitting.flight.fit import FlightRange
from rotorid.flying.settings import Changes
from rotorid.settings.given_controllers import GivenController
from rotorid.settings.identifying import HoldChoice, MethodChoice, SpeedDamping, WeightsChoice
from rotorid.settings.measuring import CompositionChoice, EstimateChoice, SensorFilters, TaperChoice
from rotorid.settings.motors import ChosenCurve
from rotorid.settings.option import Seed
from rotorid.simulation.wind import Wind
from rotorid.typing import Axis, LoopName
from rotorid.verification.sampled import LowPass

class BenchOptions(TypedDict, total=False):
    predictions: str | None
    label: str | None
    seed: int

class FleetOptions(TypedDict, total=False):
    models: Any
    review: bool
    vehicles: Path | None
    workers: int | None
    memory_bytes: Any
    timeout_s: float
    seed: int
    scheduler: str | None
    resume: bool

class SimulateOptions(TypedDict, total=False):
    duration_s: float | None
    wind: Wind
    changes: Changes | str | Sequence[str]
    vary: Mapping[str, float] | str | Sequence[str]
    runs: int
    format: LogFormat | None
    stick: float
    speed_m_s: tuple[float, float] | str
    tested: FlightRange | None
    seed: Seed

class StitchOptions(TypedDict, total=False):
    controllers: Mapping[Axis, GivenController] | str
    seed: int

class IdentifyOptions(TypedDict, total=False):
    band_rad_s: tuple[float, float] | str | None
    windows_s: Sequence[float] | str
    input_windows_s: Mapping[str, tuple[float, ...]] | str | Sequence[str]
    composition: CompositionChoice
    taper: TaperChoice
    overlap: float
    coherence: float | None
    estimate: EstimateChoice
    instruments: Sequence[str] | str
    segments: Sequence[Maneuver] | str | Sequence[str]
    shifts: Mapping[str, float] | str | Sequence[str]
    seed: Seed
    correct_filters: bool
    filters: SensorFilters | str | Sequence[str]
    fix: Mapping[str, float] | str | Sequence[str]
    known: Mapping[str, tuple[float, float]] | str | Sequence[str]
    ties: Mapping[str, str] | str | Sequence[str]
    correct_sensors: bool
    free: Sequence[str] | str
    constants: Mapping[str, float] | str | Sequence[str]
    outputs: Sequence[str] | str
    pairs: Mapping[str, tuple[float, float] | None] | str | Sequence[str]
    pair_weights: Mapping[str, float] | str | Sequence[str]
    weights: WeightsChoice
    reduce: bool
    speed_damping: SpeedDamping
    method: MethodChoice
    hold: HoldChoice
    pieces_s: float | None
    starts: str
    search: str | None
    evaluations: int | None
    runs: int | None
    add_noise_percent: float | None
    workers: int | None
    bootstrap: int | None
    layout: str | None
    arm_m: float | None
    curve: ChosenCurve
    rotor_diameter_m: float | None
    predictor: bool

class MeasureOptions(TypedDict, total=False):
    band_rad_s: tuple[float, float] | str | None
    windows_s: Sequence[float] | str
    input_windows_s: Mapping[str, tuple[float, ...]] | str | Sequence[str]
    composition: CompositionChoice
    taper: TaperChoice
    overlap: float
    coherence: float | None
    estimate: EstimateChoice
    instruments: Sequence[str] | str
    segments: Sequence[Maneuver] | str | Sequence[str]
    shifts: Mapping[str, float] | str | Sequence[str]
    seed: Seed
    correct_filters: bool
    filters: Mapping[str, tuple[SensorFilter, ...]]

class TrackOptions(TypedDict, total=False):
    first_s: float
    step_share: float
    thrust_exponent: float | None
    axis: Axis | None
    seed: int

class VerifyOptions(TypedDict, total=False):
    band_rad_s: tuple[float, float] | str | None
    windows_s: Sequence[float] | str
    input_windows_s: Mapping[str, tuple[float, ...]] | str | Sequence[str]
    composition: CompositionChoice
    taper: TaperChoice
    overlap: float
    coherence: float | None
    estimate: EstimateChoice
    instruments: Sequence[str] | str
    segments: Sequence[Maneuver] | str | Sequence[str]
    shifts: Mapping[str, float] | str | Sequence[str]
    seed: int
    correct_filters: bool
    filters: Mapping[str, tuple[SensorFilter, ...]]
    scale: float | None
    vibration_filter: LowPass | str
    controllers: Mapping[Axis, GivenController] | str

class ResponseOptions(TypedDict, total=False):
    band_rad_s: tuple[float, float] | str | None
    windows_s: Sequence[float] | str
    input_windows_s: Mapping[str, tuple[float, ...]] | str | Sequence[str]
    composition: CompositionChoice
    taper: TaperChoice
    overlap: float
    coherence: float | None
    estimate: EstimateChoice
    instruments: Sequence[str] | str
    segments: Sequence[Maneuver] | str | Sequence[str]
    shifts: Mapping[str, float] | str | Sequence[str]
    seed: Seed
    correct_filters: bool
    filters: SensorFilters | str | Sequence[str]
    correct_sensors: bool
    workers: int | None

class TuneOptions(TypedDict, total=False):
    axes: Sequence[LoopName] | str
    robustness: float
    noise: float
    keep: Sequence[str] | str
    only: Sequence[str] | str
    filters: Mapping[str, float] | str | Sequence[str]
    filter_choice: str
    scale: float | None
    draws: int
    seed: int

class ReviewOptions(TypedDict, total=False):
    models: bool
    known: Mapping[str, float] | str | Sequence[str]
    baseline: Any

class FlyOptions(TypedDict, total=False):
    segments: Sequence[Maneuver] | str | Sequence[str]
    pieces_s: float | None
    hold: HoldChoice
    seed: int
