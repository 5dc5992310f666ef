"""The library: every file reads, and says what the papers say."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from rotorid.errors import ModelError
from rotorid.models.library import library_model, library_text, model_names
from rotorid.models.physical import hover_derivatives
from rotorid.models.state_space import StateSpace
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import from_toml, to_toml
from rotorid.units import STANDARD_GRAVITY_M_S2 as G
from rotorid.vehicles import s500

MATRICES = ("M", "F", "G", "H0", "H1", "input_delays_s", "output_delays_s")
DERIVATIVE = re.compile(r"[LMN]_[pqruvw]|[XYZ]_[pqruvw]")
OMEGA = np.geomspace(0.1, 100.0, 40)


def start(name: str) -> StateSpace:
    model = library_model(name)
    return model.matrices(model.parameters.values)


def without_lag(name: str, values: Mapping[str, float], outputs: tuple[str, ...] | None = None) -> StateSpace:
    """A model whose motors follow the commands at once, so that these stand in their place."""
    model = library_model(name).select(outputs=outputs)
    parameters = model.parameters.drop("T_motor").with_values(values)
    if "N_spin" in parameters.names:
        parameters = parameters.drop("N_spin")
    return model.condensed(parameters).matrices(parameters.values)


def at(model: LinearStructure, values: dict[str, float]) -> dict[str, float]:
    """Values of every parameter, zero where none is given; ties computed."""
    unlisted = {p.name: 0.0 for p in model.parameters if p.status != "tied"}
    return unlisted | values


def test_the_library_is_complete() -> None:
    assert model_names() == (
        "axis.pitch",
        "axis.roll",
        "axis.vertical",
        "axis.yaw",
        "hover.full",
        "hover.lateral",
        "hover.longitudinal",
        "physical.hover",
        "rig.attitude",
        "rig.roll",
    )


@pytest.mark.parametrize("name", model_names())
def test_a_model_says_what_it_is(name: str) -> None:
    model = library_model(name)
    assert model.name == name
    assert len(model.source) > 20
    assert "Fails" in library_text(name).split("schema =")[0]
    assert all(parameter.unit for parameter in model.parameters)
    for parameter in model.parameters:
        assert all(parameter.lower <= value <= parameter.upper for value in (parameter.value, *parameter.starts))


@pytest.mark.parametrize("name", model_names())
def test_a_model_reads_back_as_it_is_written(name: str) -> None:
    model = library_model(name)
    again = from_toml(to_toml(model, model.parameters, {}))
    for attribute in ("name", "inputs", "states", "outputs", "optional", "source"):
        assert getattr(again, attribute) == getattr(model, attribute), attribute
    assert dict(again.constants) == dict(model.constants)
    assert tuple(again.parameters) == tuple(model.parameters)
    shifted = {p.name: p.value + 0.01 for p in model.parameters}
    for attribute in MATRICES:
        one, other = model.matrices(shifted), again.matrices(shifted)
        np.testing.assert_allclose(
            getattr(one, attribute), getattr(other, attribute), rtol=1e-13, atol=0.0, err_msg=attribute
        )


@pytest.mark.parametrize("name", model_names())
def test_only_physics_bounds_a_parameter(name: str) -> None:
    for parameter in library_model(name).parameters:
        if DERIVATIVE.fullmatch(parameter.name):
            assert (parameter.lower, parameter.upper) == (-np.inf, np.inf), parameter.name
        if parameter.name.startswith("tau"):
            assert (parameter.lower, parameter.upper) == (0.0, 1.0), parameter.name
        if parameter.name == "T_motor":
            assert parameter.lower == 0.0


@pytest.mark.parametrize(
    ("name", "essential"),
    [
        ("hover.longitudinal", {"M_pitch", "Z_thrust", "tau_pitch", "tau_thrust"}),
        ("hover.lateral", {"L_roll", "N_yaw", "tau_roll", "tau_yaw"}),
        ("hover.full", {"L_roll", "M_pitch", "N_yaw", "Z_thrust", "tau_roll", "tau_pitch", "tau_yaw", "tau_thrust"}),
        ("axis.roll", {"L_roll", "tau_roll"}),
        ("axis.pitch", {"M_pitch", "tau_pitch"}),
        ("axis.yaw", {"N_yaw", "tau_yaw"}),
        ("axis.vertical", {"Z_thrust", "tau_thrust"}),
        ("rig.roll", {"J_x", "K_f", "tau_3", "tau_4"}),
    ],
)
def test_a_reduction_keeps_what_makes_the_vehicle_fly(name: str, essential: set[str]) -> None:
    assert {parameter.name for parameter in library_model(name).parameters if parameter.essential} == essential


@pytest.mark.parametrize(
    ("name", "values", "outputs", "published"),
    [
        ("hover.longitudinal", s500.LONGITUDINAL, ("q", "u", "w", "theta", "ax", "az"), s500.longitudinal()),
        ("hover.lateral", s500.LATERAL, ("p", "r", "v", "phi", "ay"), s500.lateral()),
    ],
)
def test_the_s500_is_the_published_one(
    name: str, values: Mapping[str, float], outputs: tuple[str, ...], published: StateSpace
) -> None:
    added = {"T_motor"} | ({"N_spin"} if name == "hover.lateral" else set())
    assert set(library_model(name).parameters.names) == {*values, *added}
    system = without_lag(name, values, outputs)
    for matrix in MATRICES:
        np.testing.assert_allclose(
            getattr(system, matrix), getattr(published, matrix), rtol=1e-12, atol=1e-12, err_msg=matrix
        )


def test_the_published_eigenvalues_of_the_s500() -> None:
    # Printed to two digits; the stable pair differs by its rounding, 0.02. The longitudinal ones are those computed
    # from the printed derivatives: the printed eigenvalues do not follow from them.
    lateral = without_lag("hover.lateral", s500.LATERAL).poles()
    np.testing.assert_allclose(lateral, [-3.88 - 0.62j, -3.88 + 0.62j, 1.87 - 3.58j, 1.87 + 3.58j], atol=0.025)
    longitudinal = without_lag("hover.longitudinal", s500.LONGITUDINAL).poles()
    np.testing.assert_allclose(longitudinal, [-0.176, -4.188, 2.857 - 4.140j, 2.857 + 4.140j], atol=6e-4)


def accelerations(state: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Rigid body in body axes: u', v', w', phi', theta' from u v w p q r phi theta and the specific force."""
    velocity, rates, (phi, theta) = state[:3], state[3:6], state[6:]
    gravity = G * np.array([-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)])
    p, q, r = rates
    motor_speed = [p + np.tan(theta) * (q * np.sin(phi) + r * np.cos(phi)), q * np.cos(phi) - r * np.sin(phi)]
    return np.concatenate([force + gravity - np.cross(rates, velocity), motor_speed])


@pytest.mark.parametrize(
    ("name", "of", "rows"),
    [
        ("hover.longitudinal", {"q": 4, "u": 0, "w": 2, "theta": 7}, {"u": 0, "w": 2, "theta": 4}),
        ("hover.lateral", {"p": 3, "r": 5, "v": 1, "phi": 6}, {"v": 1, "phi": 3}),
    ],
)
def test_trim_terms_are_those_of_a_rigid_body(name: str, of: dict[str, int], rows: dict[str, int]) -> None:
    """Without aerodynamic derivatives the model is the linearized rigid body, and the accelerometer reads nothing."""
    trim = {"U0": 1.7, "W0": -0.6, "theta0": 0.12, "phi0": -0.08}
    model = library_model(name).with_constants(trim)
    system = model.matrices(at(model, {}))
    point = np.array([trim["U0"], 0.0, trim["W0"], 0.0, 0.0, 0.0, trim["phi0"], trim["theta0"]])
    force = -accelerations(point, np.zeros(3))[:3]
    step = 1e-5
    for state, slot in of.items():
        shift = step * np.eye(8)[slot]
        slope = (accelerations(point + shift, force) - accelerations(point - shift, force)) / (2.0 * step)
        for row, wanted in rows.items():
            # The sine of a step errs by its third derivative, g h^2 / 6; the difference rounds off 1e-15 / h.
            found = system.F[model.states.index(row), model.states.index(state)]
            assert found == pytest.approx(slope[wanted], abs=1e-9), (row, state)
    _, _, C, D = system.proper()
    for output in ("ax", "ay", "az"):
        if output in model.outputs:
            np.testing.assert_allclose(C[model.outputs.index(output)], 0.0, atol=1e-12)
            np.testing.assert_allclose(D[model.outputs.index(output)], 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "output", "rate", "sign"),
    [
        ("axis.pitch", "ax", "q", -1.0),
        ("axis.roll", "ay", "p", 1.0),
        ("hover.longitudinal", "ax", "q", -1.0),
        ("hover.lateral", "ay", "p", 1.0),
        ("hover.full", "ax", "q", -1.0),
        ("hover.full", "ay", "p", 1.0),
    ],
)
def test_a_raised_accelerometer_feels_the_turning(name: str, output: str, rate: str, sign: float) -> None:
    """A point above the center of gravity moves back when the nose goes up, and right when the right side goes down."""
    height = 0.07

    def raised(z: float) -> np.ndarray:
        model = library_model(name)
        values = model.parameters.values
        if "z_imu" in values:
            return model.response(values | {"z_imu": z}, OMEGA)
        return model.with_constants({"z_imu": z}).response(values, OMEGA)

    outputs = library_model(name).outputs
    motor_speed = 1j * OMEGA * raised(0.0)[outputs.index(rate)]
    late = np.exp(-1j * OMEGA * library_model(name).parameters.values.get(f"tau_{output}", 0.0))
    difference = raised(height)[outputs.index(output)] - raised(0.0)[outputs.index(output)]
    np.testing.assert_allclose(difference, sign * height * motor_speed * late, rtol=1e-9, atol=1e-9)


def test_one_axis_of_the_full_model_is_the_model_of_that_axis() -> None:
    full = library_model("hover.full")
    values = full.parameters.values
    whole = full.response(values, OMEGA)
    for name in ("axis.roll", "axis.pitch", "axis.yaw", "axis.vertical"):
        model = library_model(name)
        own = {p: values.get(p, 0.0) for p in model.parameters.names}
        alone = model.response(own, OMEGA)
        column = full.inputs.index(model.inputs[0])
        for row, output in enumerate(model.outputs):
            np.testing.assert_allclose(
                alone[row, 0], whole[full.outputs.index(output), column], rtol=1e-9, atol=1e-12, err_msg=output
            )


def test_physical_parameters_give_the_derivatives_of_the_forces() -> None:
    model = library_model("physical.hover")
    rng = np.random.default_rng(0)
    for _ in range(5):
        free = {p.name: p.value * float(np.exp(rng.uniform(-0.3, 0.3))) for p in model.parameters if p.status != "tied"}
        values = model.parameters.with_values(free | {"z": -free["z"]}).values
        # The inflow of all rotors is as inclined as in flight across, as that of rotors on the axis is in a turn.
        inflow, on_axis = hover_derivatives(values | {"z": 0.0}), hover_derivatives(values | {"l": 0.0})
        inclined = {name: inflow[name] + on_axis[name] for name in ("X_q", "Y_p", "M_q", "L_p")}
        for name, value in (hover_derivatives(values) | inclined).items():
            assert values[name] == pytest.approx(value, rel=1e-12), name
        full = library_model("hover.full")
        np.testing.assert_allclose(
            model.response(values, OMEGA),
            full.response({name: values[name] for name in full.parameters.names}, OMEGA),
            rtol=1e-12,
        )


def test_speed_of_the_rotors_follows_the_weight() -> None:
    parameters = library_model("physical.hover").parameters
    heavier = parameters.fix("m", 4.0 * parameters["m"].value)
    assert heavier.values["n_h"] == pytest.approx(2.0 * parameters.values["n_h"], rel=1e-12)


def test_motors_of_the_rig_turn_it_as_its_matrix_says() -> None:
    system = start("rig.attitude")
    values = library_model("rig.attitude").parameters.values
    roll, pitch, yaw = (values["L"] * values["K_f"] / values[J] for J in ("J_x", "J_y", "J_z"))
    yaw *= values["K_t"] / (values["L"] * values["K_f"])
    expected = [[0.0, 0.0, roll, -roll], [pitch, -pitch, 0.0, 0.0], [-yaw, -yaw, yaw, yaw]]
    np.testing.assert_allclose(system.G[3:], expected, rtol=1e-12)
    np.testing.assert_array_equal(system.G[:3], 0.0)
    np.testing.assert_array_equal(start("rig.roll").G[1], system.G[3, 2:])


def test_a_slip_of_the_pen_gets_the_nearest_name() -> None:
    with pytest.raises(ModelError, match=r"no model 'hover\.longitudnal'.*did you mean hover\.longitudinal"):
        library_model("hover.longitudnal")
    with pytest.raises(ModelError, match=r"one of axis\.pitch"):
        library_text("../catalog")


def test_the_model_of_the_docs_reads() -> None:
    page = Path(__file__).resolve().parents[3] / "docs" / "models.md"
    (text,) = re.findall(r"```toml\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    model = from_toml(text)
    assert model.parameters.values["Y_v"] == pytest.approx(-0.2, rel=1e-12)
    assert all(f"`{name}`" in page.read_text(encoding="utf-8") for name in model_names())
