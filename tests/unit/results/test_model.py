"""What identify answers is a model: it answers, simulates, shows itself, and is the same after it was saved."""

from __future__ import annotations

import pickle
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from tests.unit.identifying.response_twins import flight, identified

from rotorid.documents.result import load, result_document, save
from rotorid.errors import UsageError
from rotorid.identifying.comparison import compare
from rotorid.identifying.identification import identify
from rotorid.results.model import IdentifiedModel

OMEGA = np.geomspace(0.5, 20.0, 7)


@pytest.fixture(scope="module")
def model() -> IdentifiedModel:
    return identified("response.second_order", 1)


@pytest.fixture(scope="module")
def loaded(model: IdentifiedModel, tmp_path_factory: pytest.TempPathFactory) -> IdentifiedModel:
    folder = tmp_path_factory.mktemp("saved")
    save(model, folder)
    return load(folder)


def test_parameters_are_had_by_name(model: IdentifiedModel) -> None:
    gain = model["K_phi"]
    assert gain is model.parameters["K_phi"]
    assert gain.std == pytest.approx(model.bounds.std[model.bounds.names.index("K_phi")])
    assert "K_phi" in model
    assert "L_p" not in model
    with pytest.raises(UsageError, match=r"no parameter L_p.*K_phi"):
        model["L_p"]


def test_it_responds_and_simulates_as_its_structure_does(model: IdentifiedModel) -> None:
    exact = model.system.response(OMEGA)
    np.testing.assert_allclose(model.response(OMEGA), exact)
    steady = model.simulate(np.ones(4000), sample_rate_hz=100.0)[0, -1]
    assert steady == pytest.approx(model["K_phi"].value, rel=1e-6)


def test_poles_have_errors(model: IdentifiedModel) -> None:
    pole = model.poles[0]
    assert pole.frequency_rad_s == pytest.approx(model["omega_phi"].value)
    assert pole.frequency_std_rad_s == pytest.approx(model["omega_phi"].std)


def test_a_loaded_model_answers_the_same(model: IdentifiedModel, loaded: IdentifiedModel) -> None:
    assert loaded.parameters == model.parameters
    assert loaded.bounds.names == model.bounds.names
    np.testing.assert_allclose(loaded.bounds.covariance, model.bounds.covariance, rtol=1e-9)
    np.testing.assert_allclose(loaded.response(OMEGA), model.response(OMEGA), rtol=1e-12)
    step = np.ones(50)
    np.testing.assert_allclose(
        loaded.simulate(step, sample_rate_hz=50.0), model.simulate(step, sample_rate_hz=50.0), rtol=1e-12
    )
    for mine, theirs in zip(loaded.poles, model.poles, strict=True):
        assert mine.value == pytest.approx(theirs.value)
        assert mine.frequency_std_rad_s == pytest.approx(theirs.frequency_std_rad_s)
    np.testing.assert_array_equal(loaded.data.response.values, model.data.response.values)
    np.testing.assert_array_equal(loaded.data.simulated[0].simulated, model.data.simulated[0].simulated)


def test_a_loaded_model_says_the_same_of_itself(model: IdentifiedModel, loaded: IdentifiedModel) -> None:
    mine, theirs = result_document(loaded), result_document(model)
    np.testing.assert_allclose(mine.correlation.matrix, theirs.correlation.matrix, rtol=1e-9)  # type: ignore[union-attr]
    assert mine.model_copy(update={"correlation": None}) == theirs.model_copy(update={"correlation": None})


def test_models_in_memory_compare(model: IdentifiedModel) -> None:
    other = identified("response.first_order", 1)
    found = compare([model, other], [flight(3)])
    assert [entry.label for entry in found.entries] == ["response.second_order", "response.first_order"]
    assert found.on_logs["response.second_order"].mean_percent > found.on_logs["response.first_order"].mean_percent


def test_options_may_be_given_by_name() -> None:
    shorter = identify(flight(1), "response.second_order", segments=(), seed=3)
    assert shorter.provenance.seed == 3
    with pytest.raises(TypeError, match="did you mean"):
        identify(flight(1), "response.second_order", sed=3)  # type: ignore[call-arg]


def test_it_shows_itself_in_few_lines(model: IdentifiedModel) -> None:
    lines = repr(model).splitlines()
    assert lines[0] == "response.second_order: phi_setpoint to phi, by output error"
    assert len(lines) <= 20
    assert any(line.split()[:1] == ["K_phi"] for line in lines)
    assert "<td>K_phi</td>" in model._repr_html_()


def test_it_pickles(model: IdentifiedModel) -> None:
    assert pickle.loads(pickle.dumps(model)).parameters == model.parameters


@pytest.mark.skipif(find_spec("control") is not None, reason="python-control is installed")
def test_without_python_control_it_says_what_to_install(model: IdentifiedModel) -> None:
    with pytest.raises(UsageError, match="pip install control"):
        model.to_control()


def test_what_is_no_result_does_not_load(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        load(tmp_path)


def test_python_control_gets_the_same_model(model: IdentifiedModel) -> None:
    pytest.importorskip("control")
    exact = model.response(OMEGA)
    plant = model.to_control()
    np.testing.assert_allclose(np.asarray(plant(1j * OMEGA)).reshape(exact.shape), exact, rtol=1e-6)
    assert list(plant.input_labels) == list(model.structure.inputs)
    measured = model.measured_to_control()
    assert list(measured.output_labels) == list(model.data.response.outputs)


def test_scipy_gets_the_same_model_continuous_and_sampled(model: IdentifiedModel) -> None:
    from scipy.signal import dlsim

    exact = model.response(OMEGA)
    plant = model.to_scipy(pade_order=6)
    answer = [(plant.C @ np.linalg.solve(1j * w * np.eye(len(plant.A)) - plant.A, plant.B) + plant.D) for w in OMEGA]
    np.testing.assert_allclose(np.moveaxis(answer, 0, -1), exact, rtol=1e-6)
    u = np.sign(np.sin(0.3 * np.arange(80)))
    sampled = model.to_scipy(sample_rate_hz=50.0)
    _, y, _ = dlsim(sampled, u)
    np.testing.assert_allclose(y[:, 0], model.simulate(u, sample_rate_hz=50.0, hold="zero")[0], atol=1e-9)


def test_python_control_gets_a_sampled_model(model: IdentifiedModel) -> None:
    control = pytest.importorskip("control", reason="python-control is not installed")
    u = np.sign(np.sin(0.3 * np.arange(80)))
    sampled = model.to_control(sample_rate_hz=50.0)
    assert sampled.dt == 0.02
    y = np.asarray(control.forced_response(sampled, inputs=u).outputs).reshape(-1)
    np.testing.assert_allclose(y, model.simulate(u, sample_rate_hz=50.0, hold="zero")[0], atol=1e-9)
    assert len(model.to_control(delays="none").state_labels) == len(model.structure.states)
