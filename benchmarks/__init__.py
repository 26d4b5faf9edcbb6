"""Measurements of Flinders' claims on accuracy and speed: ``python -m benchmarks.accuracy``, ``… .speed``.

Linear algebra uses one thread, so that ratios of times are meaningful. This must be set before NumPy is imported.
"""

import os

for _threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ.setdefault(_threads, "1")
