from rotorid.io.ardupilot.dataflash import DataFlashLog as DataFlashLog
from rotorid.io.ardupilot.dataflash import decode as decode
from rotorid.io.ardupilot.writer import write_ardupilot as write_ardupilot
