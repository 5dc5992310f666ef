"""Vehicles whose numbers are 30 % off those of the library, and results that know them exactly."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rotorid.documents.base import ProvenanceDocument
from rotorid.documents.result import ResultDocument, identified_model
from rotorid.flying.simulation import truth_of
from rotorid.flying.user_vehicles import numbers_of
from rotorid.models.hover_layouts import physical_hover
from rotorid.models.library import library_model
from rotorid.models.structure import LinearStructure
from rotorid.results.model import IdentifiedModel
from rotorid.results.summary import Correlation, DelayBudget, HoverRotors, ParameterEstimate
from rotorid.simulation.linearization import hover_derivatives_of
from rotorid.simulation.multirotor_flight import Aircraft, changed
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.vehicles.catalog import aircraft
from rotorid.vehicles.px4 import with_gains

LIBRARY = ("px4_quad", "hummingbird", "s500")
MORE, LESS = 1.3, 0.7
DIAMETER_M, DENSITY = 0.25, 1.2
SHARE = 0.01
COMMANDS = ("roll_command", "pitch_command", "yaw_command", "thrust_command")


_GAIN = re.compile("MC_(ROLL|PITCH|YAW)RATE_[PID]")


def twin_of(name: str) -> Aircraft:
    """A vehicle of the library with other mass, inertia, arm, torque, thrust, lag, air, delays and gains."""
    own = aircraft(name)
    body, rotors = own.vehicle, own.vehicle.rotors
    longer = replace(body, rotors=replace(rotors, layout=rotors.layout.scaled(MORE * rotors.layout.arm)))
    roll, pitch, yaw = (LESS * float(moment) for moment in body.inertia_kg_m2.diagonal())
    own = changed(
        replace(own, vehicle=replace(longer, effectiveness=None)),
        {
            "m": MORE * body.mass_kg,
            "I_xx": roll,
            "I_yy": pitch,
            "I_zz": yaw,
            "thrust": MORE**2,
            "kappa": LESS * numbers_of(own)["kappa"].value,
            "T_motor": LESS * rotors.mean_lag_s or 0.03,
            "drag": MORE,
        },
    )
    loop = own.autopilot.rates
    # Less inertia with more thrust on a longer arm: the gains of the library would be too large by this.
    weaker = {
        part: tuple(0.35 * gain for gain in getattr(loop, part)) for part in ("proportional", "integral", "derivative")
    }
    if own.autopilot.kind == "px4":
        logged = {name: 0.35 * value for name, value in own.autopilot.parameters.items() if _GAIN.fullmatch(name)}
        own, weaker = with_gains(own, {**own.autopilot.parameters, **logged}, source="the twin"), {}
        loop = own.autopilot.rates
    delays = tuple(MORE * delay_s + 0.002 * number for number, delay_s in enumerate(own.autopilot.delay_s))
    flies = replace(own.autopilot, rates=replace(loop, **weaker), delay_s=delays)
    return replace(own, autopilot=flies)


def own_torque(craft: Aircraft) -> list[float]:
    """Torque over thrust of a rotor in hover."""
    rotors = craft.vehicle.rotors
    share = rotors.share_of(craft.vehicle.mass_kg * STANDARD_GRAVITY_M_S2 / rotors.layout.rotors)
    return [float(np.polynomial.polynomial.polyval(share, rotors.torque_curve)) / rotors.thrust_at(share)]


def exact(
    structure: LinearStructure,
    values: Mapping[str, float],
    craft: Aircraft,
    *,
    fixed: Sequence[str] = (),
    rotors: HoverRotors | None = None,
) -> IdentifiedModel:
    """A result that knows each value to a percent of itself."""
    parameters = structure.parameters.with_values({n: v for n, v in values.items() if n in structure.parameters.free})
    for name in (*fixed, "T_motor"):
        if name in fixed:
            parameters = parameters.fix(name, values[name])
    found = parameters.values | {name: values[name] for name in fixed}
    shown = truth_of(craft)
    delays = {}
    for output, command in zip(("p", "q", "r", "az"), COMMANDS, strict=True):
        if output in structure.outputs and command in structure.inputs:
            tau_s, lag_s = shown[f"tau_{command.removesuffix('_command')}"].value, craft.vehicle.rotors.mean_lag_s
            delays[f"{output}/{command}"] = DelayBudget(
                input_delay_s=tau_s, motor_lag_s=lag_s, output_delay_s=0.0, total_s=tau_s + lag_s, total_std_s=1e-4
            )
    estimates = {
        one.name: ParameterEstimate(
            value=found[one.name],
            unit=one.unit,
            std=None if one.status == "fixed" else SHARE * max(abs(found[one.name]), 1e-3),
            status=one.status,
        )
        for one in parameters
    }
    free = tuple(parameters.free)
    document = ResultDocument(
        model=structure.name,
        inputs=list(structure.inputs),
        outputs=list(structure.outputs),
        states=list(structure.states),
        parameters=estimates,
        correlation=Correlation(names=free, matrix=tuple(map(tuple, np.eye(len(free)).tolist()))),
        delays=delays,
        rotors=rotors,
        provenance=ProvenanceDocument(version="0", command=[], inputs={"own.ulg": "0" * 64}, settings={}, seed=0),
    )
    return identified_model(document, replace(structure, parameters=parameters))


def hover_physics(craft: Aircraft, *, output: bool = True) -> IdentifiedModel:
    """What ``physical.hover`` knows of a vehicle that flies."""
    body, rotors = craft.vehicle, craft.vehicle.rotors
    layout = replace(rotors.layout, positions=rotors.layout.positions * np.array([1.0, 1.0, 0.0]))
    count, mixer = layout.rotors, craft.autopilot.mixer_for(body)
    weight_n = body.mass_kg * STANDARD_GRAVITY_M_S2 / count
    hover = rotors.share_of(weight_n)
    slope_n = rotors.thrust[1] + 2.0 * hover * rotors.thrust[2]
    n_h = 90.0
    c_T = weight_n / (DENSITY * n_h**2 * DIAMETER_M**4)
    k_n = slope_n * n_h / (2.0 * weight_n)
    derivatives = hover_derivatives_of(body, craft.autopilot)
    structure = physical_hover(layout, mixer)
    flow = DENSITY * n_h * DIAMETER_M**3
    values = {
        "m": body.mass_kg,
        **dict(zip(("I_xx", "I_yy", "I_zz"), body.inertia_kg_m2.diagonal().tolist(), strict=True)),
        "c_T": c_T,
        "c_P": own_torque(craft)[0] * 2.0 * math.pi * c_T / DIAMETER_M,
        "c_H": -derivatives["X_u"] * body.mass_kg / (count * flow),
        "dc_T_dJ": derivatives["Z_w"] * body.mass_kg / (count * flow),
        "J_r": rotors.inertia_kg_m2 * rotors.full_speed_rad_s / (2.0 * math.pi * k_n),
        "D": DIAMETER_M,
        "l": layout.arm,
        "rho": DENSITY,
        "k_n": k_n,
        "z": 0.02,
        "T_motor": rotors.mean_lag_s,
    }
    known = HoverRotors(
        layout=layout.name,
        rotors=tuple(map(tuple, (layout.positions / layout.arm).tolist())),
        spins=tuple(layout.spins.tolist()),
        mixer=tuple(map(tuple, mixer.tolist())),
        hover_output=hover if output else None,
    )
    return exact(structure, values, craft, fixed=("m", "D", "l", "rho", "k_n"), rotors=known)


def derivatives_of(craft: Aircraft, name: str) -> IdentifiedModel:
    """What a linear model of the library knows of a vehicle that flies."""
    return exact(library_model(name), {one: value.value for one, value in truth_of(craft).items()}, craft)
