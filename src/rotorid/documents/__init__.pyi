from rotorid.documents.base import to_json as to_json
from rotorid.documents.compare import read_results as read_results
from rotorid.documents.design import read_plan as read_plan
from rotorid.documents.result import ResultDocument as ResultDocument
from rotorid.documents.result import load as load
from rotorid.documents.result import save as save
from rotorid.documents.schemas import SCHEMAS as SCHEMAS
from rotorid.documents.schemas import schema_text as schema_text
