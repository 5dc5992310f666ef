from rotorid.proposing.check import CheckedTuning as CheckedTuning
from rotorid.proposing.check import Foretold as Foretold
from rotorid.proposing.check import check_tuning as check_tuning
from rotorid.proposing.proposal import TuningProposal as TuningProposal
from rotorid.proposing.proposal import tune as tune
from rotorid.proposing.settings import TuneSettings as TuneSettings
