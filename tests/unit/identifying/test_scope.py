"""What of a model is fitted: inputs that were excited, outputs that sensors measured, and what goes with the others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.cli.commands import fly_roll_sweeps
from tests.unit.identifying.small_logs import at_rest, log, sweeps

import rotorid
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.identifying.scope import Scoped, require_common_axes, scoped
from rotorid.models.library import library_model, transfer_function
from rotorid.models.structure import connected
from rotorid.settings.identifying import IdentifySettings

LONGITUDINAL = library_model("hover.longitudinal")
LATERAL = library_model("hover.lateral")
FULL = library_model("hover.full")
SENSORS = ("p", "q", "r", "ax", "ay", "az")
COMMANDS = ("roll_command", "pitch_command", "yaw_command", "thrust_command")
AUTOPILOT = log(at_rest("imu", 200.0, *SENSORS, *COMMANDS), at_rest("ekf", 20.0, "u", "v", "w", "theta", "phi"))
ONE_RATE = log(at_rest("all", 100.0, *SENSORS, *COMMANDS, "u", "v", "w", "theta", "phi"))


def kinds(scope: Scoped) -> dict[str, str]:
    return {finding.kind: finding.message for finding in scope.findings}


def test_all_that_was_excited_and_measured_stays() -> None:
    scope = scoped(LONGITUDINAL, sweeps(ONE_RATE, ["pitch", "thrust"]), [ONE_RATE], IdentifySettings())
    assert scope.structure.inputs == LONGITUDINAL.inputs
    assert scope.structure.outputs == ("q", "u", "w", "theta", "ax", "az")
    assert scope.structure.states == LONGITUDINAL.states
    assert scope.structure.parameters == LONGITUDINAL.parameters


def test_an_input_without_excitation_goes_with_its_parameters_and_a_finding() -> None:
    scope = scoped(LATERAL, sweeps(ONE_RATE, ["roll"]), [ONE_RATE], IdentifySettings())
    gone = {"L_yaw", "N_yaw", "N_spin", "Y_yaw", "tau_yaw"}
    assert scope.structure.inputs == ("roll_command",)
    assert set(LATERAL.parameters.names) - set(scope.structure.parameters.names) == gone
    # Its motors would stay at rest.
    assert set(LATERAL.states) - set(scope.structure.states) == {"motor_yaw"}
    message = kinds(scope)["no_excitation"]
    assert "yaw_command" in message
    assert all(name in message for name in gone)


def test_no_parameter_of_what_is_left_is_without_effect() -> None:
    for axis in ("roll", "pitch", "yaw", "thrust"):
        scope = scoped(FULL, sweeps(ONE_RATE, [axis]), [ONE_RATE], IdentifySettings())
        structure = scope.structure
        values = {name: 0.1 + 0.01 * place for place, name in enumerate(structure.parameters.names)}
        _, slopes = structure.response_and_jacobian(values, np.array([1.0, 7.0]), np.eye(len(structure.parameters)))
        assert np.abs(slopes).max(axis=(1, 2, 3)).min() > 0.0, axis
        response = structure.response(values, np.array([3.0]))
        assert np.abs(response).min() > 0.0


def test_what_is_left_responds_as_the_whole_does() -> None:
    values = {name: 0.1 + 0.01 * place for place, name in enumerate(LATERAL.parameters.names)}
    smaller = connected(LATERAL.select(inputs=["roll_command"]))
    omega = np.geomspace(0.5, 50.0, 7)
    left = {name: values[name] for name in smaller.parameters.names}
    np.testing.assert_allclose(smaller.response(left, omega), LATERAL.response(values, omega)[:, :1], rtol=1e-10)
    assert connected(LATERAL) is LATERAL


def test_an_axis_that_an_output_does_not_follow_goes() -> None:
    scope = scoped(FULL, sweeps(ONE_RATE, ["roll", "pitch"]), [ONE_RATE], IdentifySettings(outputs=("p",)))
    assert scope.structure.inputs == ("roll_command",)
    assert "M_q" not in scope.structure.parameters.names
    assert "pitch_command" in kinds(scope)["not_identifiable"]


def test_sensors_are_fitted_and_slow_estimates_are_not() -> None:
    scope = scoped(LONGITUDINAL, sweeps(AUTOPILOT, ["pitch", "thrust"]), [AUTOPILOT], IdentifySettings())
    assert scope.structure.outputs == ("q", "ax", "az")
    message = kinds(scope)["outputs_left_out"]
    assert "u, w, theta" in message
    assert "--outputs" in message


def test_estimates_at_the_rate_of_the_sensors_but_of_another_topic_are_not_fitted() -> None:
    record = log(at_rest("imu", 100.0, "q", *COMMANDS), at_rest("ekf", 100.0, "theta", "u"))
    scope = scoped(LONGITUDINAL, sweeps(record, ["pitch", "thrust"]), [record], IdentifySettings())
    assert scope.structure.outputs == ("q",)


def test_outputs_that_are_asked_for_are_fitted_in_that_order_and_nothing_is_said() -> None:
    settings = IdentifySettings(outputs=("theta", "q"))
    scope = scoped(LONGITUDINAL, sweeps(AUTOPILOT, ["pitch", "thrust"]), [AUTOPILOT], settings)
    assert scope.structure.outputs == ("theta", "q")
    assert "outputs_left_out" not in kinds(scope)


def test_an_output_that_can_be_reconstructed_may_be_asked_for() -> None:
    settings = IdentifySettings(outputs=("u_dot", "q"))
    assert (
        scoped(LONGITUDINAL, sweeps(ONE_RATE, ["pitch", "thrust"]), [ONE_RATE], settings).structure.outputs
        == settings.outputs
    )


def test_what_an_own_model_writes_down_is_computed_unasked() -> None:
    library = LONGITUDINAL.select(outputs=("q", "u_dot"))
    chosen = sweeps(ONE_RATE, ["pitch", "thrust"])
    assert scoped(library, chosen, [ONE_RATE], IdentifySettings()).structure.outputs == ("q",)
    own = replace(library, name="own")
    assert scoped(own, chosen, [ONE_RATE], IdentifySettings()).structure.outputs == ("q", "u_dot")
    # With no output logged, what can be computed is all that there is.
    alone = LONGITUDINAL.select(outputs=("u_dot",))
    assert scoped(alone, chosen, [ONE_RATE], IdentifySettings()).structure.outputs == ("u_dot",)


def test_outputs_must_be_in_every_record() -> None:
    other = log(at_rest("imu", 200.0, "q", "ax", *COMMANDS), name="second.csv")
    scope = scoped(LONGITUDINAL, sweeps(AUTOPILOT, ["pitch", "thrust"]), [AUTOPILOT, other], IdentifySettings())
    assert scope.structure.outputs == ("q", "ax")
    with pytest.raises(InsufficientDataError, match=r"second\.csv has no az"):
        scoped(
            LONGITUDINAL,
            sweeps(AUTOPILOT, ["pitch", "thrust"]),
            [AUTOPILOT, other],
            IdentifySettings(outputs=("q", "az")),
        )


def test_of_joined_records_any_may_hold_an_output() -> None:
    other = log(at_rest("imu", 200.0, "q", "ax", *COMMANDS), name="second.csv")
    records = [AUTOPILOT, other]
    scope = scoped(
        LONGITUDINAL,
        sweeps(AUTOPILOT, ["pitch", "thrust"]),
        records,
        IdentifySettings(outputs=("q", "az")),
        joined=True,
    )
    assert scope.structure.outputs == ("q", "az")
    alone = scoped(LONGITUDINAL, sweeps(AUTOPILOT, ["pitch", "thrust"]), [AUTOPILOT], IdentifySettings())
    both = scoped(LONGITUDINAL, sweeps(AUTOPILOT, ["pitch", "thrust"]), records, IdentifySettings(), joined=True)
    assert both.structure.outputs == alone.structure.outputs


def test_records_of_other_units_or_without_a_common_axis_are_refused() -> None:
    other = log(at_rest("imu", 200.0, "p", "roll_command"), name="roll.csv")
    with pytest.raises(UsageError, match=r"none of .* contains both an input and an output of hover\.longitudinal"):
        require_common_axes(LONGITUDINAL, [other, replace(other, topics=other.topics)])
    (topic,) = (t for t in AUTOPILOT.topics if "q" in [c.name for c in t.channels])
    degrees = tuple(replace(c, unit="deg/s") if c.name == "q" else c for c in topic.channels)
    topics = tuple(replace(t, channels=degrees) if t is topic else t for t in AUTOPILOT.topics)
    with pytest.raises(UsageError, match=r"q has different units: rad/s in .* and deg/s in"):
        require_common_axes(LONGITUDINAL, [AUTOPILOT, replace(AUTOPILOT, topics=topics)])
    require_common_axes(LONGITUDINAL, [AUTOPILOT, other])


def test_a_log_without_any_output_names_the_first_that_is_missing() -> None:
    record = log(at_rest("out", 100.0, *COMMANDS))
    with pytest.raises(InsufficientDataError, match="has no q") as refused:
        scoped(LONGITUDINAL, sweeps(record, ["pitch", "thrust"]), [record], IdentifySettings())
    assert refused.value.findings[0].kind == "missing_channel"


def test_inputs_that_are_no_commands_need_no_excitation() -> None:
    structure = transfer_function(numerator=0, denominator=1, inputs=["theta"], outputs=["q"])
    scope = scoped(structure, sweeps(ONE_RATE, ["pitch"]), [ONE_RATE], IdentifySettings())
    assert scope.structure.inputs == ("theta",)
    assert scope.findings == ()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (IdentifySettings(outputs=("thta",)), "no output 'thta'.*did you mean theta"),
        (IdentifySettings(constants={"theta": 0.1}), "no constant 'theta'.*did you mean theta0"),
        (
            IdentifySettings(pairs={"q/pich_command": None}),
            "no response 'q/pich_command'.*did you mean q/pitch_command",
        ),
        (IdentifySettings(pair_weights={"az/thrust": 2.0}), "no response 'az/thrust'.*did you mean az/thrust_command"),
        (IdentifySettings(fix={"M_qq": 0.0}), "no parameter 'M_qq'.*did you mean M_q"),
        (IdentifySettings(ties={"M_q": "-M_uu"}), "'M_uu', which is no parameter.*did you mean M_u"),
        (IdentifySettings(free=("tau_pich",)), "no parameter 'tau_pich'.*did you mean tau_pitch"),
    ],
)
def test_unknown_names_get_the_nearest_one(settings: IdentifySettings, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        scoped(LONGITUDINAL, sweeps(ONE_RATE, ["pitch", "thrust"]), [ONE_RATE], settings)


@pytest.mark.parametrize(
    "settings",
    [
        IdentifySettings(fix={"Z_thrust": -10.0}),
        IdentifySettings(free=("Z_thrust",)),
        IdentifySettings(ties={"Z_thrust": "M_q"}),
        IdentifySettings(ties={"M_q": "Z_thrust"}),
    ],
)
def test_a_choice_about_a_parameter_that_is_gone_is_refused(settings: IdentifySettings) -> None:
    with pytest.raises(UsageError, match=r"pitch_command depends on Z_thrust, given with --fix, --tie or --free"):
        scoped(LONGITUDINAL, sweeps(ONE_RATE, ["pitch"]), [ONE_RATE], settings)


def test_a_log_that_lacks_a_channel_ends_no_run(tmp_path: Path) -> None:
    fly_roll_sweeps(tmp_path / "whole.csv")
    lines = (tmp_path / "whole.csv").read_text(encoding="utf-8").splitlines()
    place = next(number for number, name in enumerate(lines[0].split(",")) if name.startswith("p "))
    kept = [",".join(cell for at, cell in enumerate(line.split(",")) if at != place) for line in lines]
    (tmp_path / "lacking.csv").write_text("\n".join(kept) + "\n", encoding="utf-8")
    alone = rotorid.identify(tmp_path / "whole.csv", "rate.roll", band_rad_s=(12.0, 50.0))
    both = rotorid.identify([tmp_path / "lacking.csv", tmp_path / "whole.csv"], "rate.roll", band_rad_s=(12.0, 50.0))
    assert both["L_roll"].value == alone["L_roll"].value
    (said,) = [finding for finding in both.findings if finding.where == "lacking.csv" and finding.severity == "warning"]
    assert (said.kind, "contains no p and was left out" in said.message) == ("missing_channel", True)
    with pytest.raises(InsufficientDataError, match="p"):
        rotorid.identify(tmp_path / "lacking.csv", "rate.roll", band_rad_s=(12.0, 50.0))
