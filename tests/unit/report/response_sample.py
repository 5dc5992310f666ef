"""A finished run of ``response`` out of thin air: two inputs, two outputs, one pair of which nothing can be used."""

from __future__ import annotations

import dataclasses

import numpy as np
from tests.unit.report.sample import sweep

from rotorid.data.findings import Finding
from rotorid.data.response import Estimate, FrequencyResponse
from rotorid.flights.measure import Measured
from rotorid.loops.rate_loops import AxisLoop
from rotorid.loops.responses import ResponseRecord, Responses
from rotorid.results.provenance import Provenance
from rotorid.results.segment import Segment
from rotorid.spectral.estimate import Diagnostics
from rotorid.spectral.loops import sensitivity
from rotorid.spectral.margins import disturbance_rejection, loop_margins
from rotorid.typing import BoolArray, FloatArray

INPUTS, OUTPUTS, WINDOWS_S = ("roll_command", "yaw_command"), ("p", "ay"), (20.0, 10.0, 5.0)
POINTS = 80
HOLLOW = "ay/yaw_command"

OMEGA: FloatArray = np.geomspace(0.5, 80.0, POINTS)
# Integrator and delay: crossover at 20 rad/s with 90° less 34.4°, a phase crossover at π/2/0.03 = 52.4 rad/s.
CROSSOVER_RAD_S, DELAY_S = 20.0, 0.03


def measured_response(*, seed: int = 0, estimate: Estimate = "joint") -> FrequencyResponse:
    rng = np.random.default_rng(seed)
    coherence = np.broadcast_to(0.95 / (1.0 + (OMEGA / 60.0) ** 6), (2, 2, POINTS)).copy()
    coherence[1, 1] = 0.05
    error = np.sqrt(1.0 - coherence) / np.sqrt(2.0 * coherence * 10.0)
    noise = rng.standard_normal((2, 2, POINTS)) + 1j * rng.standard_normal((2, 2, POINTS))
    gains = np.array([[400.0, 3.0], [20.0, 0.2]])[:, :, None]
    return FrequencyResponse(
        omega_rad_s=OMEGA,
        values=gains / (1j * OMEGA + 4.0) * (1.0 + error * noise),
        coherence=coherence,
        random_error=error,
        covariance=np.zeros((2, 2, POINTS, POINTS), dtype=np.complex128),
        inputs=INPUTS,
        outputs=OUTPUTS,
        estimate=estimate,
        instruments=("roll_excitation", "yaw_excitation") if estimate == "joint" else (),
        windows_s=WINDOWS_S,
    )


def axis_loop() -> AxisLoop:
    values = CROSSOVER_RAD_S * np.exp(-1j * OMEGA * DELAY_S) / (1j * OMEGA)
    error = 0.02
    loop = FrequencyResponse(
        omega_rad_s=OMEGA,
        values=values[None, None],
        coherence=np.full((1, 1, POINTS), 0.9),
        random_error=np.full((1, 1, POINTS), error),
        covariance=2.0 * np.diag(np.abs(error * values) ** 2).astype(np.complex128)[None, None],
        inputs=("roll_command",),
        outputs=("roll_feedback",),
        estimate="joint",
    )
    return AxisLoop(
        method="measured with roll_excitation, all loops closed",
        loop=loop,
        margins=loop_margins(loop),
        rejection=disturbance_rejection(sensitivity(loop)),
        attitude=None,
        scope="whole",
    )


def diagnostics() -> Diagnostics:
    shape = (2, 2, len(WINDOWS_S), POINTS)
    moving = np.broadcast_to(np.array([[1.0, 0.35], [0.35, 1.0]])[:, :, None], (2, 2, POINTS))
    return Diagnostics(
        windows_s=WINDOWS_S,
        share=np.full(shape, 1.0 / 3.0),
        window_error=np.full(shape, 0.05),
        multiple_coherence=np.full((2, POINTS), 0.9),
        leakage=np.full((2, 2, POINTS), 0.03 + 0.0j),
        input_coherence=moving,
        condition=np.full(POINTS, 4.25),
    )


def segments(record: str) -> tuple[Segment, ...]:
    """One stretch with two sweeps in it, as wide as data are cut around excitations."""
    first, second = sweep(12.0, record=record), sweep(62.0, record=record)
    values = np.hstack([first.history.values, second.history.values])
    return (dataclasses.replace(first, history=dataclasses.replace(first.history, values=values)),)


def findings(record: str) -> list[Finding]:
    return [
        Finding(kind="unheard_of", severity="warning", where=record, message=f"A file was named {record}."),
        Finding(
            kind="saturation", severity="info", where="motor_3", message="It saturated.", numbers={"fraction": 0.03}
        ),
    ]


def responses(
    *, record: str = "roll_sweeps.ulg", estimate: Estimate = "joint", used: BoolArray | None = None
) -> Responses:
    """The run; ``used`` overrides what can be used, shape ``(2, 2, 80)``."""
    response = measured_response(estimate=estimate)
    direct = measured_response(seed=1, estimate="direct") if estimate == "joint" else None
    usable = response.coherence >= 0.3 if used is None else used
    measured = Measured(
        response=response,
        direct=direct,
        diagnostics=diagnostics(),
        segments=segments(record),
        asked_rad_s=(0.4, 90.0),
        excited_rad_s=dict.fromkeys(INPUTS, np.inf),
        findings=(),
    )
    return Responses(
        measured=measured,
        used=usable,
        loops={"roll": axis_loop()},
        least_coherence=0.3,
        records=tuple(
            ResponseRecord(
                record=record,
                axis="roll",
                kind="sweep",
                start_s=start,
                stop_s=start + 40.0,
                band_rad_s=(0.6, 50.0),
                origin="found",
                signal="roll_excitation",
                coherence={"p/roll_command": coherence},
                used=coherence > 0.5,
            )
            for start, coherence in ((12.0, 0.93), (52.0, 0.91), (112.0, 0.21))
        ),
        findings=tuple(findings(record)),
        provenance=Provenance(
            command=("rotorid", "response", record, "--inputs", "roll_command,yaw_command", "--outputs", "p,ay"),
            inputs={record: "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"},
            settings={"coherence": 0.3, "windows_s": [], "band_rad_s": None},
            estimate=estimate,
            instruments=response.instruments,
        ),
    )
