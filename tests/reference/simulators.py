"""What is true of the simulators behind the flights of PX4 and ArduPilot, see their manifest."""

from __future__ import annotations

ARDUPILOT_DELAY_S = 2.45e-3
ARDUPILOT_DAMPING_1_S = -1.987
PX4 = {
    "L_roll": 113.1,
    "M_pitch": 113.1,
    "N_yaw": 13.33,
    "Z_thrust": -20.0,
    "L_p": -1.0,
    "M_q": -1.0,
    "N_r": -0.833,
    "Z_w": -1.0,
    "T_motor": 0.048,
}
PX4_DELAYS_S = {"tau_roll": 5.3e-3, "tau_pitch": 5.3e-3, "tau_yaw": 5.3e-3, "tau_thrust": 7.4e-3}
"""Raw sensors are 2.2 ms late; the low-passes before the logged topics add 3.1 ms at 40 Hz and 5.2 ms at 30 Hz."""
