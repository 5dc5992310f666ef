from rotorid.models.autopilots.reading import axis_controller as axis_controller

# deprecated, removed in 0.3: use rotorid.models.axis_controller
from rotorid.models.autopilots.reading import rate_controller as rate_controller
from rotorid.models.autopilots.settings import AxisController as AxisController
from rotorid.models.autopilots.settings import described as described
from rotorid.models.autopilots.versions import firmware_candidates as firmware_candidates
