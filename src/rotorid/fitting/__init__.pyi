from rotorid.fitting.black_box.fit import BlackBoxFit as BlackBoxFit
from rotorid.fitting.black_box.fit import StartPlan as StartPlan
from rotorid.fitting.black_box.fit import fit_black_box as fit_black_box
from rotorid.fitting.black_box.fit import fit_black_box_pairs as fit_black_box_pairs

# deprecated, removed in 0.3
from rotorid.fitting.black_box.fit import information_criteria as information_criteria

# deprecated, removed in 0.3
from rotorid.fitting.black_box.polynomial import PolynomialModel as PolynomialModel

# deprecated, removed in 0.3
from rotorid.fitting.black_box.polynomial import PolynomialOrders as PolynomialOrders

# deprecated, removed in 0.3
from rotorid.fitting.black_box.polynomial import fit_arx as fit_arx

# deprecated, removed in 0.3
from rotorid.fitting.black_box.polynomial import fit_polynomial_output_error as fit_polynomial_output_error
from rotorid.fitting.black_box.subspace import SubspaceModel as SubspaceModel
from rotorid.fitting.black_box.subspace import fit_subspace as fit_subspace
from rotorid.fitting.delay.estimate import DelayAnalysis as DelayAnalysis
from rotorid.fitting.delay.estimate import DelayEstimate as DelayEstimate
from rotorid.fitting.delay.estimate import estimate_delay as estimate_delay
from rotorid.fitting.equations.equation_error import EquationErrorFit as EquationErrorFit
from rotorid.fitting.equations.equation_error import fit_equation_error as fit_equation_error

# deprecated, removed in 0.3
from rotorid.fitting.equations.equation_error import stepwise_equation as stepwise_equation
from rotorid.fitting.equations.regression import Regression as Regression
from rotorid.fitting.equations.regression import equation_error as equation_error
from rotorid.fitting.equations.regression import finite_transform as finite_transform
from rotorid.fitting.equations.regression import regress as regress
from rotorid.fitting.equations.regression import stepwise as stepwise
from rotorid.fitting.frequency.fit import fit_frequency as fit_frequency
from rotorid.fitting.frequency.fit import fit_many as fit_many
from rotorid.fitting.frequency.parameter_map import ParameterMap as ParameterMap
from rotorid.fitting.frequency.problem import FrequencyProblem as FrequencyProblem
from rotorid.fitting.frequency.problem import Points as Points
from rotorid.fitting.frequency.screening import without_structural_zeros as without_structural_zeros
from rotorid.fitting.frequency.screening import without_unseen_couplings as without_unseen_couplings
from rotorid.fitting.frequency.starts import equation_error_start as equation_error_start
from rotorid.fitting.frequency.starts import start_values as start_values
from rotorid.fitting.least_squares import LevenbergMarquardt as LevenbergMarquardt
from rotorid.fitting.least_squares import Minimum as Minimum
from rotorid.fitting.least_squares import Outcome as Outcome
from rotorid.fitting.least_squares import Residuals as Residuals
from rotorid.fitting.least_squares import Solution as Solution
from rotorid.fitting.least_squares import best_of as best_of
from rotorid.fitting.methods import fit as fit
from rotorid.fitting.motors.fit import MotorFit as MotorFit
from rotorid.fitting.motors.fit import fit_motors as fit_motors
from rotorid.fitting.motors.inertia import InertiaRegression as InertiaRegression
from rotorid.fitting.motors.inertia import inertia_regressions as inertia_regressions
from rotorid.fitting.motors.problem import MotorProblem as MotorProblem
from rotorid.fitting.problem import Fit as Fit
from rotorid.fitting.problem import Problem as Problem
from rotorid.fitting.problem import Scale as Scale
from rotorid.fitting.problem import StartBox as StartBox
from rotorid.fitting.problem import search_box as search_box
from rotorid.fitting.time.noise_model import NoiseModel as NoiseModel
from rotorid.fitting.time.noise_model import noise_model as noise_model
from rotorid.fitting.time.nonlinear import NonlinearFit as NonlinearFit
from rotorid.fitting.time.nonlinear import NonlinearProblem as NonlinearProblem
from rotorid.fitting.time.nonlinear import fit_nonlinear as fit_nonlinear
from rotorid.fitting.time.output_error import OutputErrorFit as OutputErrorFit
from rotorid.fitting.time.output_error import TimeData as TimeData
from rotorid.fitting.time.output_error import TimeProblem as TimeProblem
from rotorid.fitting.time.output_error import fit_output_error as fit_output_error
from rotorid.fitting.time.output_error import own_starts as own_starts
from rotorid.fitting.time.prediction_error import InnovationsProblem as InnovationsProblem
from rotorid.fitting.time.prediction_error import PredictionErrorFit as PredictionErrorFit
from rotorid.fitting.time.prediction_error import fit_prediction_error as fit_prediction_error
