"""What rotorid gains over what a user would do today, measured on the same data in one run."""

from __future__ import annotations

import os

# Process time counts every thread, also one that spins while small products wait. Both sides get one, and the setting
# must stand before NumPy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
