"""A finished verification out of thin air: a doublet in open loop, ahead and in closed loop, and an unseen sweep."""

from __future__ import annotations

import dataclasses

from tests.unit.report.sample import document, doublet, judged, maneuver

from rotorid.checking.checks import sweep_check
from rotorid.documents.verify import VerifyDocument, guideline_document
from rotorid.results.model import Verifications
from rotorid.results.summary import ClosedLoopScores, SignalScore
from rotorid.verification.closed_loop import ClosedLoop, LoopScores
from rotorid.verification.prediction import Horizon, HorizonScores, Prediction
from rotorid.verification.verification import Verification


def flown(*, record: str = "roll_doublet.ulg") -> Verification:
    one = doublet(record=record)
    scores = HorizonScores(nrmse_fit_percent=88.0, tic=0.06, rms=0.07, skill=0.81)
    horizons = tuple(
        Horizon(
            horizon_s=horizon_s,
            time_s=one.time_s[100:],
            measured=one.measured[:, 100:],
            predicted=one.predicted[:, 100:],
            scores={"p": scores},
        )
        for horizon_s in (0.5, 1.0)
    )
    loop = LoopScores(nrmse_fit_percent=90.0, tic=0.05, rms=0.08)
    command = LoopScores(nrmse_fit_percent=70.0, tic=0.17, rms=0.01)
    return dataclasses.replace(
        one,
        ahead=Prediction(window_s=0.3, horizons=horizons, holds_s={"p": 1.9}),
        closed_loop=ClosedLoop(
            time_s=one.time_s,
            names=("p", "roll_command"),
            outputs=1,
            measured=[one.measured[0], one.inputs[0]],
            predicted=[one.predicted[0], 0.9 * one.inputs[0]],
            scores={"p": loop, "roll_command": command},
            setpoints={"roll_command": "phi_setpoint"},
            controller_tic={"roll_command": 0.03},
        ),
    )


def verify_document(*, record: str = "roll_doublet.ulg", scale: float | None = None) -> VerifyDocument:
    plain = document(record=record)
    loop = ClosedLoopScores(
        setpoints={"roll_command": "phi_setpoint"},
        controller_tic={"roll_command": 0.03},
        scores={
            "p": SignalScore(nrmse_fit_percent=90.0, tic=0.05, rms=0.08),
            "roll_command": SignalScore(nrmse_fit_percent=70.0, tic=0.17, rms=0.01),
        },
    )
    return VerifyDocument(
        model=plain.model,
        inputs=plain.inputs,
        outputs=plain.outputs,
        states=plain.states,
        maneuvers=[dataclasses.replace(maneuver(), closed_loop=loop)],
        frequency=[sweep_check(judged())],
        j_rms_guideline=guideline_document(scale),
        findings=plain.findings,
        provenance=plain.provenance,
    )


def found(*, record: str = "roll_doublet.ulg") -> Verifications:
    return Verifications(maneuvers=(flown(record=record),), sweeps=(judged(),))


def verified(*, record: str = "roll_doublet.ulg", scale: float | None = None) -> tuple[VerifyDocument, Verifications]:
    return verify_document(record=record, scale=scale), found(record=record)
