"""Plans on disk: the same after reading, and clear words for what is none."""

from pathlib import Path

import numpy as np
import pytest

from rotorid.documents.design import plan_document, read_plan
from rotorid.errors import UsageError
from rotorid.excitation.plan import planned, sequence
from rotorid.report.files import to_json


def test_a_plan_comes_back_from_its_file(tmp_path: Path) -> None:
    sweep = planned(
        "roll",
        "pilot_sweep",
        start_s=0.0,
        amplitude=0.1,
        band_rad_s=(1.0, 20.0),
        duration_s=10.0,
        sample_rate_hz=100.0,
        entry="rate_setpoint",
        seed=3,
        noise_fraction=0.1,
    )
    step = planned("yaw", "doublet", start_s=0.0, amplitude=-0.2, duration_s=1.0, sample_rate_hz=50.0)
    plan = sequence("two", [sweep, step], trim_s=2.5)
    (tmp_path / "plan.json").write_text(to_json(plan_document(plan)))
    again = read_plan(tmp_path / "plan.json")
    assert (again.name, again.trim_s, again.duration_s) == (plan.name, plan.trim_s, plan.duration_s)
    for one, other in zip(plan.inputs, again.inputs, strict=True):
        assert (one.axis, one.shape, one.entry, one.start_s, one.amplitude, one.band_rad_s, dict(one.settings)) == (
            (
                other.axis,
                other.shape,
                other.entry,
                other.start_s,
                other.amplitude,
                other.band_rad_s,
                dict(other.settings),
            )
        )
        # Nine digits after the point are kept.
        assert np.abs(one.values - other.values).max() <= 0.5e-9


@pytest.mark.parametrize(
    ("content", "words"),
    [("{}", "name: Field required"), ("nothing", "is not a plan"), ('{"schema": "rotorid.plan/2"}', "schema")],
)
def test_a_file_that_is_no_plan_is_told_from_one(tmp_path: Path, content: str, words: str) -> None:
    (tmp_path / "plan.json").write_text(content)
    with pytest.raises(UsageError, match=words):
        read_plan(tmp_path / "plan.json")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        read_plan(tmp_path / "none.json")
