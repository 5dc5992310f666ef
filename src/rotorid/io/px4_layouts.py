"""Topics that a simulated flight is logged in: fields as PX4 1.17 has them, rates, and what no flight of ours knows.

Rates follow what PX4 logs with ``SDLOG_PROFILE = 57``, that is the default set, system identification, high rate and
debugging: what those sets log without an interval is logged at every turn of the control loop here too. Attitude comes
at 250 Hz, position at 25 Hz, sticks at 100 Hz and the battery at 2 Hz, as a log of PX4's own simulator with that
profile holds them.

References
----------
PX4, ``src/modules/logger/logged_topics.cpp`` and ``msg/``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rotorid.io.px4_topics import EXCITATION

PROFILE = 25
DEBUG_PROFILE = 32


@dataclass(frozen=True, kw_only=True, slots=True)
class Layout:
    """How a topic is logged.

    Parameters
    ----------
    topic
        Its name.
    fields
        Types and names in the order of PX4, which leaves the padding at the end of a message out.
    rate_hz
        Messages in a second; every turn of the control loop when omitted.
    fixed
        Values of fields that are no channels. Any other number with a decimal point is not a number, any other integer
        zero.
    flags
        Fields that say that something is known, and the channel that must be there for it.
    raw
        Whether the values are those of the sensors, before the filters of the autopilot.
    """

    topic: str
    fields: str
    rate_hz: float | None = None
    fixed: Mapping[str, float | bytes] = field(default_factory=dict)
    flags: Mapping[str, str] = field(default_factory=dict)
    raw: bool = False


_SAMPLED = "uint64_t timestamp;uint64_t timestamp_sample;"
_NO_THRUST = {"thrust_body[0]": 0.0, "thrust_body[1]": 0.0}

LAYOUTS: tuple[Layout, ...] = (
    Layout(
        topic="sensor_combined",
        fields="uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;"
        "int32_t accelerometer_timestamp_relative;float[3] accelerometer_m_s2;uint32_t accelerometer_integral_dt;"
        "uint8_t accelerometer_clipping;uint8_t gyro_clipping;uint8_t accel_calibration_count;"
        "uint8_t gyro_calibration_count",
        raw=True,
    ),
    Layout(topic="vehicle_angular_velocity", fields=_SAMPLED + "float[3] xyz;float[3] xyz_derivative"),
    Layout(topic="vehicle_acceleration", fields=_SAMPLED + "float[3] xyz"),
    Layout(
        topic="vehicle_attitude",
        fields=_SAMPLED + "float[4] q;float[4] delta_q_reset;uint8_t quat_reset_counter",
        rate_hz=250.0,
    ),
    Layout(
        topic="vehicle_local_position",
        fields=_SAMPLED + "uint64_t ref_timestamp;double ref_lat;double ref_lon;float x;float y;float z;"
        "float[2] delta_xy;float delta_z;float vx;float vy;float vz;float z_deriv;float[2] delta_vxy;float delta_vz;"
        "float ax;float ay;float az;float heading;float heading_var;float unaided_heading;float delta_heading;"
        "float tilt_var;float ref_alt;float dist_bottom;float dist_bottom_var;float delta_dist_bottom;float eph;"
        "float epv;float evh;float evv;float vxy_max;float vz_max;float hagl_min;float hagl_max_z;float hagl_max_xy;"
        "bool xy_valid;bool z_valid;bool v_xy_valid;bool v_z_valid;uint8_t xy_reset_counter;uint8_t z_reset_counter;"
        "uint8_t vxy_reset_counter;uint8_t vz_reset_counter;uint8_t heading_reset_counter;"
        "bool heading_good_for_control;bool xy_global;bool z_global;bool dist_bottom_valid;"
        "uint8_t dist_bottom_reset_counter;uint8_t dist_bottom_sensor_bitfield;bool dead_reckoning",
        rate_hz=25.0,
        flags={
            "xy_valid": "north",
            "z_valid": "down",
            "v_xy_valid": "velocity_north",
            "v_z_valid": "velocity_down",
        },
    ),
    Layout(
        topic="manual_control_setpoint",
        fields=_SAMPLED + "float roll;float pitch;float yaw;float throttle;float flaps;float aux1;float aux2;"
        "float aux3;float aux4;float aux5;float aux6;uint16_t buttons;bool valid;uint8_t data_source;"
        "bool sticks_moving",
        rate_hz=100.0,
        fixed={"valid": 1, "data_source": 1},
    ),
    Layout(
        topic="vehicle_attitude_setpoint",
        fields="uint64_t timestamp;float yaw_sp_move_rate;float[4] q_d;float[3] thrust_body",
        rate_hz=250.0,
        fixed=_NO_THRUST,
    ),
    Layout(
        topic="vehicle_rates_setpoint",
        fields="uint64_t timestamp;float roll;float pitch;float yaw;float[3] thrust_body;bool reset_integral",
        fixed=_NO_THRUST,
    ),
    Layout(
        topic="debug_vect",
        fields="uint64_t timestamp;float x;float y;float z;char[10] name",
        fixed={"name": EXCITATION.encode()},
    ),
    Layout(
        topic="debug_key_value",
        fields="uint64_t timestamp;float value;char[10] key",
        fixed={"key": EXCITATION.encode()},
    ),
    Layout(topic="vehicle_torque_setpoint", fields=_SAMPLED + "float[3] xyz"),
    Layout(topic="vehicle_thrust_setpoint", fields=_SAMPLED + "float[3] xyz", fixed={"xyz[0]": 0.0, "xyz[1]": 0.0}),
    Layout(topic="actuator_motors", fields=_SAMPLED + "float[12] control;uint16_t reversible_flags"),
    Layout(
        topic="battery_status",
        fields="uint64_t timestamp;float voltage_v;float current_a;float current_average_a;float discharged_mah;"
        "float remaining;float scale;float time_remaining_s;float temperature;float[14] voltage_cell_v;"
        "float max_cell_voltage_delta;float full_charge_capacity_wh;float remaining_capacity_wh;float nominal_voltage;"
        "float internal_resistance_estimate;float ocv_estimate;float ocv_estimate_filtered;"
        "float volt_based_soc_estimate;float voltage_prediction;float prediction_error;"
        "float estimation_covariance_norm;uint16_t capacity;uint16_t cycle_count;uint16_t average_time_to_empty;"
        "uint16_t manufacture_date;uint16_t state_of_health;uint16_t max_error;uint16_t interface_error;"
        "uint16_t faults;uint16_t over_discharge_count;bool connected;uint8_t cell_count;uint8_t source;"
        "uint8_t priority;uint8_t id;bool is_powering_off;bool is_required;uint8_t warning",
        rate_hz=2.0,
        fixed={"current_a": -1.0, "remaining": -1.0, "connected": 1, "id": 1},
    ),
)
"""In the order in which messages of one instant are logged: what was measured, what was asked for, what was sent."""

INTEGERS = (
    r"SDLOG_\w+|SYS_(?!VEHICLE_RESP$)\w+|MAV_\w+|PWM_\w+|CA_(AIRFRAME|FAILURE_MODE|METHOD|ROTOR_COUNT|R_REV)"
    r"|IMU_(GYRO_(CAL_EN|DNF_EN|DNF_HMC|RATEMAX)|INTEG_RATE)|SENS_BOARD_ROT"
    r"|MC_(AIRMODE|AT_APPLY|AT_EN|BAT_SCALE_EN|ORBIT_YAW_MOD|SLOW_MAP_\w+)"
    r"|MPC_(ACC_DECOUPLE|ALT_MODE|LAND_RC_HELP|POS_MODE|THR_CURVE|YAW_MODE)|BAT\d_(N_CELLS|SOURCE)"
)
"""Names of PX4's parameters that are whole numbers, among those that concern control, mixing, sensing and logging."""
