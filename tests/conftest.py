"""Before numpy is loaded: one thread for linear algebra, as the command line does it."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
