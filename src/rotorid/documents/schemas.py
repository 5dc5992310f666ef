"""JSON schemas of the documents, generated from their types."""

from __future__ import annotations

import json
from collections.abc import Mapping

from rotorid.documents.answer import AnswerDocument
from rotorid.documents.base import Document
from rotorid.documents.bench import BenchDesignDocument
from rotorid.documents.benchmark import BenchDocument
from rotorid.documents.brief import BriefDocument, BriefsDocument
from rotorid.documents.compare import CompareDocument
from rotorid.documents.delay import DelayDocument
from rotorid.documents.design import DesignDocument, PlanDocument, SimulationDocument
from rotorid.documents.error import ErrorDocument
from rotorid.documents.export import ExportDocument, ModelsDocument
from rotorid.documents.fleet import FleetDocument
from rotorid.documents.flown import FlownDocument
from rotorid.documents.inspection import InspectDocument, InspectionsDocument
from rotorid.documents.response import ResponseDocument
from rotorid.documents.result import ResultDocument
from rotorid.documents.results import ResultsDocument
from rotorid.documents.review import ReviewDocument, ReviewsDocument
from rotorid.documents.stitched import StitchedDocument
from rotorid.documents.track import TrackDocument
from rotorid.documents.tune import TuneDocument
from rotorid.documents.tune_check import TuneCheckDocument
from rotorid.documents.vehicle import VehicleFile
from rotorid.documents.verify import VerifyDocument

SCHEMAS: Mapping[str, type[Document]] = {
    "rotorid.result-1": ResultDocument,
    "rotorid.inspect-1": InspectDocument,
    "rotorid.response-1": ResponseDocument,
    "rotorid.verify-1": VerifyDocument,
    "rotorid.compare-1": CompareDocument,
    "rotorid.delay-1": DelayDocument,
    "rotorid.simulation-1": SimulationDocument,
    "rotorid.design-1": DesignDocument,
    "rotorid.design-bench-1": BenchDesignDocument,
    "rotorid.plan-1": PlanDocument,
    "rotorid.results-1": ResultsDocument,
    "rotorid.inspections-1": InspectionsDocument,
    "rotorid.review-1": ReviewDocument,
    "rotorid.reviews-1": ReviewsDocument,
    "rotorid.brief-1": BriefDocument,
    "rotorid.briefs-1": BriefsDocument,
    "rotorid.export-1": ExportDocument,
    "rotorid.models-1": ModelsDocument,
    "rotorid.flown-1": FlownDocument,
    "rotorid.tune-1": TuneDocument,
    "rotorid.tune_check-1": TuneCheckDocument,
    "rotorid.vehicle-1": VehicleFile,
    "rotorid.stitched-1": StitchedDocument,
    "rotorid.fleet-1": FleetDocument,
    "rotorid.error-1": ErrorDocument,
    "rotorid.track-1": TrackDocument,
    "rotorid.bench-1": BenchDocument,
    "rotorid.answer-1": AnswerDocument,
}


def schema_text(name: str) -> str:
    """The schema of one document as JSON text."""
    return json.dumps(SCHEMAS[name].model_json_schema(by_alias=True), indent=2) + "\n"
