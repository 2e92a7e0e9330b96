"""An output folder belongs to one request: its plan, and what an interrupted planning of it left, stay with it.

Nothing is deleted in silence: a plan or unfinished work of another request is replaced with ``--force`` only, and
unfinished work of the same request is continued with ``--resume``, or discarded with ``--force``.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from aspectgraph import EntityError
from aspectgraph.visibility.kept_regions import KeptRegions
from planner.cli.naming import option
from planner.exceptions import InfeasibleError, OutputError, PlanFileError, RequestError
from planner.identity.inspection_request import InspectionRequest, request_difference
from planner.output.plan_folder import PLAN_FILES
from planner.plan import read_plan
from planner.resume import read_state, state_difference

STATE_FILE = "planning-state.json"
REGIONS_FOLDER = "planning-regions"
PLAN_FILE = "plan.json"
# numbers computed on another machine may differ in their last digits
_SAME = 1e-9
_RULE = "--out must be a folder without another plan; --force replaces it."
_DEFAULT_RULE = "--out must be given where ./{name} holds other files."
_UNFINISHED = "--out must be a folder without an unfinished plan."


def check_owner(
    folder: Path, request: InspectionRequest, *, force: bool, is_default: bool = False
) -> None:
    """Refuse a folder that holds the plan of another request, or files that a plan would replace.

    Parameters
    ----------
    folder : pathlib.Path
        The output folder.
    request : InspectionRequest
        What is asked now.
    force : bool
        Replace whatever is there.
    is_default : bool
        Nobody named the folder. Then it must not hold anything but a plan.

    Raises
    ------
    OutputError
        If there is a plan, and it is of another request or cannot be read; names the first difference.
        Or if there is no plan, but a file with the name of one of its files.
    """
    path = folder / PLAN_FILE
    if force:
        return
    if not path.exists():
        _check_files(folder, is_default=is_default)
        return
    try:
        stored = read_plan(path).request
    except PlanFileError as error:
        raise OutputError(f"{_RULE} Got {error}") from None
    if not stored:
        raise OutputError(f"{_RULE} Got {path} of an earlier version, without its request.")
    change = request.difference(stored, option, _SAME)
    if change is not None:
        raise OutputError(f"{_RULE} Got {path} of another request: {change}.")


def _check_files(folder: Path, *, is_default: bool) -> None:
    """Refuse a folder without a plan that holds files of somebody else."""
    for name in PLAN_FILES:
        if (folder / name).exists():
            raise OutputError(f"{_RULE} Got {folder / name} without its plan.json.")
    if not is_default or not folder.is_dir():
        return
    own = (STATE_FILE, REGIONS_FOLDER)
    others = sorted(
        path.name
        for path in folder.iterdir()
        if path.name not in own and not path.name.startswith(".")
    )
    if others:
        rule = _DEFAULT_RULE.format(name=folder.name)
        raise OutputError(f"{rule} Got {folder / others[0]} in it; write --out {folder.name}.")


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
        self.folder = folder
        self.state = folder / STATE_FILE
        self.regions = KeptRegions(folder / REGIONS_FOLDER)

    def __bool__(self) -> bool:
        """Whether there is anything to go on from."""
        return self.state.exists() or bool(self.regions)

    def prepare(
        self, request: InspectionRequest, *, resume: bool, force: bool, quiet: bool
    ) -> None:
        """Refuse what is not to be resumed, or cannot be, before any work; discard it if that is asked for.

        Raises
        ------
        PlanFileError
            If the state is to be resumed and is damaged, or of another request.
        OutputError
            If there is unfinished work that is neither to be resumed nor to be discarded, or it cannot be deleted.
        """
        identity = request.identity()
        if self.regions.folder.is_symlink():
            raise OutputError(
                f"--out must be a folder in which {REGIONS_FOLDER} is no link. "
                f"Got {self.regions.folder}, a link to {os.readlink(self.regions.folder)}."
            )
        if not self:
            if resume and not quiet:
                print(
                    f"nothing to resume in {self.folder}: planning starts from the beginning",
                    file=sys.stderr,
                )
        elif resume:
            change = self._change(identity)
            if change is not None:
                raise PlanFileError(
                    f"--resume must be of the same request. Got {self._place} of another one: {change}; "
                    "--force without --resume discards it."
                )
        elif force:
            self._discard()
        else:
            raise OutputError(f"{_UNFINISHED} Got {self._unfinished(identity)}.")
        self.regions = KeptRegions(self.regions.folder, identity)

    @property
    def _place(self) -> Path:
        return self.state if self.state.exists() else self.regions.folder

    def _unfinished(self, identity: dict[str, Any]) -> str:
        """Say what is there, and what can be done about it."""
        try:
            change = self._change(identity)
        except PlanFileError as error:
            return f"{str(error).rstrip('.')}; --force discards it"
        if change is not None:
            return (
                f"{self._place} of another request: {change}; that request with --resume continues it, "
                "--force discards it"
            )
        return f"{self._place} of this request: --resume continues it, --force starts again"

    def _change(self, identity: dict[str, Any]) -> str | None:
        """Return in what the request of what is there differs; None if it does not, or nothing says so."""
        if self.state.exists():
            return state_difference(read_state(self.state), identity, option)
        owner = self.regions.owner()
        if owner is None:
            return None
        return request_difference(identity, owner, option)

    def _discard(self) -> None:
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
                raise KeyboardInterrupt("'plan' with --resume continues from here") from None
            raise

    @contextmanager
    def forgotten_if_refused(self) -> Iterator[None]:
        """Delete regions if the request turns out to be one that cannot be planned: nobody can go on from them."""
        try:
            yield
        except (EntityError, InfeasibleError, RequestError) as error:
            # with more time the request can be planned
            if error.parameter != "time_limit_s" and not self.state.exists():
                self.regions.remove()
            raise
