from rotorid.benchmarking.benchmark import bench as bench
from rotorid.data.findings import Finding as Finding
from rotorid.data.findings import Findings as Findings
from rotorid.data.flight_plan import FlightPlan as FlightPlan
from rotorid.data.flight_plan import SimulatedFlight as SimulatedFlight
from rotorid.data.record import Channel as Channel
from rotorid.data.record import FlightRecord as FlightRecord
from rotorid.data.record import Maneuver as Maneuver
from rotorid.data.record import Maneuvers as Maneuvers
from rotorid.data.record import TimeHistory as TimeHistory
from rotorid.data.record import Track as Track
from rotorid.data.response import FrequencyResponse as FrequencyResponse
from rotorid.documents.result import load as load
from rotorid.documents.saved import load_document as load_document
from rotorid.documents.saved import save as save
from rotorid.errors import InsufficientDataError as InsufficientDataError
from rotorid.errors import LogError as LogError
from rotorid.errors import ModelError as ModelError
from rotorid.errors import RotoridError as RotoridError
from rotorid.errors import UsageError as UsageError
from rotorid.exports.exporting import export as export
from rotorid.exports.settings import ExportSettings as ExportSettings
from rotorid.exports.target import Exported as Exported
from rotorid.fitting.frequency.problem import FrequencyProblem as FrequencyProblem
from rotorid.fitting.methods import fit as fit
from rotorid.fitting.problem import Problem as Problem
from rotorid.fleets.runs import fleet as fleet
from rotorid.flying.designs import design as design
from rotorid.flying.model_from_results import joined_model as joined_model
from rotorid.flying.simulation import simulate as simulate
from rotorid.flying.stitching import stitch as stitch
from rotorid.identifying.comparison import compare as compare
from rotorid.identifying.delays import delay as delay
from rotorid.identifying.identification import identify as identify
from rotorid.identifying.identify_many import identify_several as identify_several
from rotorid.identifying.tracking import track as track
from rotorid.identifying.verification import verify as verify
from rotorid.io.registry import read as read
from rotorid.io.registry import write_log as write_log
from rotorid.loops.responses import response as response
from rotorid.models.library import library_model as library_model
from rotorid.models.library import rate_model as rate_model
from rotorid.models.parameter import ParameterSet as ParameterSet
from rotorid.plot.frequency import bode as bode
from rotorid.proposing.proposal import tune as tune
from rotorid.reduction.guided import reduce as reduce
from rotorid.report.files import write_results as write_results
from rotorid.results.model import IdentifiedModel as IdentifiedModel
from rotorid.reviewing.assembly import review as review
from rotorid.reviewing.inspection import inspect as inspect
from rotorid.settings.identifying import IdentifySettings as IdentifySettings
from rotorid.settings.measuring import MeasureSettings as MeasureSettings
from rotorid.settings.measuring import ResponseSettings as ResponseSettings
from rotorid.settings.motors import MotorSettings as MotorSettings
from rotorid.settings.verifying import VerifySettings as VerifySettings
from rotorid.signal.clock import resample as resample
from rotorid.signal.excitations import find_excitations as find_excitations
from rotorid.simulation.multirotor_flight import fly_multirotor as fly_multirotor
from rotorid.simulation.wind import Wind as Wind
from rotorid.spectral.estimate import frequency_response as frequency_response
from rotorid.uncertainty.cramer_rao import bounds as bounds
from rotorid.vehicles.catalog import aircraft as aircraft
from rotorid.verification.time_domain import verify_in_time as verify_in_time

__version__: str

# deprecated, removed in 0.3: use rotorid.ExportSettings
ExportChoices = ExportSettings
# deprecated, removed in 0.3: use rotorid.MotorSettings
MotorChoices = MotorSettings
