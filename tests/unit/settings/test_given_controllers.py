"""Controllers from a file, and the closed loop that they make possible."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.unit.identifying.test_verification import candidate, doublets, kinds

from rotorid.autopilots.filters import combined_response
from rotorid.checking.maneuvers import with_known_delays, with_known_filters
from rotorid.data.record import FlightRecord, Source
from rotorid.documents.verify import verify_document
from rotorid.errors import UsageError
from rotorid.flights.given_controllers import Controllers, no_controller
from rotorid.identifying.verification import verify
from rotorid.models.controller import RateController
from rotorid.models.library import rate_model
from rotorid.settings.given_controllers import GivenController, read_controllers
from rotorid.settings.verifying import VerifySettings
from rotorid.signal.autopilot_filters import known_filters
from rotorid.vehicles import s500

__all__ = ["doublets"]

GAINS = s500.vehicle().controller
ROLL = RateController(proportional_s=GAINS.rate_p[0], integral=GAINS.rate_i[0], angle_1_s=GAINS.angle_p[0])
EMPTY = FlightRecord(source=Source(name="log.ulg", format="PX4 ULog", sha256=""), topics=())


def written(folder: Path, text: str) -> Path:
    file = folder / "gains.toml"
    file.write_text(text)
    return file


class TestReading:
    """Gains in a file: what is wrong is said with its line."""

    def test_gains_and_set_point(self, tmp_path: Path) -> None:
        text = '[roll]\nproportional_s = 0.15\nangle_1_s = 6\nsetpoint = "phi_setpoint"\n[yaw]\nproportional_s = 1\n'
        found = read_controllers(written(tmp_path, text + "derivative_of_error = true\n"))
        roll = RateController(proportional_s=0.15, angle_1_s=6.0)
        yaw = RateController(proportional_s=1.0, derivative_of_error=True)
        assert found["roll"] == GivenController(controller=roll, setpoint="phi_setpoint")
        assert found["yaw"] == GivenController(controller=yaw)

    @pytest.mark.parametrize(
        ("text", "said"),
        [
            ("[rol]\nproportional_s = 1\n", "'?roll'?"),
            ("[roll]\nproportional_s = 1\nintegrl = 2\n", "line 3.*integrl"),
            ("[roll]\nproportional_s = 1\nintegral = 'much'\n", "line 3"),
            ("[roll]\nproportional_s = 1\nderivative_of_error = 1\n", "true or false"),
            ("[roll]\nintegral = 1\n", "lacks proportional_s"),
            ("[roll]\nproportional_s = -1\n", "gains"),
            ("roll = 3\n", "table"),
            ("[roll\n", "not valid TOML"),
            ("", "no controller"),
        ],
    )
    def test_what_is_wrong_is_said(self, text: str, said: str, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match=said):
            read_controllers(written(tmp_path, text))

    def test_nothing_there(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="cannot be read"):
            read_controllers(tmp_path / "nowhere.toml")


def test_given_gains_go_before_logged_ones() -> None:
    logged = FlightRecord(
        source=EMPTY.source, topics=(), parameters={"MC_ROLLRATE_P": 0.15, "MC_ROLLRATE_I": 0.2, "MC_ROLLRATE_D": 0.0}
    )
    given = GivenController(controller=ROLL)
    assert Controllers(record=logged, given={"roll": given}).of("roll") == given
    found = Controllers(record=logged, given={}).of("roll")
    assert found is not None
    assert found.controller.proportional_s == 0.15
    assert Controllers(record=logged, given={}).of("thrust") is None


def test_without_gains_a_finding_says_what_to_give(doublets: FlightRecord) -> None:
    verified = verify(candidate(), [doublets])
    assert "no_controller" in kinds(verified)
    assert all(one.closed_loop is None for one in verify_document(verified).maneuvers)


def test_what_is_missing_of_a_controller_is_said() -> None:
    known = Controllers(record=EMPTY, given={"roll": GivenController(controller=ROLL)})
    assert "the log has no known gains for the pitch controller" in no_controller(known, ["pitch"]).message
    driven = no_controller(known, ["roll"]).message
    assert "contains the gains of the roll controller but not its set-point, phi_setpoint or p_setpoint" in driven


def test_with_gains_the_model_flies_in_closed_loop(doublets: FlightRecord) -> None:
    settings = VerifySettings(controllers={"roll": GivenController(controller=ROLL)})
    verified = verify(candidate(), [doublets], settings=settings)
    roll, yaw = verify_document(verified).maneuvers
    assert roll.closed_loop is not None
    assert roll.closed_loop.setpoints == {"roll_command": "phi_setpoint"}
    assert roll.closed_loop.scores.keys() == {"p", "r", "ay", "roll_command"}
    assert roll.closed_loop.scores["p"].tic < 0.1
    assert yaw.closed_loop is None
    assert verify_document(verified).provenance.settings["controllers"] == [f"roll: {settings.controllers['roll']}"]


def test_gains_that_did_not_fly_are_not_used(doublets: FlightRecord) -> None:
    wrong = GivenController(controller=RateController(proportional_s=0.9, integral=3.0, angle_1_s=1.0))
    verified = verify(candidate(), [doublets], settings=VerifySettings(controllers={"roll": wrong}))
    assert "other_controller" in kinds(verified)
    assert verify_document(verified).maneuvers[0].closed_loop is None


def test_a_set_point_that_is_not_there_is_refused(doublets: FlightRecord) -> None:
    wrong = GivenController(controller=ROLL, setpoint="theta_setpoint_2")
    with pytest.raises(UsageError, match="theta_setpoint_2"):
        verify(candidate(), [doublets], settings=VerifySettings(controllers={"roll": wrong}))


def test_a_fed_back_output_passes_the_filter_itself() -> None:
    record = FlightRecord(
        source=EMPTY.source,
        topics=(),
        parameters={"IMU_GYRO_CUTOFF": 40.0, "IMU_GYRO_NF0_FRQ": 0.0, "IMU_GYRO_NF0_BW": 20.0},
    )
    system = rate_model("rate.roll").matrices({"L_roll": 100.0, "L_p": -1.0, "T_motor": 0.05, "tau_roll": 0.02})
    raw, here = {"p": "sensor_combined.gyro_rad[0]"}, {"p": "vehicle_angular_velocity.xyz[0]"}
    shifted, _ = with_known_delays(system, record, ("p",), fitted=raw, judged=here)
    filtered = with_known_filters(shifted, record, ("p",), read=("p",), fitted=raw, judged=here)
    low_pass = known_filters(record, here["p"])
    omega = np.geomspace(1.0, 600.0, 30)
    # The analog filter has at the bent frequency what the digital one, at 8 kHz, has at the true one.
    bent = 2.0 * 8000.0 * np.tan(0.5 * omega / 8000.0)
    # The delay of the filter is taken off again; the rest of what lies between the two places stays.
    plain = shifted.response(bent)[0, 0] * np.exp(1j * bent * sum(one.delay_s for one in low_pass))
    np.testing.assert_allclose(filtered.response(bent)[0, 0] / plain, combined_response(low_pass, omega), rtol=1e-9)
