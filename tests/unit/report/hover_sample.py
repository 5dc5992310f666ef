"""A finished identification of pitch and heave out of thin air: two inputs, five outputs, unstable poles."""

from __future__ import annotations

import numpy as np
from tests.unit.report.sample import document, identification, shown_with

from rotorid.data.response import FrequencyResponse
from rotorid.documents.base import FindingDocument
from rotorid.documents.result import DelaysDocument, MatricesDocument, ResultDocument
from rotorid.report.parts import Shown
from rotorid.results.summary import (
    Checks,
    Correlation,
    Cost,
    DelayBudget,
    FitEnd,
    PairCost,
    ParameterEstimate,
    PoleEstimate,
    Range,
    ReductionStep,
)
from rotorid.typing import ComplexArray, FloatArray

INPUTS, OUTPUTS, POINTS = ("pitch_command", "thrust_command"), ("q", "u", "w", "ax", "az"), 40
OMEGA: FloatArray = np.geomspace(1.0, 40.0, POINTS)
FREE = {
    "M_u": (11.83, "rad/(s m)", 0.07),
    "X_u": (-0.261, "1/s", 0.005),
    "Z_w": (-0.72, "1/s", 0.02),
    "M_pitch": (149.2, "rad/s^2", 0.34),
    "X_pitch": (-7.12, "m/s^2", 0.035),
    "Z_thrust": (-13.8, "m/s^2", 0.05),
    "tau_pitch": (0.0397, "s", 0.00014),
}
DROPPED = ("M_q", "T_motor")
# The pair grows e-fold in 1/2.6 s.
GROWTH_1_S, SWING_RAD_S = 2.6, 4.3


def parameters() -> dict[str, ParameterEstimate]:
    free = {
        name: ParameterEstimate(
            value=value,
            unit=unit,
            std=std,
            cramer_rao_percent=158.6 if name == "X_u" else 4.0,
            insensitivity_percent=1.5,
            status="free",
        )
        for name, (value, unit, std) in FREE.items()
    }
    dropped = {name: ParameterEstimate(value=0.0, unit="1", status="dropped") for name in DROPPED}
    tied = ParameterEstimate(value=0.0397, unit="s", std=0.00014, status="tied")
    return {**free, **dropped, "tau_thrust": tied}


def steps() -> list[ReductionStep]:
    dropped = ReductionStep(
        parameter="M_q",
        action="dropped",
        reason="M_q is seen, but not apart from M_u.",
        value_before=0.88,
        insensitivity_percent=9.1,
        cramer_rao_percent=5765.0,
        mean_cost_before=0.25,
        mean_cost_after=2.24,
    )
    kept = ReductionStep(
        parameter="Z_w",
        action="protected",
        reason="Z_w is essential physics.",
        value_before=-0.72,
        insensitivity_percent=None,
        cramer_rao_percent=None,
        mean_cost_before=2.24,
        mean_cost_after=None,
    )
    return [dropped, kept]


def correlation(strongest: float = -0.97) -> Correlation:
    names = list(FREE)
    matrix = np.eye(len(names)) + 0.1 * (1.0 - np.eye(len(names)))
    matrix[0, 1] = matrix[1, 0] = strongest
    return Correlation(names=tuple(names), matrix=tuple(map(tuple, matrix.tolist())))


def delay(output: str, input: str) -> DelayBudget:
    # Accelerometers pass a filter that the log tells of.
    late = 0.005 if output in ("ax", "az") else 0.0
    return DelayBudget(
        input_delay_s=0.0397,
        motor_lag_s=0.0,
        output_delay_s=late,
        total_s=0.0397 + late,
        total_std_s=0.0004,
        known_filters_s=late or None,
    )


def poles() -> list[PoleEstimate]:
    size = float(np.hypot(GROWTH_1_S, SWING_RAD_S))
    pair = [
        PoleEstimate(
            real=GROWTH_1_S,
            imag=sign * SWING_RAD_S,
            damping=-GROWTH_1_S / size,
            frequency_rad_s=size,
            real_std=0.008,
            imag_std=0.009,
            damping_std=0.0008,
            frequency_std_rad_s=0.011,
        )
        for sign in (-1.0, 1.0)
    ]
    real = {"imag": 0.0, "damping": 1.0}
    slow = PoleEstimate(real=-0.14, frequency_rad_s=0.14, real_std=0.01, imag_std=0.0, **real)
    double = PoleEstimate(real=-4.6, frequency_rad_s=4.6, **real)
    return [*pair, slow, double]


def hover_document(*, record: str = "pitch_sweeps.ulg") -> ResultDocument:
    pairs = {
        f"{output}/{input}": PairCost(value=120.0 if output == "az" else 2.0, band_rad_s=(1.4, 31.8), points=30)
        for output in OUTPUTS
        for input in INPUTS
    }
    finding = FindingDocument(kind="dropped_parameter", severity="info", where="M_q", message=steps()[0].reason)
    told_once = FindingDocument(kind="dropped_parameter", severity="info", where="T_motor", message="No lag is seen.")
    changes = {
        "model": "hover.longitudinal",
        "inputs": list(INPUTS),
        "outputs": list(OUTPUTS),
        "states": ["q", "u", "w", "theta"],
        "parameters": parameters(),
        "cost": Cost(average=25.6, pairs=pairs),
        "fit": FitEnd(
            weights="covariance",
            outcome="The cost no longer falls.",
            evaluations=6,
            trace=(
                66.0,
                27.0,
                26.9,
            ),
            inflation=4.74,
        ),
        "reduction": steps(),
        "correlation": correlation(),
        "constants": {"g": 9.80665, "U0": 2.1, "theta0": -0.1, "phi0": 0.0},
        "matrices": MatricesDocument(
            M=np.eye(4).tolist(),
            F=(np.arange(16.0).reshape(4, 4) + 0.5).tolist(),
            G=[[149.2, 0.0], [-7.12, 0.0], [0.0, -13.8], [0.0, 0.0]],
            H0=np.zeros((5, 4)).tolist(),
            H1=np.zeros((5, 4)).tolist(),
            delays_s=DelaysDocument(inputs=[0.0397, 0.0397], outputs=[0.0] * 5),
        ),
        "poles": poles(),
        "delays": {f"{output}/{input}": delay(output, input) for output in OUTPUTS for input in INPUTS},
        "covered": {
            "u": Range(unit="m/s", lowest=-2.49, highest=3.37, rms=1.04),
            "theta": Range(unit="rad", lowest=-np.pi / 6.0, highest=np.pi / 9.0, rms=np.pi / 18.0),
            "thrust_command": Range(unit="1", lowest=-0.204, highest=0.152, rms=0.081),
            "battery_voltage": Range(unit="V", lowest=14.2, highest=16.1, rms=15.1),
        },
        "verification": Checks(frequency={"q/pitch_command": 4.7}),
        "identifiability": [],
        "findings": [finding, told_once],
    }
    return document(record=record).model_copy(update=changes)


def hover_response() -> FrequencyResponse:
    shape = (len(OUTPUTS), len(INPUTS), POINTS)
    return FrequencyResponse(
        omega_rad_s=OMEGA,
        values=np.broadcast_to(exact(), shape),
        coherence=np.full(shape, 0.95),
        random_error=np.full(shape, 0.02),
        covariance=np.zeros((*shape, POINTS), dtype=np.complex128),
        inputs=INPUTS,
        outputs=OUTPUTS,
        estimate="direct",
    )


def exact() -> ComplexArray:
    return np.asarray(150.0 * np.exp(-0.04j * OMEGA) / (1j * OMEGA + 1.0))


def hover_identification(*, record: str = "pitch_sweeps.ulg") -> Shown:
    measured = hover_response()
    return shown_with(
        identification(record=record),
        document=hover_document(record=record),
        response=measured,
        direct=None,
        model_response=np.broadcast_to(exact(), measured.values.shape),
        used=np.ones(measured.values.shape, dtype=bool),
        segments=(),
    )
