from rotorid.io.px4.folder import read_folder as read_folder
from rotorid.io.px4.ulog import ULog as ULog
from rotorid.io.px4.ulog import extract as extract
from rotorid.io.px4.writer import write_px4 as write_px4
from rotorid.io.px4.writer import write_ulog as write_ulog
