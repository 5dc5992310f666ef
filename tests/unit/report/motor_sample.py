"""A fit of ``physical.motors`` out of thin air: a sweep of roll, one of thrust, and an unseen doublet."""

from __future__ import annotations

import numpy as np

from rotorid.data.record import Maneuver
from rotorid.data.response import FrequencyResponse
from rotorid.documents.base import ProvenanceDocument
from rotorid.documents.result import ResultDocument
from rotorid.report.parts import Shown
from rotorid.results.model import FittedData, SimulatedRecord, Verifications
from rotorid.results.summary import (
    Checks,
    Correlation,
    Derived,
    ExcitedFlight,
    FitEnd,
    MotorPhysics,
    ParameterEstimate,
    RecordFit,
)
from rotorid.typing import FloatArray
from rotorid.verification.verification import Scores, Verification

CHANNELS = ["p_dot", "az"]
MOTORS = ["motor_1", "motor_2", "motor_3", "motor_4"]
SAMPLES = 200


def free(value: float, unit: str, std: float) -> ParameterEstimate:
    return ParameterEstimate(
        value=value, unit=unit, std=std, cramer_rao_percent=1.0, insensitivity_percent=0.5, status="free"
    )


def parameters() -> dict[str, ParameterEstimate]:
    return {
        "m": ParameterEstimate(value=1.2, unit="kg", status="fixed"),
        "c_0": free(0.3, "N", 0.02),
        "c_1": free(1.5, "N", 0.08),
        "c_2": free(6.0, "N", 0.1),
        "I_xx": free(0.015, "kg m^2", 0.0002),
        "L_p": free(-1.0, "1/s", 0.1),
        "tau_accel": free(0.006, "s", 0.001),
        "T_motor": free(0.035, "s", 0.0011),
        "tau_gyro": free(0.0062, "s", 0.0005),
    }


def motors() -> MotorPhysics:
    return MotorPhysics(
        layout="quad.x",
        arm_m=0.28,
        rotors=((0.2, 0.2, 0.0), (-0.2, -0.2, 0.0), (0.2, -0.2, 0.0), (-0.2, 0.2, 0.0)),
        spins=(
            1.0,
            1.0,
            -1.0,
            -1.0,
        ),
        outputs="output",
        source="actuator_outputs",
        outputs_rate_hz=400.0,
        curve="polynomial",
        hover_output=0.575,
        flown_outputs=(0.41, 0.72),
        scale="m",
        derived={
            "thrust_hover": Derived(value=3.146, std=0.007, unit="N"),
            "thrust_slope": Derived(value=8.4, std=0.05, unit="N"),
            "thrust_full": Derived(value=7.8, std=0.03, unit="N"),
            "thrust_to_weight": Derived(value=2.65, std=0.01, unit="1"),
        },
        excitation=[
            ExcitedFlight(
                record="roll.ulg",
                start_s=10.0,
                stop_s=50.0,
                sample_rate_hz=250.0,
                correlation={"az": 0.1, "p": 0.97, "q": 0.5, "r": 0.3},
                counted=("p",),
            ),
            ExcitedFlight(
                record="thrust.ulg",
                start_s=20.0,
                stop_s=60.0,
                sample_rate_hz=250.0,
                correlation={"az": 0.95, "p": 0.4, "q": 0.5, "r": 0.3},
                counted=("az",),
            ),
        ],
    )


def document() -> ResultDocument:
    found = parameters()
    names = [name for name, one in found.items() if one.status == "free"]
    matrix = np.eye(len(names))
    low, high = names.index("c_1"), names.index("c_2")
    matrix[low, high] = matrix[high, low] = -0.9
    return ResultDocument(
        model="physical.motors",
        inputs=MOTORS,
        outputs=CHANNELS,
        states=["p", "w"],
        parameters=found,
        fit_percent={"p_dot": 91.0, "az": 82.0},
        fit=FitEnd(
            weights="likelihood",
            outcome="The cost rests.",
            evaluations=3,
            trace=(
                9.0,
                4.0,
            ),
            inflation=1.2,
        ),
        method="prediction_error",
        hold="zero",
        records=[
            RecordFit(
                record=one.record,
                start_s=one.start_s,
                stop_s=one.stop_s,
                samples=SAMPLES,
                sample_rate_hz=250.0,
                fit_percent=percents,
            )
            for one, percents in zip(motors().excitation, ({"p_dot": 91.0}, {"az": 82.0}), strict=True)
        ],
        correlation=Correlation(names=tuple(names), matrix=tuple(map(tuple, matrix.tolist()))),
        verification=Checks(
            records={
                "verify.ulg at 39.3 s": {
                    "p_dot": Scores(nrmse_fit_percent=71.0, tic=0.14, rms=0.35, bias=0.0, reference_shift=0.0),
                    "az": Scores(nrmse_fit_percent=44.0, tic=0.22, rms=0.2, bias=0.0, reference_shift=0.0),
                }
            }
        ),
        motors=motors(),
        provenance=ProvenanceDocument(
            version="0", command=["rotorid", "identify"], inputs={}, settings={"arm_m": 0.28}, seed=0
        ),
    )


def time_s(start_s: float) -> FloatArray:
    return start_s + np.arange(SAMPLES) / 250.0


def identified() -> Shown:
    rng = np.random.default_rng(2)
    rows = rng.standard_normal((3, 2, SAMPLES))
    outputs = 0.1 * rng.standard_normal((3, 4, SAMPLES))
    stretches = zip(("roll.ulg", "thrust.ulg"), (10.0, 20.0), rows[:2], outputs[:2], strict=True)
    nothing = np.zeros((len(CHANNELS), len(MOTORS), 0))
    response = FrequencyResponse(
        omega_rad_s=np.zeros(0),
        values=nothing.astype(np.complex128),
        coherence=nothing,
        random_error=nothing,
        covariance=np.zeros((*nothing.shape, 0), dtype=np.complex128),
        inputs=tuple(MOTORS),
        outputs=tuple(CHANNELS),
        estimate="direct",
    )
    unseen = (
        Verification(
            record="verify.ulg",
            maneuver=Maneuver(axis="roll", kind="doublet", start_s=39.3, stop_s=41.0),
            time_s=time_s(39.3),
            inputs=outputs[2],
            measured=np.vstack([rows[2], rows[2, :1]]),
            predicted=0.9 * np.vstack([rows[2], rows[2, :1]]),
            input_names=tuple(MOTORS),
            output_names=("az", "p_dot", "q_dot"),
            scores={},
            moved=("p_dot", "az"),
        ),
    )
    simulated = tuple(
        SimulatedRecord(
            record=name,
            maneuver=Maneuver(axis="roll", kind="sweep", start_s=start_s, stop_s=start_s + 1.0),
            time_s=time_s(start_s),
            inputs=inputs,
            measured=pair,
            simulated=0.9 * pair,
        )
        for name, start_s, pair, inputs in stretches
    )
    return Shown(
        document=document(),
        data=FittedData(
            response=response,
            direct=None,
            model_response=response.values,
            used=np.zeros(response.values.shape, dtype=np.bool_),
            simulated=simulated,
        ),
        verifications=Verifications(maneuvers=unseen),
    )
