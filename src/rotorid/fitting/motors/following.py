"""Fits of motor speeds: the equations of ``motor.speed`` motor by motor, which a program of all motors is slower at.

The general integrator carries the derivatives of every state by every unknown. A motor knows nine numbers: lags,
delay, curve, factor, exponent and start. Their derivatives are written out here, and those by the unknowns of a fit
follow by the chain rule; steps, corners and values are those of the general one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.fitting.time.nonlinear import NonlinearProblem
from rotorid.fitting.time.output_error import TimeData
from rotorid.models.motor_speed import CURVE, DELAY, EXPONENT, LAG_DOWN, LAG_UP, LEAD, VOLTAGE
from rotorid.models.parameter import ParameterSet
from rotorid.simulation.nonlinear import NonlinearSensitivities, delayed_pieces, planned
from rotorid.typing import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class MotorSpeedProblem(NonlinearProblem):
    """Fit a structure of :func:`rotorid.models.motor_speed.motor_speed_model`, some of its motors left out or not."""

    def _sensitivities(self, parameters: ParameterSet, record: TimeData, start: FloatArray) -> NonlinearSensitivities:
        from rotorid.fitting.motors.following_kernels import FACTOR, START, follow, seen

        structure, values, rate_hz = self.structure, parameters.values, record.sample_rate_hz
        chain = dict(zip(parameters.names, parameters.directions, strict=True))
        zero = np.zeros(parameters.directions.shape[1])
        shared = [chain.get(name, zero) for name in (LAG_UP, LAG_DOWN, DELAY, *CURVE, "", EXPONENT)]
        others = [name for name in parameters.names if name.startswith("f_")]
        factors: list[tuple[float, FloatArray]] = []
        for state in structure.states:
            name = f"f_{state.rsplit('_', 1)[1]}"
            if name in values:
                factors.append((values[name], chain[name]))
            else:
                rest = sum((chain[other] for other in others), start=zero)
                factors.append((1.0 + len(others) - sum(values[other] for other in others), -rest))
        constants = structure.constants
        fixed = [values[LAG_UP], values[LAG_DOWN], *(values[name] for name in CURVE)]
        ends = [values.get(EXPONENT, 0.0), constants["u_0"], constants.get("V_0", np.nan)]
        numbers = np.array([[*fixed, factor, *ends] for factor, _ in factors])

        only_delay = np.array([[float(name == DELAY)] for name in structure.parameters.names])
        pieces = delayed_pieces(structure, values, only_delay, rate_hz)
        hold = self.scheme.hold
        plan = planned(
            pieces, self.scheme.tableau.c, substeps=self.scheme.substeps, interval_s=1.0 / rate_hz, hold=hold
        )
        weights = np.vstack([self.scheme.tableau.a, self.scheme.tableau.b])
        states = np.zeros((record.samples, len(structure.states), START + 1))
        states[0, :, 0], states[0, :, START] = start, 1.0
        inputs = structure.inputs
        places = np.array([inputs.index(f"motor_{state.rsplit('_', 1)[1]}") for state in structure.states])
        voltage = inputs.index(VOLTAGE) if VOLTAGE in inputs else -1
        follow(
            numbers,
            places,
            voltage,
            weights,
            plan.lengths,
            plan.pieces,
            *pieces.between(record.inputs, record.before),
            plan.ages,
            states,
        )
        moving = pieces.at_samples(record.inputs, record.before, hold=hold)
        outputs, by_lead = np.empty_like(states), np.empty(states.shape[:2])
        seen(numbers, places, voltage, values[LEAD], moving, states, outputs, by_lead)

        unknown = self._unknown_states
        slopes = np.empty((*by_lead.shape, zero.size + int(unknown.sum())))
        for motor, (_, of_factor) in enumerate(factors):
            rows = np.stack([of_factor if place == FACTOR else row for place, row in enumerate(shared, start=1)])
            own = np.eye(len(structure.states))[motor, unknown]
            slopes[:, motor, : zero.size] = outputs[:, motor, 1:START] @ rows + np.outer(by_lead[:, motor], chain[LEAD])
            slopes[:, motor, zero.size :] = np.outer(outputs[:, motor, START], own)
        return NonlinearSensitivities(outputs=np.ascontiguousarray(outputs[..., 0]), slopes=slopes)
