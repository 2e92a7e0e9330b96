"""What tests need where loops run uncompiled (NUMBA_DISABLE_JIT=1), to count their lines or to change them."""

import numba
import numpy as np

if numba.config.DISABLE_JIT:
    from wide_integers import stand_in

    stand_in()
    # compiled loops divide by zero and overflow in silence
    np.seterr(all="ignore")
