"""The page of a design: what to fly, what it reaches, and what its data will be able to tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rotorid.errors import UsageError
from rotorid.pipeline.assemble import finding_documents
from rotorid.pipeline.design import DesignChoices, Designed, Told
from rotorid.pipeline.design_document import DesignDocument
from rotorid.pipeline.planning import STEPS
from rotorid.report.design_pictures import (
    ExpectedPictures,
    comparison_picture,
    duration_picture,
    expected_pictures,
    flight_picture,
    flown,
    spectrum_picture,
)
from rotorid.report.design_rows import (
    InputRow,
    PredictedRow,
    ReachedRow,
    UsableRow,
    compared,
    design_summary,
    inflation_words,
    input_rows,
    kind_words,
    predicted_rows,
    reach_sentences,
    reached_rows,
    usable_rows,
)
from rotorid.report.frame import render
from rotorid.report.picture import Picture
from rotorid.report.tables import FindingRow, finding_rows


@dataclass(frozen=True, kw_only=True)
class ModelSection:
    """A model in a plan: what the data will tell about it, or why they cannot support it."""

    anchor: str
    name: str
    refused: str
    rows: tuple[PredictedRow, ...]
    usable: tuple[UsableRow, ...]
    inflation: str
    pictures: ExpectedPictures
    findings: tuple[FindingRow, ...]


@dataclass(frozen=True, kw_only=True)
class PlanSection:
    """A plan on the page."""

    anchor: str
    title: str
    name: str
    duration: str
    inputs: tuple[InputRow, ...]
    reached: tuple[ReachedRow, ...]
    flight: Picture
    spectrum: Picture
    models: tuple[ModelSection, ...]
    answers: tuple[str, ...]
    durations: tuple[Picture, ...]

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All pictures of the section."""
        of_models = [one for model in self.models for one in (*model.pictures.leading, *model.pictures.folded)]
        return (self.flight, self.spectrum, *of_models, *self.durations)


def render_design(
    designed: Sequence[Designed], choices: DesignChoices, *, title: str, document: DesignDocument | None = None
) -> str:
    """The page as one HTML document, which holds everything it shows and lets no text of a model act.

    Every plan is flown in the simulator once more for its picture: a tenth of a second for two minutes.

    Parameters
    ----------
    designed
        At least one plan and what it will tell.
    choices
        What was asked for.
    title
        Heading of the page.
    document
        What ``design.json`` says: adds where all comes from, and remarks on files.

    Raises
    ------
    UsageError
        There is no plan.
    """
    if not designed:
        raise UsageError("a page of no plan was asked for", needed="at least one")
    plans = [_plan_section(one, choices, anchor=f"plan-{number}") for number, one in enumerate(designed, start=1)]
    side_by_side = compared(designed) if len(designed) > 1 else None
    if side_by_side is not None and not side_by_side.rows:
        side_by_side = None
    dots = comparison_picture(side_by_side, key="comparison") if side_by_side is not None else None
    return render(
        "design.html",
        title=title,
        sentences=design_summary(designed, choices),
        compared=side_by_side,
        dots=dots,
        plans=plans,
        grave={plan.title: grave for plan in plans if (grave := [one for one in plan.models if _grave(one)])},
        least_coherence=choices.fit.least_coherence,
        repeats=choices.plan.repeats,
        document=document,
        remarks=finding_rows(document.findings) if document is not None else (),
        pictures=[*([dots] if dots is not None else []), *(one for plan in plans for one in plan.pictures)],
    )


def _plan_section(one: Designed, choices: DesignChoices, *, anchor: str) -> PlanSection:
    plan = one.planned.plan
    durations = [
        duration_picture(found, one.wanted[model], key=f"{anchor}-duration-{number}")
        for number, (model, found) in enumerate(one.shortest.items())
    ]
    asked = any(one.wanted.values())
    steps = ("Steps have no duration to look for: it is their band.",) if asked and one.kind in STEPS else ()
    return PlanSection(
        anchor=anchor,
        title=kind_words(one.kind).capitalize(),
        name=plan.name,
        duration=f"{plan.duration_s:.0f} s",
        inputs=input_rows(one.planned),
        reached=reached_rows(one.planned.reached, choices.plan.limits),
        flight=flight_picture(plan, flown(one, choices), choices.plan.limits, key=f"{anchor}-flight"),
        spectrum=spectrum_picture(plan, key=f"{anchor}-spectrum"),
        models=tuple(
            _model_section(told, choices, anchor=f"{anchor}-model-{number}") for number, told in enumerate(one.told)
        ),
        answers=(*reach_sentences(one), *steps),
        durations=tuple(picture for picture in durations if picture is not None),
    )


def _model_section(told: Told, choices: DesignChoices, *, anchor: str) -> ModelSection:
    prediction = told.prediction
    if prediction is None:
        return ModelSection(
            anchor=anchor,
            name=told.model,
            refused=told.refused,
            rows=(),
            usable=(),
            inflation="",
            pictures=ExpectedPictures(leading=(), folded=()),
            findings=(),
        )
    return ModelSection(
        anchor=anchor,
        name=told.model,
        refused="",
        rows=predicted_rows(prediction),
        usable=usable_rows(prediction),
        inflation=inflation_words(prediction),
        pictures=expected_pictures(prediction, least_coherence=choices.fit.least_coherence, key=anchor),
        findings=finding_rows(finding_documents(prediction.findings)),
    )


def _grave(model: ModelSection) -> bool:
    """Whether something limits the trust in what is said of a model."""
    return bool(model.refused) or any(one.severity != "info" for one in model.findings)
