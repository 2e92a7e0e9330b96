"""What a planning that is interrupted leaves in its folder, for ``--resume``: its state, and visible regions."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from aspectgraph.visibility.kept_regions import KeptRegions
from planner.exceptions import OutputError
from planner.progress.terminal_text import visible
from planner.resume import read_state

STATE_FILE = "planning-state.json"
REGIONS_FOLDER = "planning-regions"


class Leftovers:
    """State and visible regions of an interrupted planning.

    Parameters
    ----------
    folder : pathlib.Path
        The output folder.

    Attributes
    ----------
    state : pathlib.Path
        File of the state.
    regions : KeptRegions
        Visible regions; they are computed before there is a state.
    """

    def __init__(self, folder: Path) -> None:
        self.state, self.regions = folder / STATE_FILE, KeptRegions(folder / REGIONS_FOLDER)

    def __bool__(self) -> bool:
        """Whether there is anything to go on from."""
        return self.state.exists() or bool(self.regions)

    def prepare(self, *, resume: bool, quiet: bool) -> None:
        """Refuse a state that cannot be resumed before any work; forget what is not to be resumed.

        Raises
        ------
        PlanFileError
            If the state is damaged.
        OutputError
            If it cannot be deleted.
        """
        if resume:
            if self.state.exists():
                read_state(self.state)
            elif not self and not quiet:
                folder = visible(str(self.state.parent))
                print(f"nothing to resume in {folder}: planned from the beginning", file=sys.stderr)
            return
        self.regions.remove()
        try:
            self.state.unlink(missing_ok=True)
        except OSError as error:
            reason = f"{self.state} cannot be deleted: {error.strerror}"
            raise OutputError(
                f"--out must be a folder that can be written. Got {reason}."
            ) from None

    def remove(self) -> None:
        """Delete all of it, after the end; what stays does no harm: it gives the same plan again."""
        self.regions.remove()
        with suppress(OSError):
            self.state.unlink(missing_ok=True)

    @contextmanager
    def told(self) -> Iterator[None]:
        """Tell how to go on when the work is interrupted, if there is something to go on from then."""
        try:
            with warnings.catch_warnings():
                # if it matters in the end, that is told then
                warnings.filterwarnings("ignore", "state is no longer saved", RuntimeWarning)
                yield
        except KeyboardInterrupt:
            if self:
                raise KeyboardInterrupt(
                    "'plan' continues from where it was with --resume"
                ) from None
            raise
