"""``physical.flight`` from a log to a result: true numbers of a simulated vehicle, what is assumed, what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.identifying.flight_logs import DIAMETER_M, flown, layout_file, without

from rotorid.data.record import FlightRecord
from rotorid.documents.result import load, result_document, save
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flying.vehicle_air import hover_parameters
from rotorid.identifying.identification import identify
from rotorid.identifying.identify_many import identify_several
from rotorid.models.flight import FLIGHT_PARAMETERS
from rotorid.report.words import status_word
from rotorid.results.model import IdentifiedModel
from rotorid.results.summary import airframe_of

VELOCITY = ("velocity_north", "velocity_east", "velocity_down")


@pytest.fixture(scope="module")
def layout(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(layout_file(tmp_path_factory.mktemp("layout")))


def identified(layout: str, *records: FlightRecord, fix: dict[str, float] | None = None) -> IdentifiedModel:
    twin = flown()
    known = {"m": twin.truth["m"], "I_zz": twin.truth["I_zz"]} if fix is None else fix
    return identify(records or [twin.record], "physical.flight", layout=layout, rotor_diameter_m=DIAMETER_M, fix=known)


@pytest.fixture(scope="module")
def model(layout: str) -> IdentifiedModel:
    return identified(layout)


def test_true_numbers_come_back(model: IdentifiedModel) -> None:
    truth = flown().truth
    for name in ("k_d", "x_imu", "y_imu", "z_imu"):
        found = model[name]
        assert found.std is not None
        assert abs(found.value - truth[name]) < 3.0 * found.std
    assert model.flight is not None
    hover = model.flight.hover
    drag = truth["k_d"] * 4 * hover["speed"].value / truth["m"]
    assert hover["drag"].value == pytest.approx(drag, rel=0.05)
    assert hover["thrust_coefficient"].value * hover["speed"].value ** 2 == pytest.approx(truth["m"] * 9.80665 / 4)


def test_every_number_has_its_unit_and_most_an_error(model: IdentifiedModel) -> None:
    assert set(model.parameters) <= set(FLIGHT_PARAMETERS)
    for name, found in model.parameters.items():
        assert found.unit == FLIGHT_PARAMETERS[name].unit
        assert (found.std is not None and found.std > 0.0) == (found.status == "free")


def test_rotors_and_thrust_are_in_the_room_of_motors(model: IdentifiedModel) -> None:
    motors, flight = model.motors, model.flight
    assert motors is not None
    assert flight is not None
    assert (motors.scale, motors.outputs, motors.load_factor) == ("m", "speed", 1.0)
    frame = airframe_of(motors, flight, model["m"].value)
    truth = flown().frame
    assert frame.positions == pytest.approx(truth.positions)
    assert (frame.mass_kg, frame.rotors) == (truth.mass_kg, 4)
    assert frame.disc_m2 == pytest.approx(truth.disc_m2, rel=0.01)


def test_thrust_of_hover_is_as_sure_for_a_vehicle(model: IdentifiedModel) -> None:
    assert model.flight is not None
    stated, own = model.flight.hover["thrust_coefficient"], hover_parameters(model)["c_2"]
    assert (own.value, own.std) == (pytest.approx(stated.value), pytest.approx(stated.std, rel=1e-6))


def test_a_result_comes_back_as_it_was_saved(model: IdentifiedModel, tmp_path: Path) -> None:
    save(model, tmp_path)
    loaded = load(tmp_path)
    assert (loaded.flight, loaded.motors, loaded.parameters) == (model.flight, model.motors, model.parameters)
    assert loaded.bounds.covariance == pytest.approx(model.bounds.covariance)
    # Correlations are computed anew from what was saved.
    again, saved = (result_document(one).model_copy(update={"correlation": None}) for one in (loaded, model))
    assert again == saved


def test_the_linear_model_hovers(model: IdentifiedModel) -> None:
    structure = model.structure
    assert structure.inputs == ("motor_1", "motor_2", "motor_3", "motor_4")
    values = structure.parameters.values
    hover = model.flight.hover if model.flight else {}
    assert values["az_thrust"] == pytest.approx(hover["thrust_slope"].value / model["m"].value)
    # Climb loses thrust: half of it, because the induced velocity falls.
    rate = 2.0 * model["c_lambda"].value * hover["speed"].value / model["m"].value
    assert values["Z_w"] == pytest.approx(-rate)


def test_without_a_mass_numbers_are_per_kilogram_and_named_so(layout: str, model: IdentifiedModel) -> None:
    light = identified(layout, fix={})
    assert light.motors is not None
    assert light.motors.scale is None
    assert light["k_d"].unit == "1/rad"
    assert light["k_d"].value == pytest.approx(model["k_d"].value / model["m"].value, rel=0.02)
    assert "1 kg" in next(finding.message for finding in light.findings if finding.where == "m")
    assert "Disc loading was assumed" in next(f.message for f in light.findings if f.kind == "assumed_disc")


def test_attitude_alone_gives_drag(layout: str, model: IdentifiedModel) -> None:
    blind = identified(layout, without(flown().record, *VELOCITY))
    assert blind.flight is not None
    assert blind.flight.velocity == "attitude"
    assert "velocity_from_attitude" in {finding.kind for finding in blind.findings}
    # A flight of many seconds at one speed is more than an integral with a leak knows.
    assert 0.2 < blind["k_d"].value / model["k_d"].value < 1.5


def test_outputs_are_shares_of_the_full_speed(layout: str) -> None:
    twin = flown("outputs")
    of_outputs = identified(layout, twin.record)
    assert of_outputs.motors is not None
    assert of_outputs.motors.outputs == "output"
    assert of_outputs["k_d"].unit == "N s/m"
    full = of_outputs.motors.derived["thrust_to_weight"]
    assert 1.5 < full.value < 15.0
    # Roll and pitch show the lag, which thrust along the rotors alone would not.
    lag = of_outputs["T_motor"]
    assert lag.std is not None
    assert 0.0 < lag.std < 0.2 * lag.value


def test_what_nobody_gave_is_called_assumed(model: IdentifiedModel) -> None:
    assert model.flight is not None
    document = result_document(model)
    missing = replace(model.flight, missing={"c_2": "as usual", "d_z": "too slow"})
    assumed = document.model_copy(update={"flight": missing})
    assert status_word(assumed, "c_2") == "assumed"
    assert status_word(document, "c_2") == "free"
    assert status_word(assumed, "m") == "fixed"


def test_motors_that_were_logged_slowly_are_refused(layout: str) -> None:
    topics = []
    for topic in flown().record.topics:
        every = round(1.0 / (20.0 * float(np.diff(topic.time_s).mean())))
        topics.append(replace(topic, time_s=topic.time_s[::every], values=topic.values[:, ::every]))
    with pytest.raises(InsufficientDataError, match=r"the motors of .* are logged at 21 Hz") as caught:
        identified(layout, replace(flown().record, topics=tuple(topics)))
    assert "40 Hz" in caught.value.needed
    assert next(finding.kind for finding in caught.value.findings) == "rate_too_low"


def test_a_flight_without_the_mean_force_is_refused(layout: str) -> None:
    from dataclasses import replace

    import numpy as np

    record = without(flown().record, *VELOCITY, "phi", "theta", "psi")
    (topic,) = record.topics
    values = np.array(topic.values)
    row = [channel.name for channel in topic.channels].index("az")
    values[row] *= 1.4
    with pytest.raises(InsufficientDataError, match="neither velocity nor attitude"):
        identified(layout, replace(record, topics=(replace(topic, values=values),)))


def test_choices_of_other_models_are_refused(layout: str) -> None:
    with pytest.raises(UsageError, match="--method output_error does not apply"):
        identify(flown().record, "physical.flight", layout=layout, method="output_error")


def test_all_models_include_it_where_the_size_is_known(layout: str) -> None:
    several = identify_several(
        flown().record, "all", layout=layout, rotor_diameter_m=DIAMETER_M, fix={"m": flown().truth["m"]}
    )
    assert "physical.flight" in several.identified
