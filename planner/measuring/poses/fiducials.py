"""Fiducials: a ChArUco board at a known position, whose corners say where the camera is.

Corners of a chessboard are found to a few hundredths of a pixel; corners of single markers are not, whatever refines
them, so those are never used. The board's own position has an uncertainty, which all of its corners share.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aspectgraph.exceptions import how_to_install
from errors.registration import Rows, posterior
from planner.camera.camera import Camera
from planner.exceptions import RequestError
from planner.measuring.image.picture import Picture
from planner.measuring.image.samples import pixels_of
from planner.measuring.poses.registered import displaced
from planner.wanted.pose_knowledge import LEAST_POSE

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

Array = NDArray[np.float64]

CORNER_PX = 0.05
"""Standard deviation of a found corner along each axis, px."""
LEAST_CORNERS = 4
"""Fewer corners say too little."""
OLDEST_OPENCV = (4, 13)
"""Older detectors find corners half a pixel off (OpenCV issue 28380)."""

_ROUNDS = 6
_REFINED_PX = 3
_STEPS = np.array([1e-3] * 3 + [1e-5] * 3)
_UNKNOWNS = 6
_FIELDS = ("squares", "square_mm", "marker_mm", "dictionary", "board2part", "sigma_mm", "sigma_rad")


class NoFiducialsError(Exception):
    """An image shows too few corners of the board; says how many."""


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

    squares: tuple[int, int]
    square_mm: float
    marker_mm: float
    dictionary: str
    board2part: Array
    sigma_mm: float
    sigma_rad: float

    def __post_init__(self) -> None:
        for name in ("square_mm", "marker_mm", "sigma_mm", "sigma_rad"):
            value = getattr(self, name)
            if not (isinstance(value, int | float) and np.isfinite(value) and value > 0):
                raise RequestError.of_rule(name, "must be positive", repr(value))
        counts = self.squares
        if len(counts) != 2 or not all(isinstance(n, int) and n >= 2 for n in counts):
            raise RequestError.of_rule("squares", "must be two numbers of at least 2", repr(counts))
        pose = np.array(self.board2part, dtype=np.float64)
        turn = pose[:3, :3] if pose.shape == (4, 4) else np.zeros((3, 3))
        if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-6):
            raise RequestError.of_rule("board2part", "must be a rigid motion (4, 4)", "another")
        object.__setattr__(self, "board2part", pose)

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
        unknown = [name for name in data if name not in _FIELDS]
        missing = [name for name in _FIELDS if name not in data]
        if unknown or missing:
            got = ", ".join(unknown) or f"no {', '.join(missing)}"
            raise RequestError.of_rule(
                f"{path}: the board", f"must have the fields {', '.join(_FIELDS)}", got
            )
        return cls(**{**data, "squares": tuple(data["squares"])})

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
        if not hasattr(cv2.aruco, self.dictionary):
            raise RequestError.of_rule(
                "dictionary", "must be one of OpenCV, such as DICT_4X4_50", repr(self.dictionary)
            )
        markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))
        board = cv2.aruco.CharucoBoard(
            self.squares, float(self.square_mm), float(self.marker_mm), markers
        )
        grey = np.clip(picture.grey * (255.0 / picture.white), 0, 255).astype(np.uint8)
        found, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(grey)
        count = 0 if ids is None else len(ids)
        if count < LEAST_CORNERS:
            raise NoFiducialsError(f"only {count} corners of the board were found")
        window = (_REFINED_PX, _REFINED_PX)
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
        images = cv2.cornerSubPix(grey, found.astype(np.float32), window, (-1, -1), stop)
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
    except ValueError as error:
        raise RequestError.of_rule("register", "must be TOML", f"{path}: {error}") from None


def locate(
    fiducials: Fiducials, pictures: list[Picture], planned: Array, pose_covariance: Array
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
    """
    seen = []
    why = "there is no image"
    for picture in pictures:
        try:
            seen.append(fiducials.corners(picture))
        except NoFiducialsError as error:
            why = str(error)
    if not seen:
        raise NoFiducialsError(why)
    points = np.concatenate([one for one, _ in seen])
    images = np.concatenate([one for _, one in seen])
    camera = pictures[0].camera
    # the board is off its stated position by a displacement of its own
    sigmas = np.repeat([fiducials.sigma_mm, fiducials.sigma_rad], 3)
    prior = np.zeros((2 * _UNKNOWNS, 2 * _UNKNOWNS))
    prior[:_UNKNOWNS, :_UNKNOWNS] = pose_covariance + np.diag(LEAST_POSE**2)
    prior[_UNKNOWNS:, _UNKNOWNS:] = np.diag(sigmas**2)
    x = np.zeros(2 * _UNKNOWNS)
    weight = np.full(2 * len(points), 1 / CORNER_PX**2)
    for _ in range(_ROUNDS):
        predicted = _predicted(x, points, fiducials, planned, camera)
        steps = np.diag(np.tile(_STEPS, 2))
        slopes = [
            (
                _predicted(x + step, points, fiducials, planned, camera)
                - _predicted(x - step, points, fiducials, planned, camera)
            )
            / (2 * step.sum())
            for step in steps
        ]
        design = np.stack(slopes, axis=1)
        rows = Rows(np.arange(len(x)), design, images.ravel() - predicted + design @ x, weight)
        found = posterior(prior, [rows], 0.0)
        x = found.mean
    pose = displaced(planned, x[:_UNKNOWNS])[0]
    return pose, found.covariance[:_UNKNOWNS, :_UNKNOWNS]


def _predicted(
    x: Array, points: Array, fiducials: Fiducials, planned: Array, camera: Camera
) -> Array:
    """Return the images of corners (2n,), px, at a displacement of the camera (6) and of the board (6)."""
    board = fiducials.board2part
    moved = displaced(board, x[_UNKNOWNS:])[0] @ np.linalg.inv(board)
    places = points @ moved[:3, :3].T + moved[:3, 3]
    return pixels_of(places, displaced(planned, x[:_UNKNOWNS])[0], camera).ravel()


def _opencv() -> Any:
    try:
        import cv2
    except ImportError:
        raise RequestError(f"fiducials need OpenCV; {how_to_install('fiducials')}.") from None
    version = tuple(int(part) for part in cv2.__version__.split(".")[:2])
    if version < OLDEST_OPENCV:
        least = ".".join(map(str, OLDEST_OPENCV))
        raise RequestError.of_rule("OpenCV", f"must be {least} or newer", cv2.__version__)
    return cv2
