"""How the poses of images are known: planned, given, or estimated from the part's own edges."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.camera.pose_uncertainty import PoseUncertainty
from planner.exceptions import PlannerError, RequestError
from planner.measuring.poses.fiducials import Fiducials
from planner.measuring.poses.gates import rigid_motion
from planner.setting.image_names import setting_name
from planner.wanted.registered.record import GIVEN, OWN_EDGES, RegistrationRecord

PLANNED = "planned"
FIDUCIALS = "fiducials"
BOTH = "fiducials and own edges"


@dataclass(frozen=True, eq=False)
class Registration:
    """How the poses of images are known.

    Make it with one of its class methods.

    Attributes
    ----------
    method : {"planned", "given", "own edges", "fiducials", "fiducials and own edges"}
        Its name.
    surfaces_mm : float or None
        Standard deviation of the position of faces along their normals. None is that of the plan.
    poses : mapping of str to array (4, 4)
        Given poses, by the setting's name.
    pose_uncertainty : PoseUncertainty or None
        Of given poses. None is that of the plan.
    board : Fiducials or None
        What the fiducials are.

    Raises
    ------
    RequestError
        If a number or pose breaks its rule.

    Examples
    --------
    >>> from planner import Registration
    >>> Registration.own_edges(surfaces_mm=0.05).method
    'own edges'
    """

    method: str
    surfaces_mm: float | None = None
    poses: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    pose_uncertainty: PoseUncertainty | None = None
    board: Fiducials | None = None

    def __post_init__(self) -> None:
        value = self.surfaces_mm
        if value is not None and not (np.isfinite(value) and value >= 0):
            raise RequestError.of_rule(
                "surfaces_mm", "must be finite and not negative", repr(value)
            )

    @classmethod
    def none(cls, surfaces_mm: float | None = None) -> Registration:
        """Return that of planned poses, as uncertain as the plan says.

        Parameters
        ----------
        surfaces_mm : float, optional
            Standard deviation of the position of faces along their normals, mm. Default: that of the plan.

        Returns
        -------
        Registration
            The registration.
        """
        return cls(PLANNED, surfaces_mm)

    @classmethod
    def own_edges(cls, surfaces_mm: float | None = None) -> Registration:
        """Return that of the part's own edges: pose and surfaces are estimated together from each image.

        Parameters
        ----------
        surfaces_mm : float, optional
            Standard deviation of the position of faces along their normals, mm. Default: that of the plan.

        Returns
        -------
        Registration
            The registration.
        """
        return cls(OWN_EDGES, surfaces_mm)

    @classmethod
    def fiducials(
        cls, board: Fiducials | str | PathLike[str], surfaces_mm: float | None = None
    ) -> Registration:
        """Return that of a ChArUco board at a known position; needs the extra ``fiducials``.

        Parameters
        ----------
        board : Fiducials or path
            The board, or its TOML file.
        surfaces_mm : float, optional
            Standard deviation of the position of faces along their normals, mm. Default: that of the plan.

        Returns
        -------
        Registration
            The registration.
        """
        known = board if isinstance(board, Fiducials) else Fiducials.read(board)
        return cls(FIDUCIALS, surfaces_mm, board=known)

    @classmethod
    def both(
        cls, board: Fiducials | str | PathLike[str], surfaces_mm: float | None = None
    ) -> Registration:
        """Return that of a ChArUco board, whose pose the part's own edges then improve.

        Parameters
        ----------
        board : Fiducials or path
            The board, or its TOML file.
        surfaces_mm : float, optional
            Standard deviation of the position of faces along their normals, mm. Default: that of the plan.

        Returns
        -------
        Registration
            The registration.
        """
        known = board if isinstance(board, Fiducials) else Fiducials.read(board)
        return cls(BOTH, surfaces_mm, board=known)

    @classmethod
    def given(
        cls,
        poses: Mapping[Any, ArrayLike],
        covariance: ArrayLike | None = None,
        surfaces_mm: float | None = None,
    ) -> Registration:
        """Return that of poses that something else has measured.

        Parameters
        ----------
        poses : mapping of str or int to array (4, 4)
            Camera to world in OpenCV axes, mm, by the setting's name or its number from 1.
        covariance : array (6, 6), optional
            Of (dx, dy, dz, phi_x, phi_y, phi_z) about the camera's own axes, mm and rad. Default: that of the plan.
        surfaces_mm : float, optional
            Standard deviation of the position of faces along their normals, mm. Default: that of the plan.

        Returns
        -------
        Registration
            The registration.

        Raises
        ------
        RequestError
            If a pose is no rigid motion, or a name has two.
        UncertaintyError
            If the covariance is none.
        """
        checked = {}
        for key, pose in poses.items():
            is_number = isinstance(key, int | np.integer) and not isinstance(key, bool)
            name = setting_name(int(key) - 1) if is_number else Path(str(key)).stem
            if name in checked:
                raise RequestError.of_rule("poses", "must have one pose of a name", repr(name))
            checked[name] = rigid_motion(pose, f"the pose of {name}")
        known = None if covariance is None else PoseUncertainty(covariance)  # type: ignore[arg-type]
        return cls(GIVEN, surfaces_mm, checked, known)

    def planned(self) -> RegistrationRecord | None:
        """Return it as a plan takes it: for poses that are not known yet.

        Returns
        -------
        RegistrationRecord or None
            None for planned poses.

        Raises
        ------
        RequestError
            If a plan cannot know how sure poses will be.
        """
        if self.method == PLANNED:
            return None
        if self.method == OWN_EDGES:
            return RegistrationRecord(OWN_EDGES, self.surfaces_mm)
        if self.pose_uncertainty is not None:
            return RegistrationRecord(GIVEN, None, self.pose_uncertainty)
        raise RequestError.of_rule(
            "registration",
            "must be from own edges, or state a covariance",
            f"one from {self.method}" if self.method != GIVEN else "given poses without one",
        )

    @classmethod
    def read(cls, path: str | PathLike[str], surfaces_mm: float | None = None) -> Registration:
        """Read given poses from a JSON file.

        Parameters
        ----------
        path : path
            Its object maps setting names to matrices (4, 4), camera to world; or holds them as "poses", with a
            "covariance" (6, 6).
        surfaces_mm : float, optional
            See `given`.

        Returns
        -------
        Registration
            The registration.

        Raises
        ------
        RequestError
            If it cannot be read or holds something else.
        """
        name = str(path)
        try:
            data = json.loads(Path(path).read_text(encoding="utf-8"))
        except OSError as error:
            raise RequestError.of_rule(
                "register", "must name a readable file", f"{name!r}: {error.strerror}"
            ) from None
        except (ValueError, RecursionError):
            raise RequestError.of_rule("register", "must be JSON", repr(name)) from None
        poses = data.get("poses", data) if isinstance(data, dict) else None
        if not isinstance(poses, dict):
            raise RequestError.of_rule("register", "must hold poses by setting name", repr(name))
        try:
            return cls.given(poses, data.get("covariance"), surfaces_mm)
        except PlannerError as error:
            raise RequestError(f"{name}: {error}") from None
