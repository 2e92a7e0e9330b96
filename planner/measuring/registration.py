"""How the poses of images are known: planned, given, or estimated from the part's own edges."""

from __future__ import annotations

import json

# Fiducials: a ChArUco board at a known position, whose corners say where the camera is.
#
# Corners of a chessboard are found to a few hundredths of a pixel; corners of single markers are
# not, whatever refines them, so those are never used. The board's own position has an
# uncertainty, which all of its corners share.
import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import block_diag

from aspectgraph.exceptions import how_to_install
from errors.checks import chi_squared_quantile
from errors.registration import Posterior, Rows, posterior
from ground.convert import Meta, Shape, check_fields, shown
from ground.short_repr import short_repr
from planner.argument_kinds import MAPPING, NOT_NEGATIVE, check_kinds, check_number
from planner.camera.camera import Camera
from planner.camera.pose import MAX_SIGMA_MM, MAX_SIGMA_RAD, PoseUncertainty
from planner.exceptions import PlannerError, RequestError
from planner.measuring.images import Picture
from planner.measuring.registered import displaced
from planner.measuring.samples import POSE, pixels_of
from planner.measuring.task import (
    CREDIBLE,
    MOVE_SIGMAS,
    REPEATABILITY,
    NotRegisteredError,
    check_distance,
    check_one_pose,
    distance_of,
    rigid_motion,
)
from planner.request.registration import (
    GIVEN,
    LEAST_POSE,
    OWN_EDGES,
    PLANNED,
    RegistrationRecord,
)
from planner.sensor_setting import setting_name

Array = NDArray[np.float64]

CORNER_PX = 0.05
"""Standard deviation of a found corner along each axis, px."""
LEAST_CORNERS = 4
"""Fewer corners say too little."""
OLDEST_OPENCV = (4, 13)
"""Older detectors find corners half a pixel off (OpenCV issue 28380)."""
SCALE_SIGMA = 0.1
"""By how much a print may be larger than stated, standard deviation, where this is looked for."""
MARKERS = {
    **{f"DICT_{n}X{n}_{count}": count for n in (4, 5, 6, 7) for count in (50, 100, 250, 1000)},
    "DICT_ARUCO_ORIGINAL": 1024,
    "DICT_ARUCO_MIP_36h12": 250,
    "DICT_APRILTAG_16h5": 30,
    "DICT_APRILTAG_25h9": 35,
    "DICT_APRILTAG_36h10": 2320,
    "DICT_APRILTAG_36h11": 587,
}
"""How many markers OpenCV's dictionaries have. Every second square of a board has one."""
SQUARE_MM = (0.01, 1000.0)
"""Squares of boards are this large, at least and at most."""
MOST_CORNER_PX = 10.0
"""Corners that are found less surely say nothing."""

# a solution that moves less than this share of its standard deviations is at rest
_STILL = 1e-3
_SCALE = 2 * POSE
_ROUNDS = 20
_REFINED_PX = 3
_STEPS = np.array([1e-3] * 3 + [1e-5] * 3)


class NoFiducialsError(Exception):
    """An image shows too few corners of the board; says how many."""


_Positive = Annotated[float, Meta(gt=0, title="must be positive")]
_Side = Annotated[_Positive, Meta(le=SQUARE_MM[1])]
_TWO = "must be two numbers of at least 2"
_Count = Annotated[int, Meta(ge=2, title=_TWO)]


@dataclass(frozen=True, eq=False)
class Fiducials:
    """A ChArUco board that is fixed to the part.

    Attributes
    ----------
    squares : (int, int)
        Squares of the chessboard along x and y.
    square_mm, marker_mm : float
        Sides of its squares and markers, mm.
    dictionary : str
        OpenCV's name of the markers, such as "DICT_4X4_50".
    board2part : array (4, 4)
        Pose of the board in the part's frame, mm: origin in its first corner, x and y along it.
    sigma_mm, sigma_rad : float
        Standard deviations of its position and direction, for each axis.
    corner_px : float
        Standard deviation of a found corner along each axis, px. Images whose corners are farther off are refused.

    Raises
    ------
    RequestError
        If a field breaks its rule.

    Examples
    --------
    >>> import numpy as np
    >>> from planner import Fiducials
    >>> board = Fiducials((5, 7), 10.0, 7.5, "DICT_4X4_50", np.eye(4), 0.01, 0.0002)
    >>> board.squares
    (5, 7)
    """

    squares: Annotated[tuple[_Count, _Count], Meta(title=_TWO)]
    square_mm: Annotated[_Side, Meta(ge=SQUARE_MM[0])]
    marker_mm: _Side
    dictionary: Annotated[
        str,
        Meta(
            pattern=f"^({'|'.join(MARKERS)})$", title="must be one of OpenCV, such as DICT_4X4_50"
        ),
    ]
    board2part: Annotated[Array, Shape(4, 4)]
    sigma_mm: Annotated[_Positive, Meta(le=MAX_SIGMA_MM)]
    sigma_rad: Annotated[_Positive, Meta(le=MAX_SIGMA_RAD)]
    corner_px: Annotated[_Positive, Meta(le=MOST_CORNER_PX)] = CORNER_PX

    __repr__ = short_repr

    def __post_init__(self) -> None:
        object.__setattr__(self, "board2part", rigid_motion(self.board2part, "board2part"))
        check_fields(self, RequestError, shown)
        if self.marker_mm >= self.square_mm:
            raise RequestError.of_rule(
                "marker_mm", f"must be below square_mm, {self.square_mm:g}", repr(self.marker_mm)
            )
        largest = 2 * MARKERS[self.dictionary] + 1
        if self.squares[0] * self.squares[1] > largest:
            rule = f"must be at most {largest} in all with {self.dictionary}"
            raise RequestError.of_rule("squares", rule, shown(self.squares))

    @classmethod
    def read(cls, path: str | PathLike[str]) -> Fiducials:
        """Read a board from a TOML file with the fields of this class.

        Parameters
        ----------
        path : path
            The file.

        Returns
        -------
        Fiducials
            The board.

        Raises
        ------
        RequestError
            If it cannot be read, or a field is missing, unknown or wrong.
        """
        data = _read_toml(Path(path))
        names = [field_.name for field_ in fields(cls)]
        needed = [field_.name for field_ in fields(cls) if field_.default is MISSING]
        unknown = [name for name in data if name not in names]
        missing = [name for name in needed if name not in data]
        if unknown or missing:
            got = ", ".join(unknown) or f"no {', '.join(missing)}"
            rule = f"must have the fields {', '.join(needed)}, and may have corner_px"
            raise RequestError.of_rule(f"{path}: the board", rule, got)
        try:
            return cls(**data)
        except RequestError as error:
            raise RequestError(f"{path}: {error}") from None

    def corners(self, picture: Picture) -> tuple[Array, Array]:
        """Return the corners of the chessboard that are found in an image.

        Parameters
        ----------
        picture : Picture
            The image.

        Returns
        -------
        points : array (n, 3)
            In the part's frame, mm.
        images : array (n, 2)
            Where they were found, px.

        Raises
        ------
        RequestError
            If OpenCV is missing or too old.
        NoFiducialsError
            If too few corners are found.
        """
        cv2 = _opencv()
        markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))
        board = cv2.aruco.CharucoBoard(self.squares, self.square_mm, self.marker_mm, markers)
        grey = np.clip(picture.grey * (255.0 / picture.white), 0, 255).astype(np.uint8)
        corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(grey)
        count = 0 if ids is None else len(ids)
        if count < LEAST_CORNERS:
            raise NoFiducialsError(f"only {count} corners of the board were found")
        window = (_REFINED_PX, _REFINED_PX)
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
        images = cv2.cornerSubPix(grey, corners.astype(np.float32), window, (-1, -1), stop)
        on_board = np.asarray(board.getChessboardCorners(), dtype=np.float64)[ids.ravel()]
        points = on_board @ self.board2part[:3, :3].T + self.board2part[:3, 3]
        return points, images.reshape(-1, 2).astype(np.float64)


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RequestError.of_rule(
            "register", "must name a readable file", f"{str(path)!r}: {error.strerror}"
        ) from None
    except (ValueError, RecursionError) as error:
        raise RequestError.of_rule("register", "must be TOML", f"{path}: {error}") from None


@dataclass(frozen=True, eq=False)
class _Seen:
    """Corners of the board in one image.

    Attributes
    ----------
    name : str
        The image.
    points : array (n, 3)
        Corners in the part's frame, mm.
    images : array (n, 2)
        Where they were found, px.
    """

    name: str
    points: Array
    images: Array


def locate(
    fiducials: Fiducials,
    pictures: list[Picture],
    planned: Array,
    pose_covariance: Array,
    repeatability: PoseUncertainty = REPEATABILITY,
) -> tuple[Array, Array]:
    """Return the pose of a setting by its fiducials, and the covariance of its displacement.

    Parameters
    ----------
    fiducials : Fiducials
        The board.
    pictures : list of Picture
        Images of the setting; those without the board are passed over.
    planned : array (4, 4)
        Its planned pose.
    pose_covariance : array (6, 6)
        Of the planned pose.
    repeatability : PoseUncertainty
        By how much the camera moves between images of the setting.

    Returns
    -------
    cam2world : array (4, 4)
        The pose.
    covariance : array (6, 6)
        Of (dx, dy, dz, phi_x, phi_y, phi_z) about the camera's own axes, mm and rad.

    Raises
    ------
    NoFiducialsError
        If no image shows enough corners.
    NotRegisteredError
        If the pose does not explain the corners, if it is too far from the planned one, or if images of the setting
        are from different poses.
    """
    seen = []
    why = "there is no image"
    for picture in pictures:
        try:
            seen.append(_Seen(picture.name, *fiducials.corners(picture)))
        except NoFiducialsError as error:
            why = str(error)
    if not seen:
        raise NoFiducialsError(why)
    prior = pose_covariance + np.diag(LEAST_POSE**2)
    view = _View(fiducials, seen, planned, pictures[0].camera, prior)
    solution = view.solved()
    if len(seen) > 1:
        apart = view.solved(apart=True)
        check_one_pose(
            [picture.name for picture in seen],
            apart.mean[_SCALE + 1 :],
            apart.covariance,
            repeatability,
        )
    _check_corners(view, solution)
    return displaced(planned, solution.mean[:POSE])[0], solution.covariance[:POSE, :POSE]


def _check_corners(view: _View, found: Posterior) -> None:
    """Refuse a pose that leaves corners unexplained, or that is too far from the planned one."""
    stated = view.fiducials.corner_px
    residual = view.rest(found.mean)
    freedoms = len(residual) - POSE
    square = float(residual @ residual) / stated**2
    try:
        if square > chi_squared_quantile(CREDIBLE, freedoms):
            raise NotRegisteredError(
                f"the corners of the board are {np.sqrt(residual @ residual / freedoms):.2g} px off its pose, "
                f"and corner_px is {stated:g}"
            )
        check_distance(distance_of(found.mean[:POSE], view.prior))
    except NotRegisteredError as error:
        raise NotRegisteredError(error.what, _printed(view)) from None


def _printed(view: _View) -> str:
    """Say at which scale the board looks printed, if another one than stated explains its corners surely better."""
    try:
        solution = view.solved(scaled=True)
    except NotRegisteredError:
        return ""
    scale = float(solution.mean[_SCALE])
    if scale**2 <= chi_squared_quantile(CREDIBLE, 1) * solution.covariance[_SCALE, _SCALE]:
        return ""
    percent = 100 * (1 + scale)
    return f"the board looks printed at {percent:.1f} %: measure its squares, and state square_mm"


@dataclass(frozen=True, eq=False)
class _View:
    """A board as the images of one setting show it.

    Unknowns are displacements of the camera (6) and of the board (6), by how much its print is larger than stated (1),
    and displacements of the camera in each further image (6 each).

    Attributes
    ----------
    fiducials : Fiducials
        The board.
    seen : list of _Seen
        Its corners in each image.
    planned : array (4, 4)
        The planned pose.
    camera : Camera
        The camera.
    prior : array (6, 6)
        Covariance of the camera's displacement.
    """

    fiducials: Fiducials
    seen: list[_Seen]
    planned: Array
    camera: Camera
    prior: Array

    def solved(self, *, scaled: bool = False, apart: bool = False) -> Posterior:
        """Return the unknowns; the scale and the moves between images are zero unless they are free.

        Raises
        ------
        NotRegisteredError
            If corners do not lead to a pose.
        """
        prior = self._prior()
        chosen = np.arange(2 * POSE)
        if scaled:
            chosen = np.append(chosen, _SCALE)
        if apart:
            chosen = np.append(chosen, np.arange(_SCALE + 1, len(prior)))
        steps = np.concatenate([_STEPS, _STEPS, _STEPS[-1:], np.tile(_STEPS, len(self.seen) - 1)])
        x = np.zeros(len(prior))
        solution = Posterior(x, prior)
        for _ in range(_ROUNDS):
            residual = self.rest(x)
            moves = np.diag(steps)[chosen]
            slopes = [self.rest(x - move) - self.rest(x + move) for move in moves]
            design = np.stack(slopes, axis=1) / (2 * steps[chosen])
            if not (np.isfinite(residual).all() and np.isfinite(design).all()):
                raise NotRegisteredError("the corners of the board do not lead to a pose")
            weight = np.full(len(residual), 1 / self.fiducials.corner_px**2)
            rows = Rows(chosen, design, residual + design @ x[chosen], weight)
            solution = posterior(prior, [rows], 0.0)
            last = x
            x = solution.mean
            if (np.abs(x - last) <= _STILL * np.sqrt(np.diag(solution.covariance))).all():
                break
        return solution

    def rest(self, x: Array) -> Array:
        """Return how far corners were found off their prediction at unknowns, px: all numbers in one row."""
        board = self.fiducials.board2part
        moved = displaced(board, x[POSE:_SCALE])[0]
        rests = []
        for k, picture in enumerate(self.seen):
            local = (picture.points - board[:3, 3]) @ board[:3, :3] * (1 + x[_SCALE])
            places = local @ moved[:3, :3].T + moved[:3, 3]
            pose = displaced(self.planned, x[:POSE])[0]
            if k:
                first = _SCALE + 1 + POSE * (k - 1)
                pose = displaced(pose, x[first : first + POSE])[0]
            with np.errstate(all="ignore"):
                rests.append((picture.images - pixels_of(places, pose, self.camera)).ravel())
        return np.concatenate(rests)

    def _prior(self) -> Array:
        # the board is off its stated position by a displacement of its own
        sigmas = np.repeat([self.fiducials.sigma_mm, self.fiducials.sigma_rad], 3)
        between = [MOVE_SIGMAS**2 * self.prior] * (len(self.seen) - 1)
        return block_diag(self.prior, np.diag(sigmas**2), [[SCALE_SIGMA**2]], *between)


def _opencv() -> Any:
    try:
        import cv2
    except ImportError:
        raise RequestError(f"fiducials need OpenCV; {how_to_install('fiducials')}.") from None
    version = tuple(int(part) for part in cv2.__version__.split(".")[:2])
    if version < OLDEST_OPENCV:
        oldest = ".".join(map(str, OLDEST_OPENCV))
        raise RequestError.of_rule("OpenCV", f"must be {oldest} or newer", cv2.__version__)
    return cv2


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

    __repr__ = short_repr

    def __post_init__(self) -> None:
        methods = (PLANNED, GIVEN, OWN_EDGES, FIDUCIALS, BOTH)
        if self.method not in methods:
            rule = f"must be one of {', '.join(map(repr, methods))}, as the class methods make it"
            raise RequestError.of_rule("method", rule, repr(self.method))
        if self.surfaces_mm is not None:
            check_number("surfaces_mm", self.surfaces_mm, NOT_NEGATIVE)

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
        fiducials = board if isinstance(board, Fiducials) else Fiducials.read(board)
        return cls(FIDUCIALS, surfaces_mm, board=fiducials)

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
        fiducials = board if isinstance(board, Fiducials) else Fiducials.read(board)
        return cls(BOTH, surfaces_mm, board=fiducials)

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
            If the poses are no mapping, a pose is no rigid motion, or a name has two.
        UncertaintyError
            If the covariance is none.
        """
        check_kinds(poses=(poses, MAPPING))
        checked = {}
        for key, pose in poses.items():
            is_number = isinstance(key, int | np.integer) and not isinstance(key, bool)
            name = setting_name(int(key) - 1) if is_number else Path(str(key)).stem
            if name in checked:
                raise RequestError.of_rule("poses", "must have one pose of a name", repr(name))
            checked[name] = rigid_motion(pose, f"the pose of {name}")
        uncertainty = None if covariance is None else PoseUncertainty(covariance)  # type: ignore[arg-type]
        return cls(GIVEN, surfaces_mm, checked, uncertainty)

    def planned(self) -> RegistrationRecord:
        """Return it as a plan takes it: for poses that are not known yet.

        Returns
        -------
        RegistrationRecord
            What the plan counts on.

        Raises
        ------
        RequestError
            If a plan cannot know how sure poses will be.
        """
        if self.method == PLANNED:
            return RegistrationRecord(PLANNED)
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
