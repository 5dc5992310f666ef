from rotorid.models.autopilots.climb import acceleration_loop as acceleration_loop
from rotorid.models.autopilots.layouts import layout_of as layout_of
from rotorid.models.autopilots.layouts import mixer_of as mixer_of
from rotorid.models.autopilots.reading import axis_controller as axis_controller

# deprecated, removed in 0.3: use rotorid.models.axis_controller
from rotorid.models.autopilots.reading import rate_controller as rate_controller
from rotorid.models.autopilots.settings import AxisController as AxisController
from rotorid.models.autopilots.settings import described as described
from rotorid.models.autopilots.versions import firmware_candidates as firmware_candidates
from rotorid.models.black_box import black_box_pairs as black_box_pairs
from rotorid.models.black_box import from_state_space as from_state_space
from rotorid.models.controller import RateController as RateController
from rotorid.models.controller import SteppedController as SteppedController
from rotorid.models.derived import KNOWN_UNITS as KNOWN_UNITS
from rotorid.models.derived import RELATIONS as RELATIONS
from rotorid.models.derived import DerivedQuantities as DerivedQuantities
from rotorid.models.derived import Relation as Relation
from rotorid.models.derived import derived_quantities as derived_quantities
from rotorid.models.derived import thrust_coefficient as thrust_coefficient
from rotorid.models.equations import structure_from_equations as structure_from_equations
from rotorid.models.expression import Expression as Expression
from rotorid.models.expression import parse_expression as parse_expression
from rotorid.models.hover_layouts import physical_hover as physical_hover
from rotorid.models.hover_layouts import plain_mixer as plain_mixer
from rotorid.models.library import library_model as library_model
from rotorid.models.library import library_text as library_text
from rotorid.models.library import model_names as model_names
from rotorid.models.library import nonlinear_model as nonlinear_model
from rotorid.models.library import nonlinear_model_names as nonlinear_model_names
from rotorid.models.library import rate_model as rate_model
from rotorid.models.library import response_model as response_model
from rotorid.models.library import response_pairs as response_pairs
from rotorid.models.library import speed_damping as speed_damping
from rotorid.models.library import transfer_function as transfer_function
from rotorid.models.loop_filter import LoopFilter as LoopFilter
from rotorid.models.motors import check_motor_constants as check_motor_constants
from rotorid.models.motors import motor_parameters as motor_parameters
from rotorid.models.motors import yaw_range as yaw_range
from rotorid.models.nonlinear import NonlinearStructure as NonlinearStructure
from rotorid.models.nonlinear import about_rest as about_rest
from rotorid.models.nonlinear import flight_structure as flight_structure

# deprecated, removed in 0.3: use rotorid.models.NonlinearStructure
from rotorid.models.nonlinear import nonlinear_structure as nonlinear_structure
from rotorid.models.parameter import Parameter as Parameter
from rotorid.models.parameter import ParameterSet as ParameterSet
from rotorid.models.parameter import TieError as TieError
from rotorid.models.physical import MIXER as MIXER
from rotorid.models.physical import PhysicalEstimate as PhysicalEstimate
from rotorid.models.physical import check_hover_speed as check_hover_speed
from rotorid.models.physical import check_inertia as check_inertia
from rotorid.models.physical import check_signs as check_signs
from rotorid.models.physical import from_derivatives as from_derivatives
from rotorid.models.physical import hover_derivatives as hover_derivatives
from rotorid.models.physical import hover_speed as hover_speed
from rotorid.models.physical import rotor_forces as rotor_forces
from rotorid.models.rotors import RotorLayout as RotorLayout
from rotorid.models.rotors import ardupilot_mixer as ardupilot_mixer
from rotorid.models.rotors import check_mixer as check_mixer
from rotorid.models.rotors import layout_from_toml as layout_from_toml
from rotorid.models.rotors import layout_names as layout_names
from rotorid.models.rotors import library_layout as library_layout
from rotorid.models.rotors import px4_mixer as px4_mixer
from rotorid.models.state_space import StateSpace as StateSpace
from rotorid.models.structure import LinearStructure as LinearStructure
from rotorid.models.structure import Matrices as Matrices
from rotorid.models.structure import condense as condense
from rotorid.models.structure import connected as connected
from rotorid.models.thrust_curve import ExpoCurve as ExpoCurve
from rotorid.models.thrust_curve import PolynomialCurve as PolynomialCurve
from rotorid.models.thrust_curve import ThrustCurve as ThrustCurve

# deprecated, removed in 0.3: use rotorid.models.ExpoCurve
from rotorid.models.thrust_curve import ardupilot_curve as ardupilot_curve

# deprecated, removed in 0.3: use rotorid.models.ExpoCurve
from rotorid.models.thrust_curve import px4_curve as px4_curve
from rotorid.models.toml import from_toml as from_toml
from rotorid.models.toml import nonlinear_from_toml as nonlinear_from_toml
from rotorid.models.toml import nonlinear_to_toml as nonlinear_to_toml
from rotorid.models.toml import to_toml as to_toml
