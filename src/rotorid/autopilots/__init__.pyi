from rotorid.autopilots.autopilot import Autopilot as Autopilot
from rotorid.autopilots.registry import AUTOPILOTS as AUTOPILOTS
from rotorid.autopilots.registry import autopilot_of as autopilot_of
from rotorid.autopilots.registry import named as named
