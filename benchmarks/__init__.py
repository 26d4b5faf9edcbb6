"""What Flinders promises about accuracy and speed, measured: ``python -m benchmarks.accuracy``, ``… .speed``.

One thread for linear algebra: ratios of times then mean something. It must be set before NumPy is imported.
"""

import os

for _threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ.setdefault(_threads, "1")
