"""PX4: ULog files, folders of ``ulog2csv``, and how simulated flights are written as one."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
