from rotorid.exports.exporting import draw_files as draw_files
from rotorid.exports.exporting import export as export
from rotorid.exports.exporting import export_draws as export_draws
from rotorid.exports.exporting import joined as joined
from rotorid.exports.settings import ExportSettings as ExportSettings
from rotorid.exports.target import Compared as Compared
from rotorid.exports.target import Exported as Exported
from rotorid.exports.target import table_lines as table_lines
from rotorid.exports.targets import TARGETS as TARGETS
from rotorid.exports.targets import Target as Target
from rotorid.exports.targets import target_named as target_named

# deprecated, removed in 0.3: use rotorid.exports.ExportSettings
ExportChoices = ExportSettings
