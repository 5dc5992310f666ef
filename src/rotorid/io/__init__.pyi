from rotorid.io.formats import READERS as READERS
from rotorid.io.formats import Reader as Reader
from rotorid.io.registry import format_of as format_of
from rotorid.io.registry import log_rate_hz as log_rate_hz
from rotorid.io.registry import read as read
from rotorid.io.registry import write_log as write_log
from rotorid.io.tables.csv import write_csv as write_csv
from rotorid.io.tables.mapping import read_mapping as read_mapping
