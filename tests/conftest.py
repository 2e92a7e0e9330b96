"""What tests need where loops run uncompiled (NUMBA_DISABLE_JIT=1), or where lines are counted by coverage."""

import os
import subprocess
from contextlib import suppress

import numba
import numpy as np

if numba.config.DISABLE_JIT:
    from wide_integers import stand_in

    stand_in()
    # compiled loops divide by zero and overflow in silence
    np.seterr(all="ignore")

if "COVERAGE_PROCESS_CONFIG" in os.environ:
    from aspectgraph.read.step.client import StepKernel

    _killed = StepKernel.__exit__

    def _ended(self, *error):
        """Let a process that reads STEP end by itself: one that is killed cannot tell which lines it ran."""
        with suppress(OSError, subprocess.TimeoutExpired):
            self._requests.close()
            self.process.wait(60)
        _killed(self, *error)

    StepKernel.__exit__ = _ended
