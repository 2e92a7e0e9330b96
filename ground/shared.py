"""Large arguments of many tasks, which cross the boundary between two processes as bytes and are unpacked once."""

from __future__ import annotations

import hashlib
import pickle
from typing import Any

# what other processes have sent, by digest; a process works on few requests at a time
_received: dict[str, object] = {}
_MOST_RECEIVED = 4


class Shared:
    """A value that many tasks share: packed once, and unpacked once by every process that gets it.

    Parameters
    ----------
    value : object
        Anything; it is pickled only if a task goes to another process.
    """

    def __init__(self, value: Any):
        self.value = value
        self._packed: tuple[str, bytes] | None = None

    def __getstate__(self) -> tuple[str, bytes]:
        """Return the digest and the packed value."""
        if self._packed is None:
            packed = pickle.dumps(self.value)
            self._packed = hashlib.sha256(packed).hexdigest(), packed
        return self._packed

    def __setstate__(self, state: tuple[str, bytes]) -> None:
        digest, packed = state
        if digest not in _received:
            while len(_received) >= _MOST_RECEIVED:
                del _received[next(iter(_received))]
            _received[digest] = pickle.loads(packed)
        self.value = _received[digest]
        self._packed = state
