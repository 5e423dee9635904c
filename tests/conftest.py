"""What every test run needs before anything is imported."""

import os

# The matrices here are 13 × 13: threads of the BLAS library only wait for each other, hundreds of times longer on a
# busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
