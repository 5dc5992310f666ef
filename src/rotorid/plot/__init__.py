"""Pictures: arrays in, figure out, nothing computed but units.

Every figure is plotly's JSON in a plain dictionary; ``rotorid.plot.figure.Figure`` says where it shows itself. One
function for each picture:

=====================================================  =============================================================
``rotorid.plot.frequency.bode``                             a response with coherence, error band and model
``rotorid.plot.paper.bode_figure``                     the same for a paper, by matplotlib
``rotorid.plot.frequency.overlay``                       several responses of one pair: records, methods, windows
``rotorid.plot.frequency.window_contributions``          which window of a composite carries which frequency
``rotorid.plot.frequency.input_spectrum``               densities of instrument, input and output
``rotorid.plot.frequency.coherence_map``                   usable bands of all inputs and outputs
``rotorid.plot.loops.broken_loop``                     a broken loop with its gain and phase margins
``rotorid.plot.loops.disturbance_rejection``           a sensitivity with its bandwidth and peak
``rotorid.plot.time.timeline``                   excitations over time
``rotorid.plot.time.verification``                     measured and predicted over time
``rotorid.plot.time.ahead``                           measured, and predicted a little ahead
``rotorid.plot.time.closed_loop``                     measured, and of the model under the same controller
``rotorid.plot.inspection.log_figure``                 a whole log
``rotorid.plot.motors.rotor_layout``                   rotors from above with their numbers and directions
``rotorid.plot.motors.thrust_curve``                   thrust of a rotor by its output
``rotorid.plot.motors.made_by_motors``                 accelerations measured and made by motors
``rotorid.plot.design.planned_flight``                 test inputs and the simulated flight over time
``rotorid.plot.design.predicted_bode``                 the response that a planned flight is expected to show
``rotorid.plot.design.percent_dots``                   predicted deviations of parameters, plan beside plan
``rotorid.plot.paper.overview_png``                 an identification as a PNG
=====================================================  =============================================================

Frequency comes in rad/s; pictures over frequency take ``frequency="Hz"``, and those with a magnitude
``magnitude="linear"``.
"""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
