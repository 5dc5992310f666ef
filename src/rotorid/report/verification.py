"""The report of ``verify``: how well a model predicts unseen maneuvers and unseen sweeps.

Each maneuver is shown measured and predicted, with its scores in open loop, a little ahead, and in closed loop. Sweeps
are shown as Bode plots with the model over them and the cost of each response.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from rotorid.data.display import counted
from rotorid.data.quantity import MISSING, significant
from rotorid.documents.verify import GuidelineDocument, VerifyDocument, verify_document
from rotorid.plot.figure import quantity
from rotorid.plot.frequency import bode
from rotorid.plot.time import ahead, closed_loop, verification
from rotorid.report.findings import finding_rows
from rotorid.report.frame import Picture, drawn, in_all_units, render
from rotorid.report.parts import ManeuverRow, by_axis, maneuver_row, on_axis, range_rows
from rotorid.report.words import maneuver_verdict, prediction_verdict, unseen_sentences
from rotorid.results.model import FrequencyCheck, Verifications
from rotorid.results.summary import AxisLoads, FlightScores
from rotorid.results.verdicts import Verdict, cost_verdict
from rotorid.verification.closed_loop import ClosedLoop
from rotorid.verification.scores import JRMS_GUIDELINE
from rotorid.verification.verification import Verification, verdict

if TYPE_CHECKING:
    from rotorid.identifying.verification import Verified


@dataclass(frozen=True, kw_only=True, slots=True)
class ScoreRow:
    """How one output or command of an unseen maneuver was predicted.

    Parameters
    ----------
    output
        In words.
    moved
        Whether it moved enough in the maneuver to judge the model.
    still
        Why it does not judge the model, where it does not.
    tic, fit, verdict, rms, shift
        Of the open loop; a command has none, for it drives it.
    ahead
        Theil coefficient and skill over each horizon; empty for a command.
    loop
        Theil coefficient in closed loop.
    """

    output: str
    moved: bool
    still: str = "almost no motion"
    tic: str = MISSING
    fit: str = MISSING
    verdict: Verdict | None = None
    rms: str = MISSING
    shift: str = MISSING
    ahead: tuple[tuple[str, str], ...] = ()
    loop: str = MISSING


def score_rows(check: Verification) -> tuple[ScoreRow, ...]:
    """Rows of one verification, in the units of paper: outputs that moved, the others, then commands."""
    moved = check.moved or check.output_names
    ordered = sorted(check.scores, key=lambda name: name not in moved)
    return (*(_output(check, name, name in moved) for name in ordered), *_commands(check))


def horizons(check: Verification) -> tuple[str, ...]:
    """The horizons over which a maneuver was predicted ahead."""
    return tuple(f"{horizon.horizon_s:.2g} s" for horizon in check.ahead.horizons) if check.ahead else ()


def _output(check: Verification, name: str, moved: bool) -> ScoreRow:
    scores, paper = check.scores[name], quantity(name)
    return ScoreRow(
        output=paper.words,
        moved=moved,
        still="motors do not explain it" if check.flight is not None and name.endswith("_dot") else "almost no motion",
        tic=significant(scores.tic, digits=2),
        fit=significant(scores.nrmse_fit_percent, digits=2),
        verdict=prediction_verdict(scores.tic, scores.nrmse_fit_percent) if moved else None,
        rms=f"{significant(paper.factor * scores.rms)} {paper.unit}",
        shift=f"{significant(paper.factor * scores.reference_shift, digits=2)} {paper.unit}",
        ahead=_ahead(check, name),
        loop=_loop(check, name),
    )


def _commands(check: Verification) -> list[ScoreRow]:
    if check.closed_loop is None:
        return []
    names = check.closed_loop.names[check.closed_loop.outputs :]
    return [ScoreRow(output=quantity(name).words, moved=True, loop=_loop(check, name)) for name in names]


def _ahead(check: Verification, name: str) -> tuple[tuple[str, str], ...]:
    found = [horizon.scores[name] for horizon in check.ahead.horizons] if check.ahead else []
    return tuple((significant(scores.tic, digits=2), significant(scores.skill, digits=2)) for scores in found)


def _loop(check: Verification, name: str) -> str:
    flown = check.closed_loop
    return significant(flown.scores[name].tic, digits=2) if flown and name in flown.scores else MISSING


@dataclass(frozen=True, kw_only=True, slots=True)
class Check:
    """One unseen maneuver on the page."""

    maneuver: ManeuverRow
    verdict: Verdict | None
    scores: tuple[ScoreRow, ...]
    horizons: tuple[str, ...]
    j_rms: str
    picture: Picture
    ahead: Picture | None
    loop: Picture | None
    loop_words: str

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All of its figures."""
        return tuple(picture for picture in (self.picture, self.ahead, self.loop) if picture is not None)


def check_section(check: Verification, *, key: str) -> Check:
    """One unseen maneuver for the page.

    Parameters
    ----------
    check
        Measured and predicted.
    key
        Identifier of its picture.
    """
    moved = [name for name in check.output_names if name in (check.moved or check.output_names)]
    what = f"of a {check.maneuver.kind} in {check.record}"
    return Check(
        maneuver=maneuver_row(check.record, check.maneuver),
        verdict=maneuver_verdict(verdict(check)) if check.scores else None,
        scores=score_rows(check),
        horizons=horizons(check),
        j_rms=significant(check.j_rms, digits=2) if check.j_rms > 0.0 else MISSING,
        picture=Picture(
            key=key, description=f"Measured and predicted outputs {what}", figure=drawn(verification, check)
        ),
        ahead=Picture(
            key=f"{key}-ahead",
            description=f"Outputs {what}, measured and predicted a little ahead",
            figure=drawn(ahead, check.ahead, moved, of=check.output_names),
        )
        if check.ahead
        else None,
        loop=Picture(
            key=f"{key}-loop",
            description=f"Outputs and commands {what}, in flight and of the model under the same controller",
            figure=drawn(closed_loop, check.closed_loop, moved),
        )
        if check.closed_loop
        else None,
        loop_words=_loop_words(check.closed_loop) if check.closed_loop else "",
    )


def _loop_words(flown: ClosedLoop) -> str:
    """The set-points of the closed loop, and how well the controllers are known."""
    driven = [
        f"{quantity(command).words} from {quantity(channel).words} "
        f"(TIC of the controller alone: {significant(flown.controller_tic[command], digits=2)})"
        for command, channel in flown.setpoints.items()
    ]
    return f"Commands and their set-points: {', '.join(driven)}."


_MOST_UNFOLDED = 4


@dataclass(frozen=True, kw_only=True, slots=True)
class UnseenResponse:
    """One response of unseen sweeps on the page."""

    name: str
    words: str
    cost: str
    verdict: Verdict
    band: str
    points: str
    leading: bool
    picture: Picture | None


@dataclass(frozen=True, kw_only=True, slots=True)
class UnseenSweeps:
    """Sweeps of one or several logs."""

    records: tuple[str, ...]
    responses: tuple[UnseenResponse, ...]

    @property
    def leading(self) -> tuple[UnseenResponse, ...]:
        """Responses with a picture in sight."""
        return tuple(response for response in self.responses if response.leading and response.picture)

    @property
    def folded(self) -> tuple[UnseenResponse, ...]:
        """Responses whose picture folds away."""
        return tuple(response for response in self.responses if not response.leading and response.picture)

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All figures."""
        return tuple(response.picture for response in self.responses if response.picture)


def unseen_sweeps(judged: FrequencyCheck, *, key: str, least_coherence: float | None = None) -> UnseenSweeps:
    """Unseen sweeps for the page.

    Parameters
    ----------
    judged
        Measured and modeled responses, and their costs.
    key
        Prefix of the identifiers of its pictures.
    least_coherence
        Coherence below which points were left out; that of the kind of estimate by default.
    """
    pairs = by_axis([(name.partition("/")[0], name.partition("/")[2]) for name in judged.pairs])
    main = sum(on_axis(*pair) for pair in pairs)
    leading = main if main and len(pairs) > _MOST_UNFOLDED else len(pairs)
    return UnseenSweeps(
        records=judged.records,
        responses=tuple(
            _response(judged, output, input, f"{key}-{number}", number < leading, least_coherence)
            for number, (output, input) in enumerate(pairs)
        ),
    )


def _response(
    judged: FrequencyCheck, output: str, input: str, key: str, leading: bool, least_coherence: float | None
) -> UnseenResponse:
    pair = judged.pairs[f"{output}/{input}"]
    words = f"{quantity(output).words} over {quantity(input).words}"
    picture = None
    if judged.response is not None and judged.model_response is not None:
        draw = partial(
            bode,
            judged.response,
            output=output,
            input=input,
            model=judged.model_response,
            fitted=judged.used,
            least_coherence=least_coherence,
        )
        described = f"Bode plot of {words} of unseen sweeps, measured and model"
        picture = in_all_units(draw, key=key, description=described, converted=True)
    return UnseenResponse(
        name=f"{output}/{input}",
        words=words,
        cost=significant(pair.value),
        verdict=cost_verdict(pair.value),
        band=f"{significant(pair.band_rad_s[0])} to {significant(pair.band_rad_s[1])} rad/s",
        points=str(pair.points),
        leading=leading,
        picture=picture,
    )


def render_verification(verified: Verified, *, title: str) -> str:
    """The report as one self-contained HTML document, in which no text of a log can act.

    Parameters
    ----------
    verified
        What ``verify`` found.
    """
    return render_checks(verify_document(verified), verified.found, title=title)


def render_checks(document: VerifyDocument, found: Verifications, *, title: str) -> str:
    """The same of a document and the signals behind it."""
    checks, sweeps = _sections(found)
    return render(
        "verification.html",
        logs=document.provenance.inputs,
        title=title,
        document=document,
        sentences=verification_summary(document),
        checks=checks,
        sweeps=sweeps,
        j_rms=j_rms_sentence(document),
        covered=range_rows(document.covered),
        remarks=finding_rows(document.findings),
        pictures=_pictures(checks, sweeps),
    )


def pictures_of(found: Verifications) -> list[Picture]:
    """All pictures of the page."""
    return _pictures(*_sections(found))


def _sections(found: Verifications) -> tuple[list[Check], list[UnseenSweeps]]:
    checks = [check_section(check, key=f"check-{number}") for number, check in enumerate(found.maneuvers)]
    return checks, [unseen_sweeps(sweep, key=f"sweeps-{number}") for number, sweep in enumerate(found.sweeps)]


def _pictures(checks: Sequence[Check], sweeps: Sequence[UnseenSweeps]) -> list[Picture]:
    of_checks = [picture for check in checks for picture in check.pictures]
    return of_checks + [picture for sweep in sweeps for picture in sweep.pictures]


def verification_summary(document: VerifyDocument) -> tuple[str, ...]:
    """Whether the model predicts unseen flight, with the numbers and their scale: maneuvers, closed loop, sweeps."""
    sentences: list[str] = []
    if document.maneuvers:
        sentences += [_headline(document), *unseen_sentences(document.maneuvers)[1:]]
    if closed := _closed_loop(document):
        sentences.append(closed)
    costs = {name: pair.value for sweep in document.frequency for name, pair in sweep.pairs.items()}
    if costs:
        worst = max(costs, key=costs.__getitem__)
        several = f" at worst, of {len(costs)} responses," if len(costs) > 1 else ""
        sentences.append(
            f"{document.model} predicts unseen sweeps {_COST_WORDS[cost_verdict(costs[worst]).level]}: cost "
            f"{significant(costs[worst])}{several} in {worst} (up to 50 is very good, up to 100 acceptable)."
        )
    if document.flight is not None:
        sentences += flight_sentences(document.flight)
    return tuple(sentences) or (f"Not enough data to verify {document.model}.",)


def flight_sentences(scores: FlightScores) -> list[str]:
    """Errors of force and moment, the time outside of the identified range, and what the motors alone predict."""
    wrong = [
        f"{what} by {significant(factor * value, digits=2)} {unit}"
        for what, value, factor, unit in (
            ("force", scores.force_rms_n, 1.0, "N"),
            ("moment", scores.moment_rms_nm, 1e3, "mN·m"),
        )
        if value is not None
    ]
    sentences = []
    if wrong:
        by_axis = ", ".join(
            f"{axis} {' and '.join(part for part in (_newtons(loads), _millinewton_meters(loads)) if part)}"
            for axis, loads in scores.axes.items()
            if loads.force_rms_n is not None or loads.moment_rms_nm is not None
        )
        sentences.append(f"The model misses {' and '.join(wrong)} (root mean square of the vector; {by_axis}).")
    if scores.outside_percent is not None:
        sentences.append(f"{scores.outside_percent:.0f} % of the time is outside of the identified range.")
    if scores.ahead is not None:
        last = {name: errors[-1] for name, errors in scores.ahead.errors.items()}
        parts = ", ".join(
            f"{name} {significant(factor * last[name].model, digits=2)} "
            f"({significant(factor * last[name].naive, digits=2)}) {unit}"
            for name, factor, unit in _AHEAD
        )
        sentences.append(
            f"After {scores.ahead.horizon_s:.2g} s by the motors alone, mean errors are {parts}; in parentheses those "
            "of a state that is kept."
        )
    return sentences


_AHEAD = (
    ("position", 1.0, "m"),
    ("velocity", 1.0, "m/s"),
    ("attitude", 180.0 / math.pi, "°"),
    ("rates", 180.0 / math.pi, "°/s"),
)


def _newtons(loads: AxisLoads) -> str:
    return "" if loads.force_rms_n is None else f"{significant(loads.force_rms_n, digits=2)} N"


def _millinewton_meters(loads: AxisLoads) -> str:
    return "" if loads.moment_rms_nm is None else f"{significant(1e3 * loads.moment_rms_nm, digits=2)} mN·m"


_COST_WORDS = {"good": "very well", "fair": "acceptably", "poor": "poorly"}
_WORDS = {
    "good": "predicted well",
    "diverges": "predicted well over short times (the airframe is unstable, so the open loop diverges)",
    "disturbed": "too disturbed to judge",
    "poor": "predicted poorly",
}


def _headline(document: VerifyDocument) -> str:
    """How many maneuvers were predicted well."""
    found = [check.verdict for check in document.maneuvers]
    count = counted(len(found), "unseen maneuver")
    if set(found) in ({"good"}, {"poor"}):
        return f"{document.model} predicts {count} {'well' if found[0] == 'good' else 'poorly'}."
    kinds = [kind for kind in _WORDS if kind in found]
    groups = [f"{found.count(kind)} {_WORDS[kind]}" if len(kinds) > 1 else _WORDS[kind] for kind in kinds]
    return f"{document.model} on {count}: {', '.join(groups)}."


def _closed_loop(document: VerifyDocument) -> str:
    """The worst command in closed loop: rates would flatter the model."""
    loops = [check.closed_loop for check in document.maneuvers if check.closed_loop]
    commands = [(loop.scores[name].tic, name) for loop in loops for name in loop.setpoints]
    if not commands:
        return ""
    tic, name = max(commands)
    own = max(loop.controller_tic[name] for loop in loops if name in loop.controller_tic)
    return (
        f"In closed loop, with the controller of the flight, the {name.replace('_', ' ')} has a TIC of "
        f"{significant(tic, digits=2)} at worst; the logged controller alone has {significant(own, digits=2)}."
    )


def j_rms_sentence(document: VerifyDocument) -> str:
    """J_rms of all maneuvers against its guideline, in both readings where the scale is given; empty without any.

    Specific forces and angular accelerations, by which a model of flight is judged, are neither degrees nor feet.
    """
    values = [check.j_rms for check in document.maneuvers if check.j_rms > 0.0]
    if not values:
        return ""
    ends = dict.fromkeys(significant(value, digits=2) for value in (min(values), max(values)))
    return f"J_rms is {' to '.join(ends)} in degrees and feet. {_guideline(document.j_rms_guideline)}"


def _guideline(guideline: GuidelineDocument | None) -> str:
    low, high = JRMS_GUIDELINE
    if guideline is None:
        return (
            f"The guideline is {low:g} to {high:g} for full-scale aircraft; give --scale to scale it to this vehicle."
        )
    root, printed = ([significant(value) for value in pair] for pair in (guideline.root, guideline.printed))
    return (
        f"The guideline is {low:g} to {high:g} at full scale. For N = {significant(guideline.scale)} it is {root[0]} "
        f"to {root[1]} by the square root of N, as speeds scale, or {printed[0]} to {printed[1]} by N, as in print."
    )
