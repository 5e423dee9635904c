"""What every test run needs before anything is imported."""

import os
import signal

from hypothesis import settings

# The matrices here are 13 × 13: threads of the BLAS library only wait for each other, hundreds of times longer on a
# busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# What runs behind a shell has Ctrl-C ignored, and hands that on to the processes that tests interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# How long an example takes says how busy the machine is, not whether the code is right.
settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")
