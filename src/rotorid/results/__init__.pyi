from rotorid.results.model import IdentifiedModel as IdentifiedModel
from rotorid.results.segment import Segment as Segment
