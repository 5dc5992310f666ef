"""Short flights of a known response to a roll set-point, as logs and as results of ``identify``."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from rotorid.data.record import Channel, FlightRecord, Source, Topic
from rotorid.documents.result import result_document
from rotorid.fitting.time.output_error import TimeData, TimeProblem
from rotorid.identifying.identification import identify
from rotorid.models.library import response_model
from rotorid.report.files import to_json
from rotorid.results.model import IdentifiedModel

RATE_HZ, SAMPLES, NOISE_RAD = 20.0, 300, 0.004
TRUE = {"K_phi": 0.95, "omega_phi": 7.0, "zeta_phi": 0.6}
SECOND = response_model("response.second_order", [("phi_setpoint", "phi")])
FIRST = response_model("response.first_order", [("phi_setpoint", "phi")])


@cache
def flight(seed: int, *, samples: int = SAMPLES) -> FlightRecord:
    """Random binary set-points and the angle that follows them, with noise."""
    rng = np.random.default_rng(seed)
    u = 0.1 * np.repeat(rng.choice([-1.0, 1.0], size=samples // 10 + 1), 10)[:samples]
    data = TimeData(name="twin", inputs=u[None], outputs=np.zeros((1, samples)), sample_rate_hz=RATE_HZ)
    values = SECOND.parameters.with_values(TRUE)
    problem = TimeProblem(structure=SECOND, parameters=values, records=(data,), hold="zero", unknowns=())
    phi = problem.predicted(values.pack())[0].predicted[0]
    return FlightRecord(
        source=Source(name=f"flight_{seed}.csv", format="CSV", sha256=f"{seed:064x}"),
        topics=(
            Topic(
                name="log",
                time_s=np.arange(samples) / RATE_HZ,
                channels=(Channel(name="phi_setpoint", unit="rad"), Channel(name="phi", unit="rad")),
                values=np.stack([u, phi + NOISE_RAD * rng.standard_normal(samples)]),
            ),
        ),
    )


@cache
def identified(model: str, seed: int) -> IdentifiedModel:
    """What ``identify`` answers for one flight."""
    return identify([flight(seed)], model)


def written(folder: Path, model: str, seed: int) -> Path:
    """The files of a result that a comparison reads."""
    found = identified(model, seed)
    folder.mkdir(parents=True)
    (folder / "result.json").write_text(to_json(result_document(found)), encoding="utf-8")
    (folder / "model.toml").write_text(found.to_toml(), encoding="utf-8")
    return folder
