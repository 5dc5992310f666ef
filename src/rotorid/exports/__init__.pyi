from rotorid.exports.thrust import ExpoThrust as ExpoThrust
from rotorid.exports.thrust import HoverThrust as HoverThrust
from rotorid.exports.thrust import expo_thrust as expo_thrust
from rotorid.exports.thrust import sih_lag as sih_lag
