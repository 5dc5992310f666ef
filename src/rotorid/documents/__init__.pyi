from rotorid.documents.base import to_json as to_json
from rotorid.documents.compare import read_results as read_results
from rotorid.documents.design import read_plan as read_plan
from rotorid.documents.result import ResultDocument as ResultDocument
from rotorid.documents.result import load as load
from rotorid.documents.saved import load_document as load_document
from rotorid.documents.saved import save as save
from rotorid.documents.schemas import SCHEMAS as SCHEMAS

# deprecated, removed in 0.3: use rotorid.documents.SCHEMAS
from rotorid.documents.schemas import schema_text as schema_text
from rotorid.documents.tune_check import load_foretold as load_foretold
from rotorid.documents.vehicle import named_vehicle as named_vehicle
from rotorid.documents.vehicle import parse_vehicle as parse_vehicle
from rotorid.documents.vehicle import read_vehicle as read_vehicle
from rotorid.documents.vehicle import vehicle_toml as vehicle_toml
