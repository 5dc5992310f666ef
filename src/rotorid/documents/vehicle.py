"""Vehicle files, ``mine.toml``, schema ``rotorid.vehicle/1``: everything that flies in simulation, read and written.

A file holds a body, its rotors, an autopilot and sensors. An autopilot may be that of a vehicle of the library with
some numbers otherwise, ``base = "px4_quad"``. What the file says is checked before anything flies: keys that do not
exist, inertia that no body has, rotors that cannot lift their vehicle.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import BaseModel, Field

from rotorid.autopilots.thrust import Linearization
from rotorid.data.base import Immutable
from rotorid.data.quantity import with_error
from rotorid.documents.base import Document, checked
from rotorid.errors import ModelError, RotoridError, UsageError, nearest_name
from rotorid.fitting.flight.fit import FlightRange
from rotorid.flying.designs import computed_for
from rotorid.flying.settings import DesignSettings
from rotorid.flying.user_vehicles import OwnVehicle, own_vehicle
from rotorid.flying.vehicle_numbers import MOTION, UNITS
from rotorid.io import documents
from rotorid.models.families import axes_on_pivot
from rotorid.models.flight import AIR_DENSITY_KG_M3
from rotorid.models.parameter import no_such
from rotorid.models.physical import check_inertia
from rotorid.models.rotors import SPINS, UP, RotorLayout, library_layout
from rotorid.simulation.autopilot import Autopilot, Guidance, Kind, RateLoop
from rotorid.simulation.multirotor import Battery, Multirotor, RotorFlow, Rotors, Sensors
from rotorid.simulation.multirotor_flight import Aircraft
from rotorid.vehicles.catalog import RIG, VEHICLES, VehicleEntry, aircraft, aircraft_names
from rotorid.vehicles.px4 import with_gains

if TYPE_CHECKING:
    from rotorid.flying.bench_designs import BenchSettings

SCHEMA = "rotorid.vehicle/1"
_NEEDED = "a vehicle file, such as rotorid vehicles x500 --toml prints"

Triple: TypeAlias = tuple[float, float, float]
Table: TypeAlias = dict[str, Any]

_LARGEST = 1e12
"""Beyond any number of a vehicle, and far from where products of such numbers end."""

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,59}")
"""Names of vehicles name folders too."""


class BatteryTable(Document):
    """A battery whose voltage sags; without one the voltage is the rated one throughout."""

    full_v: float
    empty_v: float
    rated_v: float
    resistance_ohm: float
    capacity_ah: float
    hover_current_a: float


class BodyTable(Document):
    """Mass, inertia, and what the air does.

    ``inertia_kg_m2`` holds three moments, or the rows of the matrix. ``aerodynamics`` are rows of force (N) and moment
    (N m) by ``u v w p q r``; ``derivatives`` give the same as accelerations by name, such as ``X_u`` and ``L_p``.
    ``effectiveness`` is force and moment per newton of each rotor, where it is not that of the layout.
    """

    mass_kg: float
    inertia_kg_m2: Triple | tuple[Triple, Triple, Triple]
    center_of_gravity_m: Triple = (0.0, 0.0, 0.0)
    quadratic_drag_n_s2_m2: Triple = (0.0, 0.0, 0.0)
    vertical_drag_n_s2_m2: float = 0.0
    derivatives: dict[str, float] | None = None
    aerodynamics: list[list[float]] | None = None
    effectiveness: list[list[float]] | None = None


class RotorTable(Document):
    """A rotor: where it is (forward, right, down), how it turns seen from above, where it pushes."""

    position_m: Triple
    spin: Literal["ccw", "cw"]
    axis: Triple | None = None
    yaw_weight: float | None = None


class FlowTable(Document):
    """What moving air does beyond induced drag and inflow: induced velocity by momentum theory, flapping, wake."""

    disc_m2: float = 0.0
    air_density_kg_m3: float = AIR_DENSITY_KG_M3
    edge_lift_n_s_m: float = 0.0
    edge_climb_lift_n_s2_m2: float = 0.0
    edge_speed_lift_n_s2_m2: float = 0.0
    wake_n_s2_m3: float = 0.0
    climb_drag_n_s2_m2: float = 0.0
    flapping_n_s: float = 0.0
    forward_flapping_n_s: float = 0.0
    side_flapping_n_s: float = 0.0
    inflow_torque_n_s2_m: float = 0.0
    yaw_damping_n_m_s: float = 0.0


class RotorsTable(Document):
    """What the rotors do. Places come from ``layout`` and ``arm_m``, or from tables ``[[rotor]]``.

    ``thrust_n`` and ``torque_n_m`` are coefficients of the powers 0, 1 and 2 of the lagged output, in still air.
    """

    thrust_n: Triple
    layout: str | None = None
    arm_m: float | None = None
    torque_per_thrust_m: float = 0.0
    torque_n_m: Triple | None = None
    lag_up_s: float = 0.0
    lag_down_s: float | None = None
    induced_drag_n_s_m: float = 0.0
    inclined: bool = False
    inflow_n_s_m: float = 0.0
    inertia_kg_m2: float = 0.0
    full_speed_rad_s: float = 0.0
    flow: FlowTable | None = None


class RatesTable(Document):
    """Gains of the rate controllers; roll, pitch, yaw."""

    proportional: Triple | None = None
    integral: Triple | None = None
    derivative: Triple | None = None
    feedforward: Triple | None = None
    integral_limit: Triple | None = None
    derivative_of_error: bool | None = None
    derivative_cutoff_hz: Triple | None = None
    error_cutoff_hz: Triple | None = None
    target_cutoff_hz: Triple | None = None
    command_cutoff_hz: Triple | None = None


class GuidanceTable(Document):
    """The loops above attitude: sticks, and the loops of velocity, place and height."""

    tilt_limit_rad: float | None = None
    stick_tilt_rad: float | None = None
    stick_yaw_rate_rad_s: float | None = None
    stick_climb_m_s: float | None = None
    stick_thrust: float | None = None
    velocity_p_1_s: float | None = None
    velocity_i_1_s2: float | None = None
    position_p_1_s: float | None = None
    climb_p: float | None = None
    climb_i: float | None = None
    height_p_1_s: float | None = None
    hold_velocity: bool | None = None
    hold_height: bool | None = None
    tilt_compensation: bool | None = None
    heading_follows: bool | None = None


class LinearizationTable(Document):
    """What turns demands of thrust into outputs."""

    expo: float | None = None
    low: float | None = None
    high: float | None = None
    voltage_max: float | None = None
    voltage_min: float | None = None


class AutopilotTable(Document):
    """A flight controller: that of a vehicle of the library, ``base``, with the numbers given here.

    Without a base, ``kind``, ``rate_hz``, ``angle_1_s`` and ``rates.proportional`` are needed. ``parameters`` are the
    autopilot's own, for the log; on top of a base its gains and filters follow them.
    """

    base: str | None = None
    kind: Kind | None = None
    rate_hz: float | None = None
    angle_1_s: Triple | None = None
    rate_limit_rad_s: Triple | None = None
    gyro_cutoff_hz: float | None = None
    accelerometer_cutoff_hz: float | None = None
    delay_s: tuple[float, float, float, float] | None = None
    mixer: list[list[float]] | None = None
    motor_range: tuple[float, float] | None = None
    rates: RatesTable = Field(default_factory=RatesTable)
    guidance: GuidanceTable = Field(default_factory=GuidanceTable)
    linearization: LinearizationTable = Field(default_factory=LinearizationTable)
    parameters: dict[str, float] = Field(default_factory=dict)


class SensorsTable(Document):
    """What the autopilot flies on; ``base`` takes the sensors of a vehicle of the library."""

    base: str | None = None
    gyro_noise_rad_s: float | None = None
    accelerometer_noise_m_s2: float | None = None
    gyro_bias_rad_s: Triple | None = None
    accelerometer_bias_m_s2: Triple | None = None
    gyro_lag_s: float | None = None
    accelerometer_lag_s: float | None = None
    gyro_step_rad_s: float | None = None
    accelerometer_step_m_s2: float | None = None
    gyro_vibration_rad_s: float | None = None
    accelerometer_vibration_m_s2: float | None = None
    rotor_speed_rad_s: float | None = None
    accelerometer_place_m: Triple | None = None
    attitude_noise_rad: float | None = None
    velocity_noise_m_s: float | None = None
    position_noise_m: float | None = None


class VehicleFile(Document):
    """A vehicle with its autopilot and its sensors."""

    schema_name: Annotated[Literal["rotorid.vehicle/1"], Field(alias="schema")]
    name: str
    summary: str = ""
    source: str = ""
    body: BodyTable
    rotors: RotorsTable
    rotor: list[RotorTable] = Field(default_factory=list)
    autopilot: AutopilotTable | str
    sensors: SensorsTable = Field(default_factory=SensorsTable)
    battery: BatteryTable | None = None


def read_vehicle(path: Path) -> VehicleEntry:
    """The vehicle in a file.

    Parameters
    ----------
    path
        TOML with the schema ``rotorid.vehicle/1``.

    Raises
    ------
    UsageError
        It cannot be read, holds keys or numbers that cannot be, or a vehicle that cannot fly.
    """
    return parse_vehicle(documents.read_text(path, needed=_NEEDED), where=str(path))


def parse_vehicle(text: str, *, where: str) -> VehicleEntry:
    """The vehicle in a text, as :func:`read_vehicle` reads it from a file.

    Parameters
    ----------
    text
        TOML.
    where
        What messages call it.

    Raises
    ------
    UsageError
        As for a file.

    Examples
    --------
    >>> from rotorid.vehicles import VEHICLES
    >>> entry = parse_vehicle(vehicle_toml(VEHICLES["x500"]), where="x500.toml")
    >>> entry.name, float(entry.make().vehicle.mass_kg)
    ('x500', 2.0)
    >>> parse_vehicle('schema = "rotorid.vehicle/1"' + chr(10) + 'nmae = "mine"', where="mine.toml")
    Traceback (most recent call last):
    rotorid.errors.UsageError: mine.toml has the unknown key nmae; did you mean name?
    """
    try:
        table = documents.parse_toml(text)
        if table.get("schema") != SCHEMA:
            came = f"has the schema {table['schema']}" if "schema" in table else "names no schema"
            raise UsageError(f"{where} {came}", needed=f'schema = "{SCHEMA}": {_NEEDED}')
        _require_keys(VehicleFile, table, where)
        _require_finite(table, where)
        file = checked(VehicleFile, table)
    except documents.DocumentError as error:
        raise UsageError(f"{where} is no vehicle: {error}", needed=_NEEDED) from error
    try:
        craft = _aircraft(file)
        _require_flight(craft)
    except RotoridError as error:
        raise UsageError(f"{where}: {error.came}", needed=error.needed, remedy=error.remedy) from error
    return VehicleEntry(name=file.name, summary=file.summary, source=file.source, make=lambda: craft)


def _require_keys(kind: type[BaseModel], table: Mapping[str, Any], where: str) -> None:
    """Refuse keys that there are not, with the nearest one that there is."""
    known = {field.alias or name: field for name, field in kind.model_fields.items()}
    for key, value in table.items():
        if key not in known:
            near = nearest_name(key, known)
            raise UsageError(
                f"{where} has the unknown key {key}",
                needed="" if near else f"some of {', '.join(known)}",
                remedy=f"did you mean {near}?" if near else "",
            )
        part = _TABLES.get(key) if kind in (VehicleFile, AutopilotTable, RotorsTable) else None
        for item in value if isinstance(value, list) else [value]:
            if part is not None and isinstance(item, dict):
                _require_keys(part, item, f"{where}, [{key}]")


_TABLES: Mapping[str, type[Document]] = {
    "body": BodyTable,
    "rotors": RotorsTable,
    "rotor": RotorTable,
    "autopilot": AutopilotTable,
    "sensors": SensorsTable,
    "battery": BatteryTable,
    "flow": FlowTable,
    "rates": RatesTable,
    "guidance": GuidanceTable,
    "linearization": LinearizationTable,
}


def _numbers(value: Any, place: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(value, float):
        yield place, value
    elif isinstance(value, Mapping):
        for key, entry in value.items():
            yield from _numbers(entry, f"{place}.{key}" if place else key)
    elif isinstance(value, list):
        for entry in value:
            yield from _numbers(entry, place)


def _require_finite(table: Table, where: str) -> None:
    for place, value in _numbers(table):
        # No limit of a rate is a limit without end.
        if not math.isfinite(value) and not (place.endswith("rate_limit_rad_s") and value > 0.0):
            raise UsageError(f"{where} has {place} = {value:g}", needed="finite numbers")
        if math.isfinite(value) and abs(value) > _LARGEST:
            raise UsageError(f"{where} has {place} = {value:g}", needed=f"numbers up to {_LARGEST:g}")


def _require_flight(craft: Aircraft) -> None:
    """Refuse what no rigid body is, and rotors that do not lift it."""
    moments = np.linalg.eigvalsh(craft.vehicle.inertia_kg_m2)
    if check_inertia(*(float(moment) for moment in moments)):
        words = ", ".join(f"{moment:.4g}" for moment in moments)
        raise ModelError(
            f"{craft.name} has the principal moments of inertia {words} kg m^2",
            needed="each at most the sum of the other two, as for every rigid body",
        )
    craft.autopilot.hover_commands(craft.vehicle)


def _aircraft(file: VehicleFile) -> Aircraft:
    if not NAME.fullmatch(file.name):
        raise ModelError(
            f"the name {file.name[:80]!r} is not allowed",
            needed="letters, digits, dots, dashes and underscores, 60 at most",
        )
    layout = _layout(file)
    wanted = {key: value for key, value in file.rotors.model_dump().items() if key not in ("layout", "arm_m")}
    flow = wanted.pop("flow")
    rotors = Rotors(
        layout=layout,
        thrust=wanted.pop("thrust_n"),
        torque=wanted.pop("torque_n_m"),
        flow=None if flow is None else RotorFlow(**flow),
        **wanted,
    )
    body = file.body
    vehicle = Multirotor(
        name=file.name,
        mass_kg=body.mass_kg,
        inertia_kg_m2=np.array(body.inertia_kg_m2),
        rotors=rotors,
        aerodynamics=_aerodynamics(body),
        quadratic_drag_n_s2_m2=body.quadratic_drag_n_s2_m2,
        vertical_drag_n_s2_m2=body.vertical_drag_n_s2_m2,
        center_of_gravity_m=body.center_of_gravity_m,
        effectiveness=None if body.effectiveness is None else _matrix("effectiveness", body.effectiveness),
        battery=None if file.battery is None else Battery(**file.battery.model_dump()),
        source=file.source,
    )
    return Aircraft(vehicle=vehicle, autopilot=_autopilot(file.autopilot), sensors=_sensors(file.sensors))


def _matrix(name: str, rows: Sequence[Sequence[float]]) -> np.ndarray:
    if len({len(row) for row in rows}) != 1:
        raise ModelError(f"{name} has rows of {', '.join(str(len(row)) for row in rows)} numbers", needed="equal rows")
    return np.array(rows, dtype=np.float64)


def _layout(file: VehicleFile) -> RotorLayout:
    named = file.rotors.layout is not None or file.rotors.arm_m is not None
    if named == bool(file.rotor) or (named and (file.rotors.layout is None or file.rotors.arm_m is None)):
        raise ModelError(
            "the places of the rotors are not said once",
            needed="layout and arm_m in [rotors], or a table [[rotor]] for each rotor",
        )
    if file.rotors.layout is not None and file.rotors.arm_m is not None:
        return library_layout(file.rotors.layout).scaled(file.rotors.arm_m)
    spins = [SPINS[rotor.spin] for rotor in file.rotor]
    weights = [
        spin if rotor.yaw_weight is None else rotor.yaw_weight for rotor, spin in zip(file.rotor, spins, strict=True)
    ]
    return RotorLayout(
        name=file.name,
        positions=np.array([rotor.position_m for rotor in file.rotor]),
        spins=np.array(spins),
        axes=np.array([rotor.axis or UP for rotor in file.rotor]),
        yaw_weights=np.array(weights),
        arm_known=True,
        source=file.source,
    )


def _aerodynamics(body: BodyTable) -> np.ndarray | None:
    if body.derivatives is None:
        air = None if body.aerodynamics is None else _matrix("aerodynamics", body.aerodynamics)
        if air is not None and air.shape != (6, 6):
            raise ModelError(f"aerodynamics has the shape {air.shape}", needed="six rows of six")
        return air
    if body.aerodynamics is not None:
        raise ModelError("aerodynamics and derivatives are both given", needed="one of them")
    inertia = np.array(body.inertia_kg_m2)
    size = np.array([body.mass_kg] * 3 + list(inertia if inertia.ndim == 1 else inertia.diagonal()))
    air = np.zeros((6, 6))
    for name, value in body.derivatives.items():
        if name not in MOTION:
            near = nearest_name(name, MOTION)
            raise ModelError(
                f"there is no derivative {name}",
                needed=f"some of {', '.join(MOTION)}",
                remedy=f"did you mean {near}?" if near else "",
            )
        row, column = MOTION[name]
        air[row, column] = size[row] * value
    return air


def _given(table: Document, *left_out: str) -> Table:
    return {key: value for key, value in table.model_dump().items() if value is not None and key not in left_out}


def _autopilot(table: AutopilotTable | str) -> Autopilot:
    if isinstance(table, str):
        return aircraft(table).autopilot
    parts = ("base", "rates", "guidance", "linearization", "parameters", "mixer")
    values = _given(table, *parts)
    if table.mixer is not None:
        values["mixer"] = _matrix("mixer", table.mixer)
    if table.base is None:
        missing = [name for name in ("kind", "rate_hz", "angle_1_s") if name not in values]
        missing += ["rates.proportional"] if table.rates.proportional is None else []
        if missing:
            raise ModelError(
                f"[autopilot] lacks {', '.join(missing)}", needed='them, or base = "px4_quad" or another vehicle'
            )
        return Autopilot(
            rates=RateLoop(**_given(table.rates)),
            guidance=Guidance(**_given(table.guidance)),
            linearization=Linearization(**_given(table.linearization)),
            parameters=table.parameters,
            **values,
        )
    own = based(aircraft(table.base), table.parameters)
    replaced: Table = {}
    for name, part in (("rates", table.rates), ("guidance", table.guidance), ("linearization", table.linearization)):
        if given := _given(part):
            replaced[name] = replace(getattr(own, name), **given)
    return replace(own, **values, **replaced)


def based(craft: Aircraft, parameters: Mapping[str, float]) -> Autopilot:
    """The autopilot of a vehicle with other parameters, and the gains and filters that follow from them.

    Parameters
    ----------
    craft
        A vehicle of the library.
    parameters
        By the names of its firmware.
    """
    own = craft.autopilot
    if any(name in parameters for name in ("MC_ROLLRATE_P", "ATC_RAT_RLL_P")):
        own = with_gains(craft, parameters, source="the vehicle file").autopilot
    return replace(own, parameters={**own.parameters, **parameters})


def _sensors(table: SensorsTable) -> Sensors:
    start = Sensors() if table.base is None else aircraft(table.base).sensors
    return replace(start, **_given(table, "base"))


def vehicle_toml(entry: VehicleEntry, *, base: str | None = None, comments: Sequence[str] = ()) -> str:
    """A vehicle as the file that :func:`read_vehicle` reads, number by number the same.

    Parameters
    ----------
    entry
        A vehicle that flies freely.
    base
        A vehicle of the library from whose autopilot and sensors this one differs little; only differences are written.
    comments
        Lines for the head of the file.

    Examples
    --------
    >>> from rotorid.vehicles import VEHICLES
    >>> print(vehicle_toml(VEHICLES["px4_quad"], base="px4_quad").split("[rotors]")[1].strip())
    layout = "quad.x"
    arm_m = 0.28284271247461906
    thrust_n = [0.0, 5.0, 0.0]
    torque_per_thrust_m = 0.02
    lag_up_s = 0.048
    <BLANKLINE>
    [autopilot]
    base = "px4_quad"
    <BLANKLINE>
    [sensors]
    base = "px4_quad"
    """
    if entry.make is None:
        raise ModelError(f"the vehicle {entry.name} does not fly", needed="one that does")
    craft = entry.make()
    lines = [f"# {line}".rstrip() for line in comments]
    lines += [f'schema = "{SCHEMA}"', *_lines({"name": entry.name})]
    lines += _lines({key: words for key, words in (("summary", entry.summary), ("source", entry.source)) if words})
    lines += [*_table("body", _body(craft.vehicle)), *_rotor_tables(craft.vehicle.rotors)]
    if craft.vehicle.battery is not None:
        lines += _table("battery", _differing(craft.vehicle.battery, None))
    lines += _autopilot_tables(craft.autopilot, base)
    sensors = _differing(craft.sensors, Sensors() if base is None else aircraft(base).sensors)
    lines += _table("sensors", ({"base": base} if base else {}) | sensors)
    return "\n".join(lines) + "\n"


def flown_vehicle_toml(choices: DesignSettings) -> str:
    """The vehicle that a plan was computed for, as a file: with the gains, noise and rotors that were taken for it.

    Parameters
    ----------
    choices
        What was designed.
    """
    entry, craft = choices.entry, choices.craft
    base = choices.own.like if choices.own is not None else entry.name
    words = f"the vehicle of a plan, {computed_for(choices)}"
    named = replace(entry, summary=words, make=lambda: craft)
    return vehicle_toml(named, base=base if base in VEHICLES else None)


def _body(vehicle: Multirotor) -> Table:
    inertia = vehicle.inertia_kg_m2
    diagonal = np.count_nonzero(inertia - np.diag(inertia.diagonal())) == 0
    body: Table = {
        "mass_kg": vehicle.mass_kg,
        "inertia_kg_m2": inertia.diagonal().tolist() if diagonal else inertia.tolist(),
    }
    for name in ("center_of_gravity_m", "quadratic_drag_n_s2_m2"):
        if any(getattr(vehicle, name)):
            body[name] = list(getattr(vehicle, name))
    if vehicle.vertical_drag_n_s2_m2:
        body["vertical_drag_n_s2_m2"] = vehicle.vertical_drag_n_s2_m2
    for name in ("aerodynamics", "effectiveness"):
        matrix = getattr(vehicle, name)
        if matrix is not None and np.any(matrix):
            body[name] = (matrix + 0.0).tolist()
    return body


def _rotor_tables(rotors: Rotors) -> list[str]:
    layout, places = rotors.layout, []
    table: Table = {}
    if _in_library(layout):
        table = {"layout": layout.name, "arm_m": layout.arm}
    else:
        assert layout.axes is not None
        assert layout.yaw_weights is not None
        words = {sign: word for word, sign in SPINS.items()}
        for place, spin, axis, weight in zip(
            layout.positions.tolist(),
            layout.spins.tolist(),
            layout.axes.tolist(),
            layout.yaw_weights.tolist(),
            strict=True,
        ):
            rotor: Table = {"position_m": place, "spin": words[spin]}
            rotor |= {} if tuple(axis) == UP else {"axis": axis}
            rotor |= {} if weight == spin else {"yaw_weight": weight}
            places += ["", "[[rotor]]", *_lines(rotor)]
    own = _differing(rotors, None, "layout", "thrust", "torque", "flow")
    if own.get("lag_down_s") == rotors.lag_up_s:
        del own["lag_down_s"]
    table |= {"thrust_n": list(rotors.thrust)}
    table |= {} if rotors.torque is None else {"torque_n_m": list(rotors.torque)}
    flow = [] if rotors.flow is None else _table("rotors.flow", _differing(rotors.flow, None))
    return [*_table("rotors", table | own), *flow, *places]


def _in_library(layout: RotorLayout) -> bool:
    try:
        known = library_layout(layout.name).scaled(layout.arm)
    except ModelError:
        return False
    pairs = ((getattr(known, name), getattr(layout, name)) for name in ("positions", "spins", "axes", "yaw_weights"))
    return all(np.array_equal(one, other) for one, other in pairs)


def _autopilot_tables(own: Autopilot, base: str | None) -> list[str]:
    start: Autopilot | None = None
    parameters: Mapping[str, float] = own.parameters
    if base is not None:
        craft = aircraft(base)
        usual = craft.autopilot.parameters
        parameters = {key: value for key, value in own.parameters.items() if usual.get(key) != value}
        start = based(craft, parameters)
    parts = ("rates", "guidance", "linearization")
    table = _differing(own, start, *parts, "parameters", "mixer")
    mixer = None if start is None else start.mixer
    if own.mixer is not None and not (mixer is not None and np.array_equal(mixer, own.mixer)):
        table["mixer"] = own.mixer.tolist()
    elif mixer is not None and own.mixer is None:
        # No number of a file takes a mixer away.
        return _autopilot_tables(own, None)
    lines = _table("autopilot", ({"base": base} if base else {}) | table)
    for name in parts:
        if inside := _differing(getattr(own, name), None if start is None else getattr(start, name)):
            lines += _table(f"autopilot.{name}", inside)
    return [*lines, *(_table("autopilot.parameters", dict(parameters)) if parameters else [])]


def _differing(value: Any, start: Any, *left_out: str) -> Table:
    """Fields that are not those of another value, or not the usual ones."""
    found: Table = {}
    for part in fields(value):
        own = getattr(value, part.name)
        usual = part.default if start is None else getattr(start, part.name)
        if part.name not in left_out and own is not None and (usual is MISSING or own != usual):
            found[part.name] = list(own) if isinstance(own, tuple) else own
    return found


def _table(name: str, table: Table) -> list[str]:
    return ["", f"[{name}]", *_lines(table)]


def _lines(table: Table) -> list[str]:
    return [f"{key} = {_value(value)}" for key, value in table.items()]


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return documents.toml_text(value)
    if isinstance(value, list):
        if value and isinstance(value[0], list):
            return "[\n" + "".join(f"    {_value(row)},\n" for row in value) + "]"
        return f"[{', '.join(map(_value, value))}]"
    return repr(float(value))


@dataclass(frozen=True, kw_only=True, eq=False)
class NamedVehicle(Immutable):
    """A vehicle as words of a command line name it.

    Parameters
    ----------
    changes
        Numbers of it that are to be otherwise, by the names of :func:`rotorid.simulation.multirotor_flight.changed`.
    own
        Of results: its numbers with their sources.
    like
        The vehicle of the library that gave the rest, if one of the library did.
    """

    entry: VehicleEntry
    changes: Mapping[str, float] = field(default_factory=dict)
    own: OwnVehicle | None = None
    like: str | None = None

    def __post_init__(self) -> None:
        self._set(changes=self.changes)

    @property
    def firmware(self) -> str:
        """Of the autopilot whose logs it was identified from, as they name it; empty where they do not."""
        flew = None if self.own is None else self.own.joined.controller
        return "" if flew is None else flew.firmware

    @property
    def tested(self) -> FlightRange | None:
        """Range that it was identified on, rotors by shares of full speed; ``None`` where no result says so."""
        return None if self.own is None else self.own.tested

    @property
    def toml(self) -> str:
        """Its vehicle file, with the sources of its numbers at the head."""
        return vehicle_toml(self.entry, base=self.like, comments=[] if self.own is None else source_lines(self.own))


def named_vehicle(
    words: Sequence[str], *, like: str | None = None, given: Mapping[str, float] | None = None, name: str | None = None
) -> NamedVehicle:
    """The vehicle that words name: one of the library, one of a file, or one of results.

    Parameters
    ----------
    words
        A name, a ``.toml`` file, or one and more folders of ``identify`` or their ``result.json``.
    like
        For results: the vehicle whose autopilot, sensors and missing numbers it has; a name or a file.
    given
        Numbers that are known otherwise.
    name
        Of a vehicle that comes from results; by default that of the first folder.

    Raises
    ------
    UsageError, ModelError
        There is no such vehicle, or results do not make one.
    """
    known = dict(given or {})
    results = [word for word in words if _is_result(word)]
    if not results:
        if len(words) != 1:
            raise UsageError(f"{' and '.join(words) or 'no vehicle'} came", needed="one vehicle, or results of one")
        if like is not None:
            raise UsageError(
                f"--like {like} does not apply to {words[0]}, a complete vehicle",
                needed="results of identify with --like",
            )
        entry = read_vehicle(Path(words[0])) if words[0].endswith(".toml") else _of_library(words[0])
        return NamedVehicle(entry=entry, changes=known)
    if others := [word for word in words if word not in results]:
        raise UsageError(f"{others[0]} and {results[0]} cannot be combined", needed="results of one vehicle only")
    from rotorid.documents.results import load_results

    if named_rig(results) is not None:
        raise UsageError(
            f"{results[0]} is a rig on a pivot, which does not fly"
            + (f": {like} cannot give it what it lacks" if like else ""),
            needed="results of a vehicle in flight",
            remedy="leave out --like: a rig is planned and simulated by itself" if like else "",
        )
    models = load_results(results)
    base = None if like is None else named_vehicle([like]).entry
    own = own_vehicle(
        models,
        like=None if base is None else base.aircraft,
        given={key: value for key, value in known.items() if key in UNITS},
        name=_named(name, Path(results[0])),
    )
    rest = "autopilot and sensors are those" if own.whole else "the rest is that"
    summary = f"identified: {', '.join(model.name for model in models)}; {rest} of {own.like}"
    craft = own.aircraft
    return NamedVehicle(
        # What sends set-points and logs answers stays, too, of a vehicle that is reached by these alone.
        entry=VehicleEntry(
            name=craft.name,
            summary=summary,
            source=craft.vehicle.source,
            make=lambda: craft,
            shown=None if base is None else base.shown,
            interface=None if base is None else base.interface,
        ),
        changes={key: value for key, value in known.items() if key not in UNITS},
        own=own,
        like=like if like in VEHICLES else None,
    )


def named_rig(words: Sequence[str], *, given: Mapping[str, float] | None = None) -> BenchSettings | None:
    """The rig that words name: that of the library, or one of a result; ``None`` where they name what flies.

    Parameters
    ----------
    words, given
        As for :func:`named_vehicle`.
    """
    from rotorid.flying.bench_designs import BenchSettings

    if list(words) == [RIG]:
        return BenchSettings(changes=given or {})
    if len(words) != 1 or not _is_result(words[0]):
        return None
    from rotorid.documents.result import read_result, read_text
    from rotorid.documents.results import result_files
    from rotorid.planning.prior import read_prior

    models = {file: read_result(file, read_text(file)).model for file in result_files(Path(words[0]))}
    rigs = {file: axes for file, name in models.items() if (axes := axes_on_pivot(name))}
    if len(rigs) < len(models):
        return None
    # Of several models the one that says most.
    return BenchSettings(prior=read_prior(max(rigs, key=lambda file: len(rigs[file]))), changes=given or {})


def _is_result(word: str) -> bool:
    if word in VEHICLES or word.endswith(".toml"):
        return False
    return Path(word).is_dir() or (word.endswith(".json") and Path(word).exists())


def _of_library(word: str) -> VehicleEntry:
    if word in VEHICLES:
        return VEHICLES[word]
    wrong = no_such("vehicle", word, aircraft_names())
    needed = f"{wrong.needed}, a vehicle file .toml, or a folder or result.json of rotorid identify"
    raise UsageError(wrong.came, needed=needed, remedy=wrong.remedy)


def _named(name: str | None, place: Path) -> str:
    """The name that was chosen, or one that follows from a folder."""
    if name is None:
        folder = (place if place.is_dir() else place.parent).resolve().name
        return re.sub(r"[^A-Za-z0-9_.-]+", "_", folder).strip("._-")[:60] or "vehicle"
    if not NAME.fullmatch(name):
        raise UsageError(
            f"the name {name[:80]!r} is not allowed", needed="letters, digits, dots, dashes and underscores, 60 at most"
        )
    return name


def source_lines(own: OwnVehicle) -> list[str]:
    """Where the numbers of a vehicle come from, a line each, and what of another vehicle it has.

    Parameters
    ----------
    own
        From results.
    """
    lines = ["Numbers of results, in SI units:"]
    for name, number in own.joined.numbers.items():
        if number.source != "default":
            shown = with_error(number.value, number.std, digits=5)
            lines.append(
                f"  {name} = {shown} {'' if number.unit == '1' else number.unit}, {number.source}: {number.of}"
            )
    lines.append(f"Taken from {own.like}:")
    return [*lines, *(f"  {words}" for words in own.taken), ""]
