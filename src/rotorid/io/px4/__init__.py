"""PX4: ULog files, folders of ``ulog2csv``, and how simulated flights are written as one."""
