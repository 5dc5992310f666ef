from rotorid.exports.target import Compared as Compared
from rotorid.exports.target import ExportChoices as ExportChoices
from rotorid.exports.target import Exported as Exported
from rotorid.exports.target import table_lines as table_lines
from rotorid.exports.targets import TARGETS as TARGETS
from rotorid.exports.targets import Target as Target
from rotorid.exports.targets import export as export
from rotorid.exports.targets import target_named as target_named
