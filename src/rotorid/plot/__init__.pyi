from rotorid.plot.design import percent_dots as percent_dots
from rotorid.plot.design import percent_over_duration as percent_over_duration
from rotorid.plot.design import planned_flight as planned_flight
from rotorid.plot.design import predicted_bode as predicted_bode
from rotorid.plot.figure import INPUT as INPUT
from rotorid.plot.figure import MEASURED as MEASURED
from rotorid.plot.figure import MODEL as MODEL
from rotorid.plot.figure import SECONDARY as SECONDARY
from rotorid.plot.figure import SERIES as SERIES
from rotorid.plot.figure import Figure as Figure

# deprecated, removed in 0.3
from rotorid.plot.frequency import Density as Density

# deprecated, removed in 0.3
from rotorid.plot.frequency import Named as Named
from rotorid.plot.frequency import bode as bode
from rotorid.plot.frequency import coherence_map as coherence_map

# deprecated, removed in 0.3
from rotorid.plot.frequency import input_spectrum as input_spectrum
from rotorid.plot.frequency import measured_curve as measured_curve

# deprecated, removed in 0.3
from rotorid.plot.frequency import overlay as overlay
from rotorid.plot.frequency import window_contributions as window_contributions
from rotorid.plot.inspection import LogPicture as LogPicture
from rotorid.plot.inspection import log_figure as log_figure
from rotorid.plot.loops import broken_loop as broken_loop
from rotorid.plot.loops import correlation_map as correlation_map
from rotorid.plot.loops import disturbance_rejection as disturbance_rejection
from rotorid.plot.loops import s_plane as s_plane
from rotorid.plot.motors import made_by_motors as made_by_motors
from rotorid.plot.motors import rotor_layout as rotor_layout
from rotorid.plot.motors import thrust_curve as thrust_curve
from rotorid.plot.paper import PAPER_STYLE as PAPER_STYLE
from rotorid.plot.paper import bode_figure as bode_figure
from rotorid.plot.paper import log_png as log_png
from rotorid.plot.paper import matplotlib_or_remedy as matplotlib_or_remedy
from rotorid.plot.paper import overview_png as overview_png
from rotorid.plot.search import accelerations as accelerations
from rotorid.plot.search import clusters as clusters
from rotorid.plot.search import convergence as convergence
from rotorid.plot.search import run_histogram as run_histogram
from rotorid.plot.time import ahead as ahead
from rotorid.plot.time import closed_loop as closed_loop
from rotorid.plot.time import predictions as predictions
from rotorid.plot.time import residual_memory as residual_memory
from rotorid.plot.time import score_dots as score_dots
from rotorid.plot.time import simulated as simulated
from rotorid.plot.time import timeline as timeline
from rotorid.plot.time import verification as verification
