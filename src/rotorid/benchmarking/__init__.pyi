from rotorid.benchmarking.benchmark import Benchmarked as Benchmarked
from rotorid.benchmarking.benchmark import bench as bench
from rotorid.benchmarking.catalog import BENCHMARKS as BENCHMARKS
from rotorid.benchmarking.catalog import Benchmark as Benchmark
from rotorid.benchmarking.foreign import LoadsTask as LoadsTask
from rotorid.benchmarking.foreign import StepsTask as StepsTask
from rotorid.benchmarking.settings import BenchSettings as BenchSettings
