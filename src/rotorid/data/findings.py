"""Findings: what a careful engineer would remark on, with the numbers, and the kinds that there are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, Protocol, TypeAlias, TypeVar

from rotorid.data.base import Immutable
from rotorid.data.display import html_table, lines_of

Severity: TypeAlias = Literal["info", "warning", "error"]

_ORDER = {"error": 0, "warning": 1, "info": 2}


@dataclass(frozen=True, kw_only=True)
class Finding(Immutable):
    """One remark about data, a response, a model or a check.

    Parameters
    ----------
    kind
        A snake_case word that scripts may rely on, one of :data:`KINDS`.
    severity
        ``info`` explains, ``warning`` limits the trust, ``error`` says that there is no answer.
    where
        What the remark is about: a channel, a topic, a response ``y/u``, a parameter.
    message
        One sentence for a person.
    numbers
        The same for a program; the unit is in the name.
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
    """Findings as a tuple that shows itself: one a line, and as a table in a notebook.

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
        return f"{len(self)} finding{'s' * (len(self) != 1)}"

    @property
    def _rows(self) -> list[tuple[str, str, str, str]]:
        return [(finding.severity, finding.kind, finding.where, finding.message) for finding in self]


def remark(kind: str, where: str, message: str, /, **numbers: float) -> Finding:
    """A finding that explains.

    Examples
    --------
    >>> remark("trim", "theta", "The vehicle flew forward.", theta_rad=-0.1).severity
    'info'
    """
    return Finding(kind=kind, severity="info", where=where, message=message, numbers=numbers)


def warn(kind: str, where: str, message: str, /, **numbers: float) -> Finding:
    """A finding that limits the trust in a number.

    Examples
    --------
    >>> warn("gap", "p", "0.4 s are missing.", longest_s=0.4).numbers["longest_s"]
    0.4
    """
    return Finding(kind=kind, severity="warning", where=where, message=message, numbers=numbers)


def refusal(kind: str, where: str, message: str, /, **numbers: float) -> Finding:
    """A finding that says why there is no answer.

    Examples
    --------
    >>> refusal("never_airborne", "flight.ulg", "It never flew.").severity
    'error'
    """
    return Finding(kind=kind, severity="error", where=where, message=message, numbers=numbers)


def worst_first(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Findings by severity, each once; those of one severity keep their order.

    Examples
    --------
    >>> gap, skew = warn("gap", "p", "0.4 s are missing."), remark("clock_skew", "p", "It is 5 ms late.")
    >>> [finding.kind for finding in worst_first([skew, gap, skew])]
    ['gap', 'clock_skew']
    """
    unique = {
        (finding.kind, finding.severity, finding.where, finding.message, tuple(finding.numbers.items())): finding
        for finding in findings
    }
    return tuple(sorted(unique.values(), key=lambda finding: _ORDER[finding.severity]))


Remark = TypeVar("Remark", bound="Worded")


class Worded(Protocol):
    """A finding, or its document."""

    @property
    def message(self) -> str:
        """Its words."""


def without_repeated(findings: Sequence[Remark]) -> list[Remark]:
    """Findings without those whose words are part of another one: a reason, where what follows from it names it.

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
    """What findings of a kind have in common.

    Parameters
    ----------
    severity
        The usual one.
    heading
        A few words for a person.
    meaning
        What such a finding says.
    """

    severity: Severity
    heading: str
    meaning: str


KINDS: Mapping[str, Kind] = {
    "acausal_output": Kind(
        "warning", "Acausal output", "An output that moves before its input, as behind a zero-phase filter."
    ),
    "air_not_logged": Kind(
        "info", "Wind and noise not logged", "A log shows neither wind nor noise; a plan has those of its vehicle."
    ),
    "air_of_log": Kind("info", "Wind and noise of a log", "A plan is made for the wind and the noise of a log."),
    "airborne": Kind(
        "info",
        "Reaches beyond the flight",
        "A maneuver reaches beyond the flight; as a warning, a part of it lay on the ground and was cut.",
    ),
    "amplitude_dependent": Kind(
        "warning",
        "Depends on amplitude",
        "Maneuvers with different swings of the inputs say different values; the interval reaches that of small ones.",
    ),
    "assumed_axis": Kind("info", "An axis was assumed", "What no result says of an axis of a flight was assumed."),
    "assumed_curve": Kind(
        "warning", "Assumed curve", "The curve of thrust over motor output was assumed, not identified."
    ),
    "angle_shared": Kind(
        "info", "One angle gain of two axes", "Roll and pitch have one angle gain: which value both fly, and why."
    ),
    "assumed_geometry": Kind(
        "info", "The order of the motors was assumed", "The order or the places of the motors were assumed."
    ),
    "battery_sag": Kind(
        "info",
        "The battery sagged",
        "The battery lost voltage over the flight, which changes what a motor output does.",
    ),
    "band_below_crossover": Kind(
        "warning", "Not seen where the loop acts", "A plant was seen only up to about the crossover of its loop."
    ),
    "band_beside_excitation": Kind(
        "warning",
        "The band leaves most of the excitation out",
        "A band that was given drops most of what was excited: perhaps Hz were meant and rad/s taken.",
    ),
    "beyond_limits": Kind(
        "warning", "Beyond limits", "With the amplitudes given by hand a plan passes its limits in simulation."
    ),
    "biased_by_noise": Kind(
        "warning", "Biased by noise", "A value of equation error that noise moves by more than one standard deviation."
    ),
    "biased_parameter": Kind(
        "warning",
        "Biased parameter",
        "A parameter that a planned flight will miss by more than two standard deviations.",
    ),
    "bootstrap_disagrees": Kind(
        "warning",
        "Bootstrap disagrees",
        "The spread of refits to noise drawn anew is not what the bounds say: 25 % wider or narrower, or moved by "
        "half a deviation, and no chance.",
    ),
    "bootstrap_incomplete": Kind(
        "warning", "Bootstrap incomplete", "More than 5 % of the refits of a bootstrap had no answer."
    ),
    "both_ways_disagree": Kind(
        "warning",
        "Both ways disagree",
        "The two regressions of torque and acceleration disagree, also without their bias.",
    ),
    "check_undecided": Kind(
        "warning",
        "Not enough data to check gains",
        "A flight with proposed gains does not show its loop well enough to compare it with the prediction.",
    ),
    "clock_disorder": Kind(
        "warning",
        "Stamps out of order",
        "Stamps repeat, step back, lie outside of the log or rise by less than any clock counts.",
    ),
    "clock_skew": Kind(
        "info",
        "Times of two channels",
        "How far two channels lie apart in time; a warning names the --shift that takes it out.",
    ),
    "controller_unchecked": Kind(
        "info",
        "A controller that was not checked",
        "The log does not show whether its gains made the commands, and why.",
    ),
    "controller_unexplained": Kind(
        "warning",
        "Other gains made these commands",
        "The gains in a log do not make the commands of an axis of set-point and rate.",
    ),
    "closed_loop_bias": Kind(
        "warning",
        "Feedback in this response",
        "Feedback pulls the response toward the inverse of the controller: how far direct and joint estimate lie "
        "apart, or that no instrument is logged.",
    ),
    "colored_residuals": Kind(
        "info",
        "Residuals that remember",
        "Residuals that are correlated in time, and how much wider that makes the errors than white noise would.",
    ),
    "correlated_inputs": Kind(
        "warning",
        "Inputs moved together",
        "Other inputs moved along with the excitation, or inputs cannot be separated.",
    ),
    "corrupt_log": Kind("warning", "The log is damaged", "A part of the file is damaged and was left out."),
    "decimated": Kind(
        "info",
        "Logged without a filter in front",
        "The log keeps every n-th sample without a filter in front, so that faster motion is folded into it.",
    ),
    "delay_of_yaw": Kind(
        "info", "Yaw has a delay of its own", "Motors and yaw lie apart in time by another delay than roll and pitch."
    ),
    "delay_or_lag": Kind("info", "Delay or lag", "A delay that a model of another order would take for a lag."),
    "delays_disagree": Kind("warning", "Delays disagree", "Estimates of one delay lie apart."),
    "differentiated": Kind(
        "warning",
        "Derivatives in place of sensors",
        "Rates or specific force are derivatives of angles or height, which raises noise; the numbers say by how much.",
    ),
    "different_outputs": Kind("warning", "Different outputs", "Models of different outputs, which do not compare."),
    "disturbed_verification": Kind(
        "warning", "A flight that cannot judge the model", "An unseen flight that was too disturbed to judge the model."
    ),
    "dropped_parameter": Kind("info", "A parameter was dropped", "A parameter that the data do not show was dropped."),
    "export_compromise": Kind(
        "warning", "Held otherwise", "What stands in an export for a number that the target cannot hold as it is."
    ),
    "error_not_checked": Kind(
        "info",
        "An error that was not measured",
        "The log does not show an error that others show; its usual size widens the intervals.",
    ),
    "feedforward": Kind("info", "Feed-forward", "A loop was seen together with its feed-forward."),
    "filter_not_judged": Kind(
        "warning",
        "A filter reaches an axis that was not judged",
        "A filter that is to be flown stands in the loop of an axis that could not be judged, and why.",
    ),
    "filter_refused": Kind(
        "error",
        "A filter breaks another loop",
        "With a filter that is to be flown, an axis that keeps its gains would break a limit.",
    ),
    "firmware_contradicted": Kind(
        "warning",
        "Another firmware flew",
        "The version that a log names is wrong, by its commands or by what it holds; another controller was taken.",
    ),
    "fitted_in_pieces": Kind("info", "Fitted in pieces", "Records were cut into pieces because the model is unstable."),
    "flat_bandwidth": Kind(
        "info", "A bandwidth that says little", "A response lies flat near −3 dB, so that its bandwidth says little."
    ),
    "flown_in_pieces": Kind(
        "info", "Flown in pieces", "A simulation begins anew after some seconds, since errors would add up beyond use."
    ),
    "gains_differ": Kind(
        "warning", "Logs of different gains", "Logs that are tuned together were flown with different gains."
    ),
    "gap": Kind("warning", "A gap in the data", "Samples are missing."),
    "held_out": Kind(
        "info",
        "Judged on a held-out maneuver",
        "Nothing was left unseen: a second model without one maneuver was judged on that.",
    ),
    "implausible_physics": Kind("info", "Implausible physics", "A value that is rare among vehicles that fly."),
    "frozen_sensor": Kind(
        "warning",
        "A sensor stands still amid motion",
        "A measured channel repeats one value for half a second or longer while the vehicle moves; those samples were "
        "left out.",
    ),
    "impossible_physics": Kind(
        "warning", "A value that physics does not allow", "A value that physics does not allow."
    ),
    "impossible_value": Kind(
        "warning",
        "Values that cannot be",
        "Samples that no sensor or controller gives, or that jump and are back at once, were left out.",
    ),
    "insensitive_parameter": Kind(
        "warning", "The data hardly feel this parameter", "The data hardly depend on this parameter."
    ),
    "interpolated_channel": Kind(
        "warning", "Interpolated channel", "A channel was logged so slowly that lines between its samples were taken."
    ),
    "inverse_controller": Kind(
        "warning",
        "This looks like the inverse of the controller",
        "The response is the inverse of the controller, not the vehicle.",
    ),
    "kinematic_consistency": Kind("info", "Sensors against each other", "How well sensors agree with each other."),
    "kinematic_inconsistency": Kind("warning", "Sensors contradict each other", "Sensors contradict each other."),
    "kinematics_unchecked": Kind(
        "info", "Sensors that could not be checked", "Sensors that could not be held against each other."
    ),
    "known_filter": Kind(
        "info", "A known filter", "The filters that a channel has passed, as far as the log says, and their delay."
    ),
    "beyond_speeds": Kind(
        "warning", "Beyond the speeds", "A flight goes beyond the speeds of a stitched model, where the last one holds."
    ),
    "dropped_at_speed": Kind(
        "info", "Not seen at a speed", "A parameter of a stitched model was dropped at some speeds and is zero there."
    ),
    "lost_through_speeds": Kind(
        "warning", "Fell over", "A stitched model does not stay in the air under the controllers of a flight."
    ),
    "joined_models": Kind(
        "info", "Models joined", "Longitudinal and lateral models stand side by side, with a covariance of two blocks."
    ),
    "joined_records": Kind(
        "warning",
        "Records joined",
        "Logs that hold some channels each were joined, and an input moved that one of them does not tell apart.",
    ),
    "lag_plus_delay": Kind(
        "info", "Lag and delay together", "The sum of motor lag and delay, which is known better than either."
    ),
    "legacy_units": Kind("info", "Units of an older firmware", "Units of an older firmware were converted."),
    "logs_disagree": Kind(
        "warning",
        "Logs disagree",
        "Each log alone says another value, by more than their errors; the interval holds the scatter.",
    ),
    "low_coherence": Kind(
        "warning", "Low coherence", "A response, or a part of the band, is not coherent enough to be used."
    ),
    "methods_disagree": Kind(
        "warning",
        "Two methods disagree",
        "Values that differ from those of the frequency domain by more than three standard deviations.",
    ),
    "missing_channel": Kind(
        "warning", "A channel is missing", "A channel that is needed, or would help, is not in the log."
    ),
    "motor_imbalance": Kind(
        "warning", "Motors out of balance", "In hover one motor works harder than the others, and what that means."
    ),
    "motor_out_of_step": Kind(
        "warning", "A motor out of step", "A motor slowed down while its output rose: it may have lost its step."
    ),
    "motor_reconstruction": Kind(
        "info",
        "Motors computed from commands",
        "Motor outputs were computed from faster commands, and whether they agree with those logged.",
    ),
    "never_airborne": Kind("error", "The vehicle never flew", "The vehicle never flew in this log."),
    "not_as_foretold": Kind(
        "warning", "Not what was foretold", "A loop with proposed gains does not fly as the proposal said."
    ),
    "oscillation": Kind(
        "warning",
        "An axis oscillates",
        "A loop swings by itself, mostly with a motor at its limit: its gains are too high for the vehicle.",
    ),
    "other_gains": Kind("warning", "Other gains flew", "A log that is to show proposed gains was flown with others."),
    "spin_up": Kind(
        "info",
        "Rotors that speed up turn the vehicle",
        "Yaw follows what rotors gain of their speed, besides their torque.",
    ),
    "thrust_stays": Kind(
        "info", "Thrust stays as it is", "What straightens the curve of thrust stays as it was flown, for a reason."
    ),
    "not_tuned": Kind("warning", "Gains stay", "The gains of an axis stay as they were flown, for a reason."),
    "no_controller": Kind(
        "info", "Not flown in closed loop", "Why nothing was flown in closed loop: no controller is known."
    ),
    "margin_beyond_band": Kind(
        "warning",
        "A margin lies beyond the band",
        "The end of the band bounds a margin or the peak of the sensitivity, which lie beyond it.",
    ),
    "moving_gains": Kind(
        "info",
        "Gains that move in flight",
        "The controller lowers or raises gains of its own in flight, so that the margins are those of one state of it.",
    ),
    "no_delay": Kind("warning", "No delay", "No delay can be seen."),
    "no_excitation": Kind("warning", "No excitation found", "Nothing excites this axis, or nothing above a frequency."),
    "noisy_acceleration": Kind(
        "info", "Noisy acceleration", "How far noise parts the two plain regressions of torque and acceleration."
    ),
    "noisy_regressors": Kind(
        "warning", "Noisy regressors", "Noise on the right side of an equation pulls values toward zero."
    ),
    "not_compared": Kind("info", "No second opinion", "Results without a common ground to compare on."),
    "not_converged": Kind("warning", "The fit did not converge", "The solver ended before it found a minimum."),
    "not_identifiable": Kind(
        "warning", "Parameters that cannot be told apart", "Parameters that the data cannot tell apart."
    ),
    "not_in_measured_equations": Kind(
        "warning", "Not in measured equations", "Parameters that no measured equation holds."
    ),
    "not_verified": Kind("warning", "Not verified", "A log, or a part of it, could not verify the model, and why."),
    "not_written": Kind("warning", "Not written", "A file was not written, and why."),
    "off_axis_input": Kind("info", "Another axis moved too", "Another axis was moved too."),
    "open_loop_diverges": Kind(
        "info",
        "An unstable airframe, not a bad model",
        "An unstable airframe leaves any open-loop prediction: no blame to the model.",
    ),
    "order_too_high": Kind("warning", "More order than the data show", "More states than the data show."),
    "other_controller": Kind(
        "info",
        "Another controller flew",
        "Why nothing was tuned or flown in closed loop: other gains made the commands.",
    ),
    "other_log": Kind(
        "warning", "Model of another log", "A model is used beside a log on which it was not identified."
    ),
    "other_minimum": Kind(
        "warning",
        "Other minimum",
        "Another minimum: its cost is at most 10 % higher, its parameters lie more than 3 σ and a tenth away.",
    ),
    "other_source": Kind(
        "warning",
        "Channels from different sources",
        "One channel comes from different places in the logs, and may be filtered in one of them.",
    ),
    "other_vehicle": Kind(
        "warning", "No multirotor", "The log says that it is of a plane, a VTOL, a rover or another vehicle."
    ),
    "plan_firmware": Kind(
        "warning",
        "The firmware and the plan",
        "Whether the firmware of a log flies the ArduPilot files of a plan; a remark where it does or was not checked.",
    ),
    "plan_differs": Kind(
        "warning",
        "Flown otherwise than planned",
        "A test input was flown with another band, length or size than planned, or on an axis that the plan has not.",
    ),
    "plan_not_flown": Kind(
        "warning", "Planned and not flown", "Test inputs of the plan that the log lacks; a remark where it lacks all."
    ),
    "parameters_changed": Kind(
        "warning",
        "Parameters changed",
        "Gains, filters or the curve of thrust changed within the log, and it does not say which value flew when.",
    ),
    "outputs_left_out": Kind("info", "Outputs that were not fitted", "Outputs of the model that were not fitted."),
    "parameter_at_bound": Kind(
        "warning",
        "A parameter stands at its bound",
        "A parameter ended on a bound of its range, so that its value says no more than that.",
    ),
    "payload_step": Kind(
        "warning",
        "Thrust over mass differs between logs",
        "Logs of one fit carry different masses for the same thrust: payload, rotors or battery changed.",
    ),
    "poor_fit": Kind("warning", "The model misses the measurement", "The model misses what was measured."),
    "poor_verification": Kind(
        "warning", "The model misses the unseen flight", "The model misses what was flown unseen."
    ),
    "rate_too_low": Kind("warning", "Logged too slowly", "A channel was logged too slowly, and the setting to change."),
    "receive_time": Kind("info", "Stamps of the receiver", "Stamps are those of the receiver, not of the vehicle."),
    "reconstructed": Kind(
        "info", "A channel was computed", "A channel that is not logged was made of others, which it names."
    ),
    "record_too_short": Kind("warning", "The record is short", "The record is too short for what was asked."),
    "room_not_checked": Kind(
        "info", "Limits of the motors", "Whether a motor was at a limit was not checked before gains were proposed."
    ),
    "rotor_layout": Kind("info", "Where the rotors are", "Where the rotors stand, as far as the log says."),
    "saturation": Kind("warning", "Saturation", "Motors or commands were at their limits."),
    "seen_data": Kind(
        "warning",
        "Data that the model has seen",
        "A log or stretch that the model was identified on, which is no test of it.",
    ),
    "segment_trimmed": Kind(
        "warning", "A segment was cut", "A part of a segment lies outside of the log or in a gap, and was cut."
    ),
    "sensor_clipping": Kind("warning", "A sensor clipped", "A sensor stood at the end of its range."),
    "sensor_corrected": Kind(
        "info", "Sensor corrected", "An error of a sensor, told by the kinematics, was taken out."
    ),
    "sensor_not_corrected": Kind(
        "info", "Sensor not corrected", "Errors of sensors that the flight does not excite enough to tell them."
    ),
    "several_flights": Kind("info", "Several flights in one log", "The log holds several flights."),
    "several_vehicles": Kind("warning", "Several vehicles in one log", "The log holds several vehicles."),
    "shaped_setpoint": Kind(
        "warning",
        "The autopilot smooths the set-point",
        "ArduPilot's input shaping turns the attitude set-point of a plan into another test input.",
    ),
    "singular_mixer": Kind("warning", "Singular mixer", "The mixer of these rotors cannot move all axes."),
    "speed_damping_biased": Kind(
        "warning", "Speed damping is biased", "Speed damping was taken from one response, and is biased."
    ),
    "speed_modes_left_out": Kind(
        "warning",
        "Fitted above the speed modes",
        "A rate model does not hold where the speed of the vehicle turns it; it was fitted above.",
    ),
    "structure_error": Kind(
        "warning", "The structure does not hold", "A response is missed by far more than its errors or the others are."
    ),
    "sweep_ended_early": Kind("warning", "A sweep ended early", "A sweep ended before it reached its last frequency."),
    "thrust_limit": Kind("info", "Thrust limit", "Thrust over weight stays on a plateau."),
    "plant_of_choice": Kind(
        "info",
        "Which plant gains are made for",
        "The plant of an axis is that of choices of its own, or of one of several results.",
    ),
    "thrust_range": Kind(
        "info",
        "Thrust in the gains",
        "Gains keep their limits over the throttle that was flown, by the curve of thrust that came beside the plant.",
    ),
    "several_trims": Kind(
        "warning", "Several trims", "Maneuvers at several speeds were taken for one, about their mean speed."
    ),
    "trim": Kind("info", "Not a hover", "The trim of the flight is no hover."),
    "uncertain_parameter": Kind(
        "warning", "An uncertain parameter", "A parameter that trades against others: its Cramér–Rao bound is large."
    ),
    "unknown_column": Kind("info", "A column that is not known", "A column that is not known was left out."),
    "unknown_filter": Kind("warning", "A filter that is not known", "A filter of the autopilot that is not known."),
    "unknown_topic": Kind("info", "A topic that is not known", "A topic that is not known was left out."),
    "tuning_bound": Kind("info", "What bounds gains", "What bounds proposed gains, or why the flown ones stay."),
    "unused_choice": Kind("warning", "Unused choice", "A choice that nothing used."),
    "vibration_filtered": Kind(
        "info", "Vibration was filtered out", "Vibration was filtered out of measured and predicted outputs alike."
    ),
    "voltage_exponent": Kind(
        "info",
        "Thrust over voltage",
        "The power by which thrust follows the voltage of the battery, beside the square that the model takes.",
    ),
}
"""Every kind of finding, by the word that scripts rely on."""
