from rotorid.spectral.composite import compose_by_least_squares as compose_by_least_squares
from rotorid.spectral.composite import compose_by_weights as compose_by_weights
from rotorid.spectral.derived import LogCurve as LogCurve
from rotorid.spectral.derived import corrected as corrected
from rotorid.spectral.derived import differentiated as differentiated
from rotorid.spectral.derived import integrated as integrated
from rotorid.spectral.derived import inverse as inverse
from rotorid.spectral.derived import log_curve as log_curve
from rotorid.spectral.derived import ratio as ratio

# deprecated, removed in 0.3
from rotorid.spectral.derived import renamed as renamed
from rotorid.spectral.derived import selected as selected
from rotorid.spectral.errors import overlap_constant as overlap_constant
from rotorid.spectral.errors import random_error as random_error
from rotorid.spectral.estimate import Diagnostics as Diagnostics
from rotorid.spectral.estimate import diagnosed_response as diagnosed_response
from rotorid.spectral.estimate import frequency_response as frequency_response
from rotorid.spectral.estimate import response_from as response_from
from rotorid.spectral.impulse import ImpulseResponse as ImpulseResponse
from rotorid.spectral.impulse import impulse_response as impulse_response
from rotorid.spectral.impulse import step_numbers as step_numbers
from rotorid.spectral.loops import closed_loop as closed_loop

# deprecated, removed in 0.3
from rotorid.spectral.loops import error_loop as error_loop

# deprecated, removed in 0.3
from rotorid.spectral.loops import feedback_controller as feedback_controller
from rotorid.spectral.loops import injected_loop as injected_loop
from rotorid.spectral.loops import sensitivity as sensitivity
from rotorid.spectral.loops import series as series
from rotorid.spectral.margins import AttitudeBandwidth as AttitudeBandwidth
from rotorid.spectral.margins import DisturbanceRejection as DisturbanceRejection
from rotorid.spectral.margins import LoopMargins as LoopMargins
from rotorid.spectral.margins import attitude_bandwidth as attitude_bandwidth
from rotorid.spectral.margins import disturbance_rejection as disturbance_rejection
from rotorid.spectral.margins import loop_margins as loop_margins
from rotorid.spectral.spectra import Spectra as Spectra
from rotorid.spectral.spectra import SpectralMatrix as SpectralMatrix
from rotorid.spectral.spectra import spectral_matrices as spectral_matrices
from rotorid.spectral.windows import HALF_SINE as HALF_SINE
from rotorid.spectral.windows import HANN as HANN
from rotorid.spectral.windows import Taper as Taper
from rotorid.spectral.windows import WindowPlan as WindowPlan
from rotorid.spectral.windows import plan_windows as plan_windows
