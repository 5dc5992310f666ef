from rotorid.uncertainty.bootstrapping import bootstrap as bootstrap

# deprecated, removed in 0.3: use rotorid.uncertainty.bootstrap
from rotorid.uncertainty.bootstrapping import bootstrap_records as bootstrap_records
from rotorid.uncertainty.colored import ColoredCovariance as ColoredCovariance
from rotorid.uncertainty.colored import colored_covariance as colored_covariance
from rotorid.uncertainty.cramer_rao import Bounds as Bounds
from rotorid.uncertainty.cramer_rao import bounds as bounds
from rotorid.uncertainty.identifiability import Combination as Combination
from rotorid.uncertainty.identifiability import unseen_combinations as unseen_combinations
from rotorid.uncertainty.propagation import Pole as Pole
from rotorid.uncertainty.propagation import covariance_of_all as covariance_of_all
from rotorid.uncertainty.propagation import pole_confidence as pole_confidence

# deprecated, removed in 0.3
from rotorid.uncertainty.propagation import response_confidence as response_confidence
from rotorid.uncertainty.resampling import SpreadRow as SpreadRow
from rotorid.uncertainty.resampling import SpreadTable as SpreadTable

# deprecated, removed in 0.3: use rotorid.uncertainty.bootstrap
from rotorid.uncertainty.resampling import resample_records as resample_records
from rotorid.uncertainty.resampling import spread_of as spread_of
