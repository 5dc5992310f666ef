"""A limit of thrust in the model of a flight: found where it was reached, not looked for above what was flown."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rotorid.identifying.identification import identify
from rotorid.io.tables import write_csv
from rotorid.models.library import nonlinear_model
from rotorid.simulation.nonlinear import simulate_nonlinear
from rotorid.units import STANDARD_GRAVITY_M_S2

RATE_HZ, SAMPLES, CLIMB_S = 50.0, 1000, 0.3
UNITS = {"velocity_down": "m/s", "phi": "rad", "theta": "rad"}
NOISE = {"velocity_down": 0.02, "phi": 0.003, "theta": 0.003}


def flown(file: Path, limit: float) -> Path:
    """Climbs and tilts by random binary signals, with noise."""
    model, rng = nonlinear_model("flight.first_order_limit"), np.random.default_rng(4)
    truth = model.parameters.values | {"n_max": limit, "K_down": 1.1, "T_down": CLIMB_S}

    def switched(hold: int, size: float) -> np.ndarray:
        return size * np.repeat(rng.choice([-1.0, 1.0], SAMPLES // hold + 1), hold)[:SAMPLES]

    u = np.stack([switched(40, 0.12), switched(45, 0.12), np.zeros(SAMPLES), switched(90, 1.5)])
    u[:, :50] = 0.0
    y = simulate_nonlinear(model, truth, u, sample_rate_hz=RATE_HZ, before=u[:, 0])
    columns = {name: row for name, row in zip(model.inputs, u, strict=True) if name != "r_setpoint"}
    columns |= {
        name: row + NOISE[name] * rng.standard_normal(SAMPLES)
        for name, row in zip(model.outputs, y, strict=True)
        if name in NOISE
    }
    units = {name: UNITS[name.removesuffix("_setpoint")] for name in columns}
    write_csv(file, np.arange(SAMPLES) / RATE_HZ, columns, units)
    return file


@pytest.mark.slow
@pytest.mark.parametrize("limit", [1.3, 5.0])
def test_a_limit_of_thrust_is_found_where_it_was_reached(limit: float, tmp_path: Path) -> None:
    log = flown(tmp_path / "flight.csv", limit)
    found = identify(str(log), "flight.first_order_limit", outputs=tuple(NOISE))
    said = [finding for finding in found.findings if finding.kind == "thrust_limit"]
    climb = found["T_down"]
    assert abs(climb.value - CLIMB_S) <= 3.0 * climb.std
    assert climb.std < 0.05 * CLIMB_S
    if limit < 2.0:
        assert abs(found["n_max"].value - limit) <= 3.0 * found["n_max"].std
        assert found["n_max"].std < 0.01
        assert said == []
        return
    (remark,) = said
    assert found["n_max"].status == "fixed"
    assert 1.3 < remark.numbers["highest"] < limit


def test_what_the_limit_does_not_touch_stays() -> None:
    free, ended = nonlinear_model("flight.first_order"), nonlinear_model("flight.first_order_limit")
    rng, u = np.random.default_rng(0), np.zeros((4, 100))
    u[[0, 1, 3], 10:] = [[0.1], [-0.1], [-0.6]]
    values = free.parameters.values | {"k_Dx": float(rng.uniform(0.2, 0.3))}
    plain, high, low = (
        simulate_nonlinear(model, known, u, sample_rate_hz=RATE_HZ, before=u[:, 0])
        for model, known in ((free, values), (ended, values | {"n_max": 50.0}), (ended, values | {"n_max": 1.05}))
    )
    np.testing.assert_allclose(high, plain, rtol=0.0, atol=1e-9)
    climb = free.outputs.index("velocity_down")
    rises = RATE_HZ * np.diff(-np.stack([plain[climb], low[climb]])).max(axis=1)
    assert rises[1] <= 0.05 * STANDARD_GRAVITY_M_S2 + 1e-6 < 0.5 * rises[0]
