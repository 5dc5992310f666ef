from rotorid.report.files import write_design as write_design
from rotorid.report.files import write_responses as write_responses
from rotorid.report.files import write_results as write_results
from rotorid.report.files import write_simulation as write_simulation
from rotorid.report.files import write_tuning as write_tuning
from rotorid.report.files import write_tuning_check as write_tuning_check
