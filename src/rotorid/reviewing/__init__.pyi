from rotorid.reviewing.assembly import review as review
from rotorid.reviewing.inspection import inspect as inspect
