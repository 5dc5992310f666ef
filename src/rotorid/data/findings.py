"""Findings: warnings and notes with their numbers, and the catalogue of their kinds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, Protocol, TypeAlias, TypeVar

from rotorid.data.base import Immutable
from rotorid.data.display import counted, html_table, lines_of

Severity: TypeAlias = Literal["info", "warning", "error"]

SEVERITIES: tuple[Severity, ...] = ("error", "warning", "info")
"""From the worst to the mildest."""


@dataclass(frozen=True, kw_only=True)
class Finding(Immutable):
    """A warning or note about data, a response, a model or a check.

    Parameters
    ----------
    kind
        A snake_case word that scripts may rely on, one of :data:`KINDS`.
    severity
        ``info`` explains, ``warning`` limits the trust in a number, ``error`` means that there is no answer.
    where
        What the finding is about: a channel, a topic, a response ``y/u``, a parameter.
    message
        One or two short sentences for a person.
    numbers
        The numbers of the message for a program; the unit is in the name.
    """

    kind: str
    severity: Severity
    where: str
    message: str
    numbers: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(numbers={name: float(value) for name, value in self.numbers.items()})

    def _repr_html_(self) -> str:
        return Findings([self])._repr_html_()


class Findings(tuple[Finding, ...]):
    """A tuple of findings, printed one a line and as a table in a notebook.

    Examples
    --------
    >>> Findings([warn("gap", "p", "0.4 s are missing.", longest_s=0.4)])
    1 finding
      warning  gap  p  0.4 s are missing.
    """

    __slots__ = ()

    def __repr__(self) -> str:
        return lines_of(self._head, self._rows)

    def _repr_html_(self) -> str:
        return html_table(self._head, ["severity", "kind", "where", "message"], self._rows)

    @property
    def _head(self) -> str:
        return counted(len(self), "finding")

    @property
    def _rows(self) -> list[tuple[str, str, str, str]]:
        return [(finding.severity, finding.kind, finding.where, finding.message) for finding in self]


def remark(kind: str, where: str, message: str, /, **numbers: float) -> Finding:
    """A finding of severity ``info``.

    Parameters
    ----------
    kind
        Which finding it is, see ``docs/results.md``.
    where
        What it concerns: a parameter, a response, a channel, a log.
    message
        Sentences for the user.
    **numbers
        By name, for programs.

    Examples
    --------
    >>> remark("trim", "theta", "The vehicle flew forward.", theta_rad=-0.1).severity
    'info'
    """
    return Finding(kind=kind, severity="info", where=where, message=message, numbers=numbers)


def warn(kind: str, where: str, message: str, /, **numbers: float) -> Finding:
    """A finding of severity ``warning``.

    Parameters
    ----------
    kind
        Which finding it is, see ``docs/results.md``.
    where
        What it concerns: a parameter, a response, a channel, a log.
    message
        Sentences for the user.
    **numbers
        By name, for programs.

    Examples
    --------
    >>> warn("gap", "p", "0.4 s are missing.", longest_s=0.4).numbers["longest_s"]
    0.4
    """
    return Finding(kind=kind, severity="warning", where=where, message=message, numbers=numbers)


def refusal(kind: str, where: str, message: str, /, **numbers: float) -> Finding:
    """A finding of severity ``error``.

    Parameters
    ----------
    kind
        Which finding it is, see ``docs/results.md``.
    where
        What it concerns: a parameter, a response, a channel, a log.
    message
        Sentences for the user.
    **numbers
        By name, for programs.

    Examples
    --------
    >>> refusal("never_airborne", "flight.ulg", "It never flew.").severity
    'error'
    """
    return Finding(kind=kind, severity="error", where=where, message=message, numbers=numbers)


def worst_first(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Findings by severity, each fact once; those of one severity keep their order.

    That a source is logged too slowly is one fact, whoever says it: the reader, which comes first, knows the remedy.

    Parameters
    ----------
    findings
        Of several sources, the reader's first.

    Examples
    --------
    >>> gap, skew = warn("gap", "p", "0.4 s are missing."), remark("clock_skew", "p", "It is 5 ms late.")
    >>> [finding.kind for finding in worst_first([skew, gap, skew])]
    ['gap', 'clock_skew']
    """
    unique: dict[tuple[object, ...], Finding] = {}
    for finding in findings:
        unique.setdefault(_fact(finding), finding)
    return tuple(sorted(unique.values(), key=lambda finding: SEVERITIES.index(finding.severity)))


def _fact(finding: Finding) -> tuple[object, ...]:
    numbers = finding.numbers
    if finding.kind == "rate_too_low" and "needed_hz" in numbers:
        return finding.kind, finding.severity, finding.where, round(numbers["rate_hz"])
    return finding.kind, finding.severity, finding.where, finding.message, tuple(numbers.items())


_SEVERITY_WORDS: Mapping[str, str] = {"error": "error", "warning": "warning", "info": "note"}


def severity_count(severities: Iterable[str]) -> str:
    """How many errors, warnings and notes there are, in words; empty for none.

    Examples
    --------
    >>> severity_count(["info", "warning", "info"]), severity_count([])
    ('1 warning, 2 notes', '')
    """
    counts = Counter(severities)
    return ", ".join(counted(counts[each], _SEVERITY_WORDS[each]) for each in SEVERITIES if counts[each])


Remark = TypeVar("Remark", bound="Worded")


class Worded(Protocol):
    """A finding, or its document."""

    @property
    def message(self) -> str:
        """Its message."""


def without_repeated(findings: Sequence[Remark]) -> list[Remark]:
    """Findings without those whose message is part of the message of another finding.

    Examples
    --------
    >>> no, stay = refusal("no_excitation", "p", "Nothing moved."), warn("not_tuned", "p", "All stays: Nothing moved.")
    >>> [finding.kind for finding in without_repeated([no, stay])]
    ['not_tuned']
    """
    # Behind a colon a sentence begins with a small letter.
    words = [finding.message.rstrip(".").lower() for finding in findings]
    return [
        finding
        for finding, own in zip(findings, words, strict=True)
        if not any(own != other and own in other for other in words)
    ]


class Kind(NamedTuple):
    """Catalogue entry of a kind of finding.

    Parameters
    ----------
    severity
        The usual severity.
    heading
        At most six words for a person.
    meaning
        One plain sentence.
    """

    severity: Severity
    heading: str
    meaning: str


KINDS: Mapping[str, Kind] = {
    "acausal_output": Kind(
        "warning", "Output ahead of its input", "The output moves before its input, as after a zero-phase filter."
    ),
    "air_not_logged": Kind(
        "info",
        "Wind and noise not logged",
        "The log shows neither wind nor sensor noise, so the plan uses typical values of its vehicle.",
    ),
    "air_of_log": Kind(
        "info", "Wind and noise from a log", "The plan uses the wind and sensor noise measured in a log."
    ),
    "airborne": Kind(
        "info",
        "Maneuver reaches beyond the flight",
        "A maneuver extends beyond the time in the air; a warning means that the part on the ground was cut.",
    ),
    "amplitude_dependent": Kind(
        "warning",
        "Depends on amplitude",
        "Small and large maneuvers give different values; the interval was widened to cover small ones.",
    ),
    "assumed_axis": Kind(
        "info", "Axis assumed", "No result describes this axis of the vehicle, so typical values were assumed."
    ),
    "assumed_noise": Kind("info", "Noise assumed", "The result does not know the noise of its flight."),
    "assumed_curve": Kind(
        "warning", "Thrust curve assumed", "The curve of thrust over motor output was assumed, not identified."
    ),
    "angle_shared": Kind(
        "info",
        "Roll and pitch share a gain",
        "Roll and pitch share one angle gain; this names the value used for both and the reason.",
    ),
    "assumed_disc": Kind(
        "info", "Rotor diameter assumed", "The diameter of the rotors was assumed; inflow depends on it."
    ),
    "assumed_scatter": Kind(
        "info",
        "Usual scatter assumed",
        "One flight does not show how numbers scatter between flights, so the usual scatter was assumed.",
    ),
    "assumed_geometry": Kind("info", "Motor layout assumed", "The order or the positions of the motors were assumed."),
    "bench_log": Kind(
        "info", "A log of a bench", "The log has motors and how the vehicle turned, and nothing that shows a flight."
    ),
    "battery_sag": Kind(
        "info",
        "Battery voltage fell",
        "The battery lost voltage during the flight, which changes the thrust at a given motor output.",
    ),
    "band_below_crossover": Kind(
        "warning", "Data end near the crossover", "The plant was measured only up to about the crossover of its loop."
    ),
    "band_beside_excitation": Kind(
        "warning",
        "Band misses the excitation",
        "The given band leaves out most of the excitation; perhaps it was meant in Hz and read as rad/s.",
    ),
    "beyond_limits": Kind(
        "warning",
        "Plan exceeds its limits",
        "With the given amplitudes the simulated flight exceeds the limits of the plan.",
    ),
    "biased_by_noise": Kind(
        "warning",
        "Biased by noise",
        "Sensor noise shifts a value from equation error by more than one standard deviation.",
    ),
    "biased_parameter": Kind(
        "warning",
        "Biased parameter",
        "A planned flight is expected to miss this parameter by more than two standard deviations.",
    ),
    "bootstrap_disagrees": Kind(
        "warning",
        "Bootstrap disagrees",
        "The bootstrap contradicts the stated error: its spread differs by more than 25 % or its mean is off "
        "by half a standard deviation.",
    ),
    "bootstrap_incomplete": Kind(
        "warning", "Bootstrap incomplete", "More than 5 % of the bootstrap runs failed, so the spread is too small."
    ),
    "noise_bias": Kind(
        "warning",
        "Noise biases a parameter",
        "Artificial noise moves this parameter by more than its stated error and by more than chance.",
    ),
    "noise_runs_incomplete": Kind(
        "warning", "Runs with noise incomplete", "Runs with artificial noise gave no model, or were stopped."
    ),
    "both_ways_disagree": Kind(
        "warning",
        "Regressions disagree",
        "Two regressions disagree: acceleration on torque and the reverse, corrected for noise, or drag from the tilt "
        "and from the logged velocity.",
    ),
    "buffered_commands": Kind("warning", "Commands wait", "Commands that come faster are answered later."),
    "channels_disagree": Kind(
        "warning",
        "Channels disagree",
        "Two channels of the same motion contradict each other; wrong samples were left out.",
    ),
    "check_undecided": Kind(
        "warning",
        "Not enough data to check gains",
        "The flight with the proposed gains does not show the loop well enough to compare it with the prediction.",
    ),
    "clock_disorder": Kind(
        "warning",
        "Time stamps out of order",
        "Time stamps repeat, go backward, lie outside the log or are too close together.",
    ),
    "clock_skew": Kind(
        "info",
        "Time offset between channels",
        "Two channels are offset in time; a warning names the --shift that corrects it.",
    ),
    "control_lost": Kind(
        "warning",
        "Control lost",
        "The vehicle did not come back from a loss of control; what follows it is left out of all averages.",
    ),
    "controller_unchecked": Kind(
        "info", "Controller not checked", "The log does not show whether the logged gains were the ones flown."
    ),
    "controller_unexplained": Kind(
        "warning",
        "Gains do not match the commands",
        "The logged gains do not reproduce the logged commands of an axis.",
    ),
    "closed_loop_bias": Kind(
        "warning",
        "Feedback biases this response",
        "Feedback pulls the response toward the inverse of the controller: direct and joint estimates "
        "differ, or no instrument is logged.",
    ),
    "colored_residuals": Kind(
        "info",
        "Residuals correlated in time",
        "Residuals are correlated in time, so the errors are larger than for white noise.",
    ),
    "correlated_inputs": Kind(
        "warning",
        "Inputs moved together",
        "Other inputs moved along with the excitation, so their effects are hard or impossible to separate.",
    ),
    "corrupt_log": Kind("warning", "Log file damaged", "A part of the log file is damaged and was left out."),
    "decimated": Kind(
        "info",
        "Logged without an anti-alias filter",
        "The log keeps every n-th sample unfiltered, so faster motion is aliased into it.",
    ),
    "delay_of_yaw": Kind(
        "info", "Yaw has its own delay", "The delay from motors to yaw differs from that of roll and pitch."
    ),
    "delay_or_lag": Kind(
        "info", "Delay or lag", "A model of another order splits the same total into a different delay and lag."
    ),
    "delays_disagree": Kind("warning", "Delay estimates disagree", "Two estimates of the same delay differ."),
    "differentiated": Kind(
        "warning",
        "Derivatives instead of sensors",
        "Rates or accelerations were derived from angles or height, which raises their noise.",
    ),
    "different_outputs": Kind(
        "warning", "Different outputs", "The models have different outputs, so their scores do not compare."
    ),
    "disturbed_flight": Kind(
        "warning",
        "Moved by wind or trim",
        "The inputs do not explain the whole motion, for example in wind, so constant forces were fitted too.",
    ),
    "disturbed_verification": Kind(
        "warning", "Too gusty to judge the model", "An unseen flight was too disturbed to judge the model."
    ),
    "drag_by_tilt": Kind(
        "info", "Drag from the tilt", "The flight is slow, so its drag was estimated with the tilt as instrument."
    ),
    "dropped_parameter": Kind("info", "Parameter dropped", "The data do not show this parameter, so it was dropped."),
    "export_compromise": Kind(
        "warning",
        "Approximated in the export",
        "The export approximates a value that its target cannot represent exactly.",
    ),
    "ends_in_air": Kind("info", "Log ends in the air", "The log ends before the vehicle lands."),
    "error_not_checked": Kind(
        "info",
        "Error not measured",
        "This log does not show an error that other logs show, so its usual size widens the intervals.",
    ),
    "feedforward": Kind("info", "Loop includes feed-forward", "The loop was measured together with its feed-forward."),
    "filter_not_judged": Kind(
        "warning",
        "Filter affects an unjudged axis",
        "A new filter acts on an axis for which there are not enough data.",
    ),
    "filter_refused": Kind(
        "error",
        "Filter breaks another loop",
        "With the new filter, an axis that keeps its gains would violate a limit.",
    ),
    "firmware_contradicted": Kind(
        "warning",
        "Another firmware flew",
        "The logged firmware version contradicts the data, so the controller of another version was used.",
    ),
    "fitted_in_pieces": Kind("info", "Fitted in pieces", "Records were cut into pieces because the model is unstable."),
    "flat_bandwidth": Kind(
        "info", "Bandwidth of little meaning", "The response is flat near −3 dB, so its bandwidth means little."
    ),
    "flight_terms_missing": Kind(
        "info",
        "Terms not shown by the flight",
        "The flights do not show these terms of the model, for the given reason.",
    ),
    "flown_in_pieces": Kind(
        "info",
        "Simulated in pieces",
        "The simulation restarts every few seconds because its errors would grow too large.",
    ),
    "gains_out_of_range": Kind(
        "warning", "Gains outside the usual range", "A gain lies outside the range that its firmware recommends."
    ),
    "feedforward_changes": Kind(
        "info", "Feed-forward changes", "Judged gains change the feed-forward of the stick, which moves no margin."
    ),
    "gains_read": Kind(
        "info", "How gains were read", "The PID profile, options and sliders that count in a file of gains."
    ),
    "gains_left_out": Kind(
        "info",
        "Parameters were not judged",
        "No rate or angle loop depends on these parameters of a file of gains, so they were not judged.",
    ),
    "gains_differ": Kind("warning", "Logs of different gains", "Logs tuned together were flown with different gains."),
    "gap": Kind("warning", "Gap in the data", "Samples are missing."),
    "hard_landing": Kind("warning", "Hard landing", "The specific force at touchdown was that of a hard landing."),
    "held_out": Kind(
        "info",
        "Judged on an unused maneuver",
        "All maneuvers were fitted, so a second model without one of them was judged on that maneuver.",
    ),
    "implausible_physics": Kind("info", "Implausible value", "The value is rare among vehicles that fly."),
    "frozen_sensor": Kind(
        "warning",
        "Sensor frozen",
        "A sensor repeats one value for half a second or longer while the vehicle moves; those samples were left out.",
    ),
    "impossible_physics": Kind("warning", "Physically impossible value", "No vehicle can have this value."),
    "impossible_value": Kind(
        "warning",
        "Impossible samples",
        "Samples that no sensor can deliver, or that jump and return at once, were left out.",
    ),
    "insensitive_parameter": Kind(
        "warning", "The data barely constrain this parameter", "Changing this parameter barely changes the fit."
    ),
    "internal_error": Kind(
        "warning",
        "Part not computed",
        "A part of the answer failed because of a fault in rotorid; all other parts are complete.",
    ),
    "part_missing": Kind(
        "info", "Part not available", "This log does not support one part of the answer; all other parts are complete."
    ),
    "interpolated_channel": Kind(
        "warning", "Interpolated channel", "A channel was logged so slowly that its samples had to be interpolated."
    ),
    "inverse_controller": Kind(
        "warning",
        "Controller measured, not the vehicle",
        "The response is the inverse of the controller, not the vehicle.",
    ),
    "kinematic_consistency": Kind("info", "Sensor consistency", "The sensors agree with each other to this extent."),
    "kinematic_inconsistency": Kind(
        "warning", "Sensors contradict each other", "Two sensors disagree about the same motion."
    ),
    "kinematics_unchecked": Kind(
        "info", "Sensors not checked", "The log does not allow a comparison of these sensors."
    ),
    "known_filter": Kind(
        "info", "Known filter", "A channel passed these filters, with this delay, according to the log."
    ),
    "beyond_range": Kind(
        "warning",
        "Beyond the identified range",
        "The flight leaves the airspeeds, climb rates, load factors or rotor speeds of the fitted flights, so the "
        "model extrapolates.",
    ),
    "beyond_speeds": Kind(
        "warning",
        "Beyond the identified speeds",
        "The flight leaves the speeds of a stitched model, so the model of the nearest speed was used.",
    ),
    "dropped_at_speed": Kind(
        "info",
        "Dropped at some speeds",
        "A parameter of a stitched model was dropped at some speeds and is zero there.",
    ),
    "derivatives_differ": Kind(
        "warning",
        "Derivatives contradict a flight",
        "A derivative of a model is more than three deviations from what physical.flight implies.",
    ),
    "speeds_by_physics": Kind(
        "info",
        "Speeds by flight physics",
        "Derivatives of a stitched model at further speeds follow from a result of physical.flight.",
    ),
    "lost_through_speeds": Kind(
        "warning", "Model lost control", "A stitched model does not stay in the air under the controllers of a flight."
    ),
    "joined_models": Kind(
        "info",
        "Models joined",
        "Longitudinal and lateral models were joined, and their errors are treated as independent.",
    ),
    "joined_records": Kind(
        "warning",
        "Records joined",
        "Logs with different channels were joined, and an input moved that one of them cannot separate.",
    ),
    "lag_plus_delay": Kind(
        "info", "Motor lag plus delay", "Motor lag and delay are correlated; their sum is the reliable number."
    ),
    "legacy_units": Kind("info", "Older firmware units", "Values in the units of an older firmware were converted."),
    "logs_disagree": Kind(
        "warning",
        "Logs disagree",
        "The logs give different values, by more than their errors; the interval was widened to cover them.",
    ),
    "low_coherence": Kind(
        "warning", "Low coherence", "The response, or a part of its band, is not coherent enough to be used."
    ),
    "methods_disagree": Kind(
        "warning",
        "Two methods disagree",
        "Two methods give values that differ by more than three standard deviations.",
    ),
    "missing_channel": Kind("warning", "Channel missing", "The log lacks a channel that is required or would help."),
    "changed_since_earlier": Kind(
        "warning", "Changed since earlier flights", "A figure of the vehicle's health differs from its earlier flights."
    ),
    "motor_imbalance": Kind("warning", "Motors out of balance", "One motor works harder than the others in hover."),
    "motor_out_of_step": Kind(
        "warning",
        "Motor lost synchronization",
        "A motor slowed down while its output rose, so it may have lost synchronization.",
    ),
    "motor_stamps": Kind(
        "warning",
        "Motors and gyro out of step",
        "The time stamps of the motors do not agree with the motion that the motors cause.",
    ),
    "motor_reconstruction": Kind(
        "info",
        "Motors computed from commands",
        "Motor outputs were computed from commands logged at a higher rate and compared with the logged outputs.",
    ),
    "dead_sensor": Kind("warning", "Dead sensor", "A gyro never moves, or an accelerometer does not show gravity."),
    "never_airborne": Kind("error", "The vehicle never flew", "The log shows no flight."),
    "not_as_foretold": Kind(
        "warning", "Gains miss the prediction", "The loop with the proposed gains does not behave as predicted."
    ),
    "oscillation": Kind(
        "warning",
        "Axis oscillates",
        "The loop oscillates by itself, often with a motor at its limit, because its gains are too high.",
    ),
    "other_gains": Kind(
        "warning", "Other gains flew", "The log meant to check the proposed gains was flown with other gains."
    ),
    "spin_up": Kind(
        "info",
        "Rotor acceleration turns the vehicle",
        "Yaw responds to the acceleration of the rotors in addition to their torque.",
    ),
    "thrust_stays": Kind(
        "info", "Thrust curve unchanged", "The linearization of thrust keeps its setting, for the reason given."
    ),
    "not_tuned": Kind("warning", "Gains unchanged", "The gains of an axis keep their values, for the reason given."),
    "no_controller": Kind(
        "info",
        "No closed-loop simulation",
        "The flight was not simulated in closed loop because no controller is known.",
    ),
    "margin_beyond_band": Kind(
        "warning",
        "Margin beyond the measured band",
        "A margin or the sensitivity peak lies beyond the measured band, so only a bound is known.",
    ),
    "moving_gains": Kind(
        "info",
        "Gains change in flight",
        "The controller changes its own gains in flight, so the margins are valid for one of its states.",
    ),
    "no_delay": Kind("warning", "No delay found", "The data show no delay."),
    "no_excitation": Kind(
        "warning", "No excitation found", "Nothing excites this axis, or nothing above the given frequency."
    ),
    "noisy_acceleration": Kind(
        "info",
        "Noisy acceleration",
        "Noise separates the two plain regressions of torque and acceleration by this much.",
    ),
    "noisy_regressors": Kind(
        "warning", "Noisy regressors", "Noise in the measured states pulls the estimates toward zero."
    ),
    "not_compared": Kind("info", "No second opinion", "The results have nothing in common to compare."),
    "not_converged": Kind("warning", "The fit did not converge", "The solver stopped before it found a minimum."),
    "not_identifiable": Kind("warning", "Parameters cannot be separated", "The data do not separate these parameters."),
    "not_in_measured_equations": Kind(
        "warning", "Parameter not estimated", "These parameters appear in no equation whose states were all measured."
    ),
    "not_verified": Kind("warning", "Not verified", "All or part of a log could not be used to verify the model."),
    "not_written": Kind("warning", "File not written", "A file was not written, for the reason given."),
    "off_axis_input": Kind("info", "Another axis moved too", "Another axis moved during the excitation."),
    "open_loop_diverges": Kind(
        "info",
        "Unstable airframe, model not at fault",
        "Any open-loop prediction of an unstable airframe diverges, so the model is not to blame.",
    ),
    "order_too_high": Kind("warning", "Model order too high", "The model has more states than the data show."),
    "other_controller": Kind(
        "info",
        "Another controller flew",
        "Other gains made the commands, so nothing was tuned or simulated in closed loop.",
    ),
    "other_log": Kind("warning", "Model of another log", "The model was identified on other logs than this one."),
    "other_minimum": Kind(
        "warning",
        "Second minimum found",
        "A second minimum costs at most 10 % more, with parameters more than 3 σ and 10 % away.",
    ),
    "other_source": Kind(
        "warning",
        "Channel from different sources",
        "A channel comes from different sources in the logs, and one of them may be filtered.",
    ),
    "other_vehicle": Kind(
        "warning", "Not a multirotor", "The log comes from a plane, a VTOL, a rover or another vehicle type."
    ),
    "plan_firmware": Kind(
        "warning",
        "Firmware and plan",
        "This compares the firmware of the log with the one that the ArduPilot files of the plan require.",
    ),
    "plan_differs": Kind(
        "warning",
        "Flown differently than planned",
        "A test input was flown with another band, length or amplitude than planned, or on an unplanned axis.",
    ),
    "plan_not_flown": Kind(
        "warning", "Planned, not flown", "The log lacks some test inputs of the plan; a remark means that it lacks all."
    ),
    "parameters_changed": Kind(
        "warning",
        "Parameters changed in flight",
        "Gains, filters or the thrust curve changed within the log, so the values flown are ambiguous.",
    ),
    "outputs_left_out": Kind("info", "Outputs not fitted", "Some outputs of the model were not fitted."),
    "parameter_at_bound": Kind(
        "warning",
        "Parameter at its bound",
        "The parameter ended at a bound of its range, so its value is only a limit.",
    ),
    "weight_balance": Kind(
        "info",
        "Thrust follows from the weight",
        "No axis was excited, so the thrust coefficient comes from the weight that the rotors carry in steady flight.",
    ),
    "payload_step": Kind(
        "warning",
        "Payload differs between logs",
        "Logs of one fit differ in mass at the same thrust: payload, rotors or battery changed.",
    ),
    "poor_fit": Kind(
        "warning", "Model misses the measurement", "The model does not reproduce the data it was fitted to."
    ),
    "poor_verification": Kind(
        "warning", "Model misses the unseen flight", "The model does not predict a flight that it has not seen."
    ),
    "rate_too_low": Kind(
        "warning", "Logged too slowly", "A channel was logged too slowly; the message names the setting to change."
    ),
    "receive_time": Kind(
        "info", "Receiver time stamps", "The time stamps come from the receiver, not from the vehicle."
    ),
    "reconstructed": Kind("info", "Channel computed", "A channel that is not logged was computed from other channels."),
    "record_too_short": Kind("warning", "Record too short", "The record is too short for the requested analysis."),
    "rehearsal_failed": Kind(
        "info",
        "Rehearsal failed",
        "Simulated flights of the plan were lost or do not support a model; its predicted errors are by the others.",
    ),
    "room_not_checked": Kind(
        "info", "Motor limits not checked", "Gains were proposed without a check of the motor limits."
    ),
    "rotor_layout": Kind("info", "Rotor positions", "These are the positions of the rotors according to the log."),
    "rotor_order": Kind(
        "warning", "Motor numbering", "Where the motors sit and turn according to the flight, against the layout."
    ),
    "saturation": Kind("warning", "Saturation", "Motors or commands reached their limits."),
    "seen_data": Kind(
        "warning",
        "Data used for the fit",
        "The model was fitted to some of this log, so this is no test of the model.",
    ),
    "segment_trimmed": Kind(
        "warning", "Segment cut", "A part of the segment lies outside the log or in a gap, and was cut."
    ),
    "sensor_clipping": Kind("warning", "Sensor clipped", "A sensor reached the end of its range."),
    "sensor_corrected": Kind("info", "Sensor corrected", "A sensor error found from the kinematics was corrected."),
    "sensor_not_corrected": Kind(
        "info", "Sensor not corrected", "The flight does not excite these sensor errors enough to estimate them."
    ),
    "several_flights": Kind("info", "Several flights in one log", "The log contains several flights."),
    "several_vehicles": Kind("warning", "Several vehicles in one log", "The log contains several vehicles."),
    "shaped_setpoint": Kind(
        "warning",
        "Autopilot smooths the set-point",
        "ArduPilot's input shaping turns the attitude set-point of a plan into another test input.",
    ),
    "singular_mixer": Kind(
        "warning", "Mixer cannot control all axes", "With this mixer the rotors cannot control all axes."
    ),
    "speed_damping_biased": Kind(
        "warning", "Speed damping biased", "Speed damping was estimated from one response, which biases it."
    ),
    "speed_damping_first": Kind(
        "info", "Speed damping estimated first", "Speed damping was estimated before the others and then fixed."
    ),
    "speed_modes_left_out": Kind(
        "warning",
        "Fitted above the speed modes",
        "A rate model is not valid where the vehicle's speed affects rotation, so it was fitted above those "
        "frequencies.",
    ),
    "structure_error": Kind(
        "warning",
        "Model structure does not fit",
        "The model misses a response by far more than its errors or the other responses.",
    ),
    "sweep_ended_early": Kind("warning", "Sweep ended early", "A sweep ended before its last frequency."),
    "torque_band": Kind(
        "info",
        "Torque from some octaves",
        "The motors explain this axis in some octaves only, and its inertia was identified there.",
    ),
    "tie_contradicted": Kind(
        "warning",
        "Assumption contradicted by data",
        "The data contradict a relation from which physical values were computed.",
    ),
    "thrust_limit": Kind("info", "Thrust limit", "Thrust over weight levels off."),
    "plant_of_choice": Kind(
        "info",
        "Which plant the gains use",
        "The plant of an axis comes from its own settings or from one of several results.",
    ),
    "thrust_range": Kind(
        "info",
        "Gains cover the thrust range",
        "The gains meet their limits over the whole throttle flown, according to the thrust curve of the plant.",
    ),
    "several_trims": Kind(
        "warning",
        "Several flight speeds mixed",
        "Maneuvers at several speeds were fitted together, around their mean speed.",
    ),
    "trim": Kind("info", "Not a hover", "The average flight condition was not a hover."),
    "uncertain_parameter": Kind(
        "warning", "Uncertain parameter", "The parameter trades off against others, so its Cramér–Rao bound is large."
    ),
    "unknown_column": Kind("info", "Unknown column", "An unknown column was left out."),
    "unknown_filter": Kind("warning", "Unknown filter", "A filter of the autopilot is unknown."),
    "unknown_topic": Kind("info", "Unknown topic", "An unknown topic was left out."),
    "tuning_bound": Kind(
        "info",
        "What limits the gains",
        "This requirement limits the proposed gains, or is the reason to keep the current ones.",
    ),
    "unused_choice": Kind("warning", "Unused option", "An option had no effect."),
    "velocity_late": Kind(
        "warning", "Velocity is late", "The logged velocity is later than acceleration and attitude show."
    ),
    "vibration_filtered": Kind(
        "info", "Vibration filtered out", "Vibration was filtered out of measured and predicted outputs alike."
    ),
    "velocity_from_attitude": Kind(
        "info",
        "Velocity not logged",
        "The velocity was integrated from attitude and accelerometer, or is unknown.",
    ),
    "voltage_exponent": Kind(
        "info", "Thrust over voltage", "Thrust follows the battery voltage by this power; the model assumes the square."
    ),
    "wind_or_bias": Kind(
        "warning",
        "Wind or accelerometer bias",
        "The heading turned too little to separate wind from a bias of the accelerometer.",
    ),
}
"""Every kind of finding, by the word that scripts rely on."""
