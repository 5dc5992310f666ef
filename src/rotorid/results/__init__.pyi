from rotorid.results.model import IdentifiedModel as IdentifiedModel
from rotorid.results.model import Segment as Segment
