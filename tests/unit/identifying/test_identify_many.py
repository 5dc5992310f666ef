"""Several models at once: on workers as one after the other."""

from __future__ import annotations

import pytest
from tests.unit.data.test_sensor_filters import sweep_record

from rotorid.documents.base import to_json
from rotorid.documents.results import results_document
from rotorid.identifying.identify_many import identify_several


@pytest.mark.slow  # two processes import everything
def test_workers_give_the_same_models_and_refusals() -> None:
    models = ["rate.roll", "rate.pitch"]
    alone, shared = (identify_several(sweep_record(), models, workers=workers) for workers in (None, 2))
    assert list(shared) == models
    assert shared.identified.keys() == {"rate.roll"}
    assert shared.refused.keys() == {"rate.pitch"}
    for name in alone["rate.roll"].parameters:  # type: ignore[union-attr]
        values = [answers["rate.roll"].parameters[name].value for answers in (alone, shared)]  # type: ignore[union-attr]
        # One thread for linear algebra rounds sums otherwise than two.
        assert values[1] == pytest.approx(values[0], rel=1e-6, abs=1e-9)
    assert '"rate.pitch"' in to_json(results_document(shared))
