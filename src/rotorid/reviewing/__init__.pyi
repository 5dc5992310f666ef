from rotorid.reviewing.assembly import review as review
from rotorid.reviewing.inspection import inspect as inspect
from rotorid.reviewing.settings import ReviewSettings as ReviewSettings
