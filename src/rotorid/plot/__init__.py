"""Pictures: arrays in, figure out, nothing computed but units.

Every figure is plotly's JSON in a plain dictionary; ``rotorid.plot.Figure`` says where it shows itself. One function
for each picture:

======================================  ========================================================
``rotorid.plot.bode``                   a response with coherence, error band and model
``rotorid.plot.bode_figure``            the same for a paper, by matplotlib
``rotorid.plot.window_contributions``   which window of a composite carries which frequency
``rotorid.plot.coherence_map``          usable bands of all inputs and outputs
``rotorid.plot.broken_loop``            a broken loop with its gain and phase margins
``rotorid.plot.disturbance_rejection``  a sensitivity with its bandwidth and peak
``rotorid.plot.timeline``               excitations over time
``rotorid.plot.verification``           measured and predicted over time
``rotorid.plot.ahead``                  measured, and predicted a little ahead
``rotorid.plot.closed_loop``            measured, and of the model under the same controller
``rotorid.plot.log_figure``             a whole log
``rotorid.plot.rotor_layout``           rotors from above with their numbers and directions
``rotorid.plot.thrust_curve``           thrust of a rotor by its output
``rotorid.plot.made_by_motors``         accelerations measured and made by motors
``rotorid.plot.planned_flight``         test inputs and the simulated flight over time
``rotorid.plot.predicted_bode``         the response that a planned flight is expected to show
``rotorid.plot.percent_dots``           predicted deviations of parameters, plan next to plan
``rotorid.plot.clusters``                candidates of a K-means search over its iterations
``rotorid.plot.s_plane``                poles with their uncertainty
``rotorid.plot.overview_png``           an identification as a PNG
======================================  ========================================================

Records, histories, responses and models have the most usual of them as their ``plot``. Frequency comes in rad/s;
pictures over frequency take ``frequency="Hz"``, and those with a magnitude
``magnitude="linear"``.
"""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
