"""Names that calibration programs give to the same things, and the names that change nothing.

Upper and lower case, underscores and hyphens are left out: ``image_Width`` is ``imagewidth``.
"""

from __future__ import annotations

import re

CAMERA_MATRIX = ("cameramatrix", "k", "cameramat", "intrinsicmatrix")
INTRINSICS = ("intrinsics",)
DISTORTION = (
    *("distortioncoefficients", "distortioncoeffs", "d"),
    *("distcoeffs", "distcoeff"),
)
WIDTH = ("imagewidth", "width")
HEIGHT = ("imageheight", "height")
SIZE = ("resolution", "imagesize")
# each may say that the lens is another one than those read here
DISTORTION_MODEL = ("distortionmodel", "distmodel", "distortiontype", "disttype")
CAMERA_MODEL = (
    *("cameramodel", "cameratype", "modeltype", "model", "modelname"),
    *("lensmodel", "lenstype", "projectionmodel", "projectiontype", "projection"),
)
FISHEYE = ("fisheyemodel", "fisheye", "isfisheye", "usefisheye")
BINNING_X = ("binningx",)
BINNING_Y = ("binningy",)
ROI = ("roi",)

# OpenCV's five coefficients; the rational model holds it where its further ones are zero
BROWN_CONRADY = (
    *("plumbbob", "rationalpolynomial", "radtan", "radialtangential"),
    *("brown", "brownconrady", "opencv"),
)
PINHOLE = ("pinhole", "perspective", "standard")
UNDISTORTED = ("none", "nodistortion", "")

# What these say is not of the raw image, or is how the calibration was made. A rectification turns
# the image that a program makes of the raw one; poses and frames of other sensors come with it.
HARMLESS = frozenset(
    (
        # names, times and messages
        *("cameraname", "cameraid", "header", "comment", "rostopic", "calibrationtime"),
        *("calibrationdate", "sensortype", "ratehz", "typeid"),
        # how good the calibration is
        *("avgreprojectionerror", "reprojectionerror", "rms", "rmserror"),
        *("perviewreprojectionerrors", "stddevintrinsics"),
        # how it was made; the matrix holds the ratio and what the flags held fixed
        *("flags", "flagvalue", "aspectratio", "fixaspectratio", "nframes", "nrofframes"),
        *("nroframes", "boardwidth", "boardheight", "boardsize", "squaresize", "markersize"),
        *("imagepoints", "gridpoints", "extrinsicparameters"),
        # of the rectified image, and of other sensors
        *("rectificationmatrix", "projectionmatrix", "r", "p"),
        *("cameraextrinsicmat", "camoverlaps", "tcncnm1", "tcamimu", "tbs"),
        "timeshiftcamimu",
    )
)
READ = frozenset(
    (
        *(*CAMERA_MATRIX, *INTRINSICS, *DISTORTION, *WIDTH, *HEIGHT, *SIZE),
        *(*DISTORTION_MODEL, *CAMERA_MODEL, *FISHEYE, *BINNING_X, *BINNING_Y, *ROI),
    )
)


def plain(name: str) -> str:
    """Return a name without case, blanks, underscores and hyphens."""
    return re.sub(r"[\s_-]", "", name).casefold()
