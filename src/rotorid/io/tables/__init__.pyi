from rotorid.io.tables.csv import write_csv as write_csv
from rotorid.io.tables.mapping import ChannelMapping as ChannelMapping
from rotorid.io.tables.mapping import parse_mapping as parse_mapping
from rotorid.io.tables.mapping import read_mapping as read_mapping
