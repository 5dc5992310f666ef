"""A finished identification out of thin air: a known first-order roll response with known noise."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from rotorid.data.record import Channel, Maneuver, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.documents.base import FindingDocument, ManeuverDocument, ProvenanceDocument
from rotorid.documents.result import DelaysDocument, MatricesDocument, ResultDocument
from rotorid.report.parts import Shown
from rotorid.results.model import FittedData, FrequencyCheck, Verifications
from rotorid.results.segment import Segment
from rotorid.results.summary import (
    Checks,
    Cost,
    ManeuverCheck,
    PairCost,
    ParameterEstimate,
    PoleEstimate,
    UnseenCombination,
)
from rotorid.typing import BoolArray, ComplexArray, FloatArray
from rotorid.verification.verification import Scores, Verdict, Verification

HOSTILE = "<script>alert(1)</script>"
GAIN, DAMPING, LAG, DELAY = 437.0, -4.2, 0.028, 0.0024
RATE_HZ = 200.0


def exact(omega: FloatArray) -> ComplexArray:
    s = 1j * omega
    return np.asarray(GAIN * np.exp(-s * DELAY) / ((s - DAMPING) * (LAG * s + 1.0)))


def response(*, seed: int = 0, points: int = 90, estimate: str = "joint") -> FrequencyResponse:
    rng = np.random.default_rng(seed)
    omega = np.geomspace(0.5, 90.0, points)
    coherence = 0.99 / (1.0 + (omega / 55.0) ** 6) / (1.0 + (0.9 / omega) ** 4)
    error = np.sqrt(1.0 - coherence) / np.sqrt(2.0 * coherence * 8.0)
    noise = (rng.standard_normal(points) + 1j * rng.standard_normal(points)) * error
    values = exact(omega) * (1.0 + noise)
    shape = (1, 1, points)
    return FrequencyResponse(
        omega_rad_s=omega,
        values=values.reshape(shape),
        coherence=coherence.reshape(shape),
        random_error=error.reshape(shape),
        covariance=np.zeros((1, 1, points, points), dtype=np.complex128),
        inputs=("roll_command",),
        outputs=("p",),
        estimate="direct" if estimate == "direct" else "joint",
        instruments=() if estimate == "direct" else ("roll_excitation",),
        windows_s=(5.0, 10.0, 20.0),
    )


def sweep(start_s: float, *, duration_s: float = 40.0, record: str = "roll_sweeps.ulg") -> Segment:
    time_s = np.arange(int((duration_s + 6.0) * RATE_HZ)) / RATE_HZ
    inside = (time_s > 3.0) & (time_s < 3.0 + duration_s)
    rate = 0.6 * (50.0 / 0.6) ** (np.clip(time_s - 3.0, 0.0, duration_s) / duration_s)
    u = np.where(inside, 0.035 * np.sin(np.cumsum(rate) / RATE_HZ), 0.0)
    return Segment(
        record=record,
        maneuver=Maneuver(
            axis="roll",
            kind="sweep",
            start_s=start_s,
            stop_s=start_s + duration_s,
            band_rad_s=(0.6, 50.0),
            signal="roll_excitation",
        ),
        history=TimeHistory(
            values=np.stack([u, answer(u)]),
            channels=(Channel(name="roll_command", unit="1"), Channel(name="p", unit="rad/s")),
            sample_rate_hz=RATE_HZ,
            start_s=start_s - 3.0,
        ),
    )


def answer(u: FloatArray) -> FloatArray:
    torque = rate = 0.0
    out = np.empty(u.size)
    for index, command in enumerate(u.tolist()):
        torque += (command - torque) / LAG / RATE_HZ
        rate += (DAMPING * rate + GAIN * torque) / RATE_HZ
        out[index] = rate
    return out


def doublet(*, record: str = "roll_doublet.ulg", seed: int = 1) -> Verification:
    rng = np.random.default_rng(seed)
    time_s = 612.0 + np.arange(int(3.0 * RATE_HZ)) / RATE_HZ
    phase = time_s - time_s[0]
    u = np.where((phase > 0.5) & (phase < 0.9), 0.05, 0.0) - np.where((phase >= 0.9) & (phase < 1.3), 0.05, 0.0)
    predicted = answer(u)
    return Verification(
        record=record,
        maneuver=Maneuver(axis="roll", kind="doublet", start_s=612.5, stop_s=613.3),
        time_s=time_s,
        inputs=u[None, :],
        measured=(predicted * 1.04 + 0.06 * rng.standard_normal(u.size))[None, :],
        predicted=predicted[None, :],
        input_names=("roll_command",),
        output_names=("p",),
        scores={"p": Scores(nrmse_fit_percent=92.4, tic=0.041, rms=0.063, bias=0.01, reference_shift=-0.004)},
    )


def findings() -> list[FindingDocument]:
    return [
        FindingDocument(
            kind="clock_skew",
            severity="info",
            where="vehicle_attitude",
            message="The topic's stamps come 3.1 ms late; nothing was shifted.",
            numbers={"late_s": 0.0031},
        ),
        FindingDocument(
            kind="low_coherence",
            severity="warning",
            where="p/roll_command",
            message="The coherence is below 0.6 above 55 rad/s; those points were left out of the fit.",
            numbers={"above_rad_s": 55.0, "lowest": 0.12},
        ),
        FindingDocument(kind="unheard_of", severity="warning", where=HOSTILE, message=f"A file was named {HOSTILE}."),
        FindingDocument(
            kind="saturation",
            severity="error",
            where="motor_3",
            message="Motor 3 was saturated for 3 % of the second sweep.",
            numbers={"fraction": 0.03},
        ),
    ]


def maneuver(*, verdict: Verdict = "good", tic: float = 0.041, fit: float = 92.4) -> ManeuverCheck:
    return ManeuverCheck(
        record="roll_doublet.ulg",
        axis="roll",
        kind="doublet",
        start_s=612.5,
        stop_s=613.3,
        verdict=verdict,
        scores={
            "p": Scores(nrmse_fit_percent=fit, tic=tic, rms=0.063, bias=0.01, reference_shift=-0.004),
            "r": Scores(nrmse_fit_percent=3.0, tic=0.9, rms=0.01, bias=0.0, reference_shift=0.0),
        },
        j_rms=1.4,
        biases={"p": 0.01},
        growth_1_s=0.0,
        moved=("p",),
    )


def judged() -> FrequencyCheck:
    measured = response()
    used: BoolArray = measured.coherence >= 0.6
    return FrequencyCheck(
        pairs={"p/roll_command": PairCost(value=12.3, band_rad_s=(1.1, 54.0), points=61)},
        records=("roll_again.ulg",),
        response=measured,
        model_response=exact(measured.omega_rad_s).reshape(1, 1, -1),
        used=used,
    )


def document(*, record: str = "roll_sweeps.ulg") -> ResultDocument:
    def parameter(value: float, unit: str, std: float, cr: float, insensitivity: float) -> ParameterEstimate:
        return ParameterEstimate(
            value=value, unit=unit, std=std, cramer_rao_percent=cr, insensitivity_percent=insensitivity, status="free"
        )

    return ResultDocument(
        model="rate.roll",
        inputs=["roll_command"],
        outputs=["p"],
        states=["p", "motor"],
        parameters={
            "L_roll": parameter(436.8, "rad/s^2", 3.1, 1.4, 0.5),
            "L_p": parameter(-4.31, "1/s", 0.42, 24.0, 11.2),
            "T_motor": parameter(0.02791, "s", 0.0006, 4.3, 2.0),
            "tau_roll": parameter(0.00243, "s", 0.00011, 9.1, 4.2),
            "L_v": ParameterEstimate(value=0.0, unit="1/(m s)", status="dropped"),
            "g": ParameterEstimate(value=9.80665, unit="m/s^2", status="fixed"),
        },
        cost=Cost(average=1.9, pairs={"p/roll_command": PairCost(value=1.9, band_rad_s=(1.1, 54.0), points=66)}),
        matrices=MatricesDocument(
            M=[[1.0, 0.0], [0.0, 0.0279]],
            F=[[-4.31, 436.8], [0.0, -1.0]],
            G=[[0.0], [1.0]],
            H0=[[1.0, 0.0]],
            H1=[[0.0, 0.0]],
            delays_s=DelaysDocument(inputs=[0.00243], outputs=[0.0]),
        ),
        poles=[
            PoleEstimate(real=-4.31, imag=0.0, damping=1.0, frequency_rad_s=4.31),
            PoleEstimate(real=-35.8, imag=0.0, damping=1.0, frequency_rad_s=35.8),
            PoleEstimate(real=0.12, imag=0.9, damping=-0.13, frequency_rad_s=0.91),
            PoleEstimate(real=0.12, imag=-0.9, damping=-0.13, frequency_rad_s=0.91),
        ],
        verification=Checks(
            records={
                "roll_doublet.ulg": {
                    "p": Scores(nrmse_fit_percent=92.4, tic=0.041, rms=0.063, bias=0.01, reference_shift=-0.004)
                }
            },
            frequency={"p/roll_command": 12.3},
            maneuvers=(maneuver(),),
        ),
        identifiability=[
            UnseenCombination(
                words="T_motor and tau_roll can be traded for each other", vector={"T_motor": 0.71, "tau_roll": -0.70}
            ),
        ],
        findings=findings(),
        provenance=ProvenanceDocument(
            version="0.1.0",
            command=["rotorid", "identify", record, "--model", "rate.roll", "--verify", "roll_doublet.ulg"],
            inputs={record: "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"},
            settings={"coherence": 0.6, "windows_s": [5.0, 10.0, 20.0], "reduce": False, "band": None},
            seed=0,
            estimate="joint",
            instruments=["roll_excitation"],
            maneuvers=[
                ManeuverDocument(
                    record=record,
                    axis="roll",
                    kind="sweep",
                    start_s=start,
                    stop_s=start + 40.0,
                    band_rad_s=(0.6, 50.0),
                    origin="found",
                    signal="roll_excitation",
                )
                for start in (12.0, 62.0)
            ],
        ),
    )


def identification(*, record: str = "roll_sweeps.ulg") -> Shown:
    measured = response()
    fitted: BoolArray = measured.coherence >= 0.6
    return Shown(
        document=document(record=record),
        data=FittedData(
            response=measured,
            direct=response(seed=3, estimate="direct"),
            model_response=exact(measured.omega_rad_s).reshape(1, 1, -1),
            used=fitted,
            segments=(sweep(12.0, record=record), sweep(62.0, record=record)),
        ),
        verifications=Verifications(maneuvers=(doublet(),), sweeps=(judged(),)),
    )


def shown_with(shown: Shown, **fields: Any) -> Shown:
    """The same with another document, other unseen maneuvers or other data."""
    own = {"document": fields.pop("document", shown.document)}
    if "verifications" in fields:
        own["verifications"] = dataclasses.replace(shown.verifications, maneuvers=fields.pop("verifications"))
    return dataclasses.replace(shown, data=dataclasses.replace(shown.data, **fields), **own)
