"""The probability that a segment is measured accurately, from the joint law of its errors."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from errors.checks import (
    MIN_IMAGE_LENGTH_MM,
    FloatArray,
    check_covariance,
    check_endpoints,
    check_leading_shapes,
    check_pixel_pitch,
    check_positive,
    check_probability,
    covariance_root,
    has_image,
)
from errors.exceptions import InvalidParameterError, InvalidShapeError
from errors.referee import simulate_success
from errors.segment import independent_probability
from ground.decorators import njit

# The joint model: both ends of an edge move together because one displaced pose moves them.
#
# Notation
# --------
# L, L'     image length at the nominal and at the displaced pose;  A the required accuracy
# delta     displacement ~ N(0, Sigma), Sigma = S S';  delta = S xi with xi standard normal ("whitened")
# x         L ln(L'/L): the error itself to first order, but closer to quadratic in delta than L' - L is, since
#           perspective multiplies lengths (at 0.055 rad the largest difference from Monte Carlo over 40 edges is 0.002
#           with x, 0.005 with L' - L). |L' - L| <= (1 - A) L  is exactly  L ln A <= x <= L ln(2 - A)
# g, H      gradient and Hessian of x: those of L (`expansion`), with H less g g' / L for the logarithm
# b, M      S'g and S'HS: the same in whitened coordinates, x ~ b.xi + 1/2 xi'M xi
# alpha     diagonal of M after the orthogonal change of coordinates that makes M tridiagonal and b a multiple of the
# beta      first axis; beta is the off-diagonal
# D_k       1 - i t alpha_k + t^2 beta_k^2 / D_{k+1}, the pivots of I - itM from the last to the first; Re D_k >= 1
# p_k       D_k D_{k+1} ... D_5 = (1 - i t alpha_k) p_{k+1} + t^2 beta_k^2 p_{k+2}: the same without a division each
#
# Then, without any eigenvalue (the eigenbasis would give prod (1 - it lambda)^(-1/2) exp(-t^2 b^2
# / 2(1 - it lambda)))
#
# E exp(itx) = prod D_k^(-1/2) exp(-1/2 t^2 |b|^2 / D_0) sinc^2(t r_x e1 / 2) sinc^2(t r_y e2 / 2)
#
# the sinc factors being the four uniform quantization errors of eq 3. The probability of an
# interval follows by the Gil-Pelaez inversion on equidistant nodes (Davies 1973), whose error is
# the probability outside one period and so shrinks faster than any power of the number of nodes:
# ten to twenty are typical, some eighty where M dominates, with the period and the last node
# chosen for a total error of about 1e-5.
#
# References
# ----------
# J. Gil-Pelaez, "Note on the inversion theorem", Biometrika 38, 1951.
# R. B. Davies, "Numerical inversion of a characteristic function", Biometrika 60, 1973.


# Image length of an edge as a function of the camera's displacement, to second order.
#
# Notation
# --------
# delta = (d, phi)   displacement: translation d (mm) and rotation vector phi (rad), both in the camera frame
# C' = R(phi) C + d  displaced end point, R the exact rotation: C + phi x C + d + 1/2 phi x (phi x C) + O(3)
# w = 1 / (f - C3)   inverse depth
# e, n               unit vectors along and across the image segment
# a                  gradient of e . (u, v) in C:  f w (e1, e2, w (e1 C1 + e2 C2));  its Hessian is w (a z' + z a')
# A = (a, C x a)     the same gradient in delta, because a . (phi x C) = phi . (C x a)
# Z = (z, C x z)     gradient of C3 in delta, z = (0, 0, 1)
# B                  difference of the two ends' A with n instead of e: how far the segment turns
#
# With ' for transpose, + for the second and - for the first end point:
#
#     gradient  g = A2 - A1
#     Hessian   H = sum +- [ w (A Z' + Z A') + rotation block (1/2 (a C' + C a') - (a . C) I) ] + B B' / L


def length_expansion(
    endpoints: ArrayLike, *, focal_length_mm: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return image length, its gradient and its Hessian in the displacement (dx, dy, dz, phi_x, phi_y, phi_z).

    Guarantee: the derivatives are those of the exact length under C' = R(phi) C + d with R the rotation by the vector
    phi, at zero displacement. Turning about the optical axis (phi_z) changes no length, so the last entry of the
    gradient is zero up to round-off.

    Parameters
    ----------
    endpoints : array-like, shape (..., 2, 3)
        Edge ends in the paper's camera frame, in mm.
    focal_length_mm : float
        Distance from the image plane to the lens centre, in mm.

    Returns
    -------
    length : array, shape (...)
        Image length in mm.
    gradient : array, shape (..., 6)
        Per mm for the first three, per radian for the last three.
    hessian : array, shape (..., 6, 6)
        Symmetric.

    Raises
    ------
    BehindLensError, DegenerateSegmentError, InvalidParameterError
        As `success_probability`.

    Examples
    --------
    >>> from errors import length_expansion
    >>> length, gradient, _ = length_expansion([[-20, 0, -90], [20, 0, -90]], focal_length_mm=10.0)
    >>> float(length), gradient.round(6).tolist()
    (4.0, [0.0, 0.0, 0.04, 0.0, 0.0, 0.0])
    """
    f = check_positive(focal_length_mm, "focal_length_mm")
    endpoints = check_endpoints(endpoints, f)
    lead = endpoints.shape[:-2]
    flat = np.ascontiguousarray(endpoints).reshape(-1, 2, 3)
    length = np.empty(len(flat))
    gradient = np.empty((len(flat), 6))
    hessian = np.empty((len(flat), 6, 6))
    _expand_all(flat, f, length, gradient, hessian)
    return length.reshape(lead), gradient.reshape((*lead, 6)), hessian.reshape((*lead, 6, 6))


@njit(error_model="numpy")
def expand(ends, f, g, h, work):
    """Write gradient (6,) and Hessian (6, 6) of one edge's image length; return length and direction (L, e1, e2).

    `work` is scratch of shape (3, 6): the vectors A, Z and B of the module's notation.
    """
    w1 = 1.0 / (f - ends[0, 2])
    w2 = 1.0 / (f - ends[1, 2])
    du = f * (ends[1, 0] * w2 - ends[0, 0] * w1)
    dv = f * (ends[1, 1] * w2 - ends[0, 1] * w1)
    length = math.sqrt(du * du + dv * dv)
    e1 = du / length
    e2 = dv / length
    g[:] = 0.0
    h[:] = 0.0
    work[2, :] = 0.0
    _add_end(ends[0], w1, f, e1, e2, -1.0, g, h, work)
    _add_end(ends[1], w2, f, e1, e2, 1.0, g, h, work)
    for i in range(6):
        for j in range(i + 1):
            h[i, j] += work[2, i] * work[2, j] / length
            h[j, i] = h[i, j]
    return length, e1, e2


@njit(error_model="numpy")
def _add_end(c, w, f, e1, e2, sign, g, h, work):
    """Add one end point's share (sign -1 first, +1 second) to g, to the lower triangle of h and to B."""
    a = work[0]
    _point_gradient(c, w, f, -e2, e1, a)
    for i in range(6):
        work[2, i] += sign * a[i]
    _point_gradient(c, w, f, e1, e2, a)
    z = work[1]
    z[0] = 0.0
    z[1] = 0.0
    z[2] = 1.0
    z[3] = c[1]
    z[4] = -c[0]
    z[5] = 0.0
    sw = sign * w
    for i in range(6):
        g[i] += sign * a[i]
        for j in range(i + 1):
            h[i, j] += sw * (a[i] * z[j] + z[i] * a[j])
    dot = a[0] * c[0] + a[1] * c[1] + a[2] * c[2]
    for i in range(3):
        for j in range(i + 1):
            h[3 + i, 3 + j] += sign * 0.5 * (a[i] * c[j] + c[i] * a[j])
        h[3 + i, 3 + i] -= sign * dot


@njit(error_model="numpy")
def _point_gradient(c, w, f, e1, e2, out):
    """Write A = (a, C x a): the derivative of e . (u, v) by the displacement."""
    a1 = f * w * e1
    a2 = f * w * e2
    a3 = f * w * w * (e1 * c[0] + e2 * c[1])
    out[0] = a1
    out[1] = a2
    out[2] = a3
    out[3] = c[1] * a3 - c[2] * a2
    out[4] = c[2] * a1 - c[0] * a3
    out[5] = c[0] * a2 - c[1] * a1


@njit(error_model="numpy")
def _expand_all(endpoints, f, length, gradient, hessian):
    work = np.empty((3, 6))
    for i in range(len(endpoints)):
        length[i] = expand(endpoints[i], f, gradient[i], hessian[i], work)[0]


# The sum stops where its terms are below this, which leaves less than about 1e-5 of it.
_TAIL = 2e-6
_MAX_NODES = 1000


def joint_probability(
    endpoints: NDArray[np.float64],
    focal_length_mm: float,
    pixel_pitch_mm: NDArray[np.float64],
    root: NDArray[np.float64],
    accuracy: float,
) -> NDArray[np.float64]:
    """Return P(|L' - L| <= (1 - A) L) under the joint model; arguments already checked, 0 for edges without image.

    Parameters
    ----------
    endpoints : array, shape (n, 2, 3)
        Edge ends in the paper's camera frame, in mm.
    focal_length_mm : float
        Distance from image plane to lens centre, in mm.
    pixel_pitch_mm : array, shape (2,)
        r_x, r_y in mm.
    root : array, shape (1, 6, 6) or (n, 6, 6)
        S with S S' the covariance of the displacement; one for all edges or one each.
    accuracy : float
        A in (0, 1).

    Returns
    -------
    array, shape (n,)
        Probabilities in [0, 1].
    """
    out = np.empty(len(endpoints))
    _joint_loop(
        np.ascontiguousarray(endpoints),
        focal_length_mm,
        pixel_pitch_mm[0],
        pixel_pitch_mm[1],
        np.ascontiguousarray(root),
        math.log(accuracy),
        math.log(2.0 - accuracy),
        out,
    )
    return out


@njit(error_model="numpy")
def _joint_loop(endpoints, f, rx, ry, root, log_low, log_high, out):
    g = np.empty(6)
    b = np.empty(6)
    alpha = np.empty(6)
    beta2 = np.zeros(6)
    h = np.empty((6, 6))
    m = np.empty((6, 6))
    work = np.empty((3, 6))
    shared = len(root) == 1
    for i in range(len(endpoints)):
        if endpoints[i, 0, 2] >= f or endpoints[i, 1, 2] >= f:
            out[i] = 0.0
            continue
        s = root[0] if shared else root[i]
        length, e1, e2 = expand(endpoints[i], f, g, h, work)
        if not length > MIN_IMAGE_LENGTH_MM:
            out[i] = 0.0
            continue
        # the error is taken as L ln(L' / L); its Hessian is H - g g' / L
        for j in range(6):
            for k in range(6):
                h[j, k] -= g[j] * g[k] / length
        _whiten(g, h, s, b, m, work)
        b_norm2 = _tridiagonalise(b, m, alpha, beta2, work)
        low = length * log_low
        high = length * log_high
        out[i] = _interval_probability(
            alpha, beta2, b_norm2, (abs(e1) * rx, abs(e2) * ry, 0.0), low, high
        )


@njit(error_model="numpy")
def _whiten(g, h, s, b, m, work):
    """Write b = S'g and M = S'HS."""
    row = work[0]
    for j in range(6):
        total = 0.0
        for i in range(6):
            total += s[i, j] * g[i]
        b[j] = total
        for i in range(6):
            total = 0.0
            for k in range(6):
                total += h[i, k] * s[k, j]
            row[i] = total
        for k in range(j, 6):
            total = 0.0
            for i in range(6):
                total += s[i, k] * row[i]
            m[j, k] = total
            m[k, j] = total


@njit(error_model="numpy")
def _tridiagonalise(b, m, alpha, beta2, work):
    """Rotate b onto the first axis and M to tridiagonal form; fill alpha, beta squared, return |b| squared.

    Householder reflections; the first one is built from b, the others from the columns of M. b and M are destroyed.
    beta2[k] couples axes k - 1 and k; beta2[0] is 0.
    """
    v = work[0]
    p = work[1]
    b_norm2 = 0.0
    for start in range(6):
        norm2 = 0.0
        for i in range(start, 6):
            v[i] = b[i] if start == 0 else m[i, start - 1]
            norm2 += v[i] * v[i]
        if start == 0:
            b_norm2 = norm2
        else:
            beta2[start] = norm2
        if norm2 > 0.0 and start < 5:
            norm = math.sqrt(norm2)
            # 2 / |v|^2 of the vector that v becomes, away from cancellation
            scale = 1.0 / (norm2 + norm * abs(v[start]))
            v[start] += math.copysign(norm, v[start])
            _reflect(m, v, p, scale, start)
        alpha[start] = m[start, start]
    return b_norm2


@njit(error_model="numpy")
def _reflect(m, v, p, scale, start):
    """Replace the trailing block of M by P M P with P = I - scale v v'."""
    dot = 0.0
    for i in range(start, 6):
        total = 0.0
        for j in range(start, 6):
            total += m[i, j] * v[j]
        p[i] = scale * total
        dot += p[i] * v[i]
    half = 0.5 * scale * dot
    for i in range(start, 6):
        p[i] -= half * v[i]
    for i in range(start, 6):
        for j in range(start, 6):
            m[i, j] -= v[i] * p[j] + p[i] * v[j]


@njit(error_model="numpy")
def _pivots(t, alpha, beta2):
    """Return det(I - itM) = p_0 and 1 / D_0 = p_1 / p_0, each as real and imaginary part."""
    t2 = t * t
    re = 1.0
    im = -t * alpha[5]
    last_re = 1.0
    last_im = 0.0
    for k in range(4, -1, -1):
        turn = t * alpha[k]
        coupling = t2 * beta2[k + 1]
        next_re = re + turn * im + coupling * last_re
        next_im = im - turn * re + coupling * last_im
        last_re = re
        last_im = im
        re = next_re
        im = next_im
    scale = 1.0 / (re * re + im * im)
    return re, im, (last_re * re + last_im * im) * scale, (last_im * re - last_re * im) * scale


@njit(error_model="numpy")
def _square_root(re, im, near_re, near_im):
    """Return the square root of re + i im that lies on the side of near_re + i near_im."""
    size = math.sqrt(re * re + im * im)
    # the larger part first: the other one as a difference would cancel
    if re > 0.0:
        root_re = math.sqrt(0.5 * (size + re))
        root_im = 0.5 * im / root_re
    else:
        root_im = math.copysign(math.sqrt(0.5 * (size - re)), im)
        root_re = 0.5 * im / root_im
    if root_re * near_re + root_im * near_im < 0.0:
        return -root_re, -root_im
    return root_re, root_im


@njit(error_model="numpy")
def _tails(alpha, beta2, b_norm2, noise):
    """Return the mean of x and how far from it x may lie, but for a probability of about 1e-6."""
    (width_x, width_y, normal) = noise
    mean = 0.0
    quadratic = 0.0
    for k in range(6):
        mean += 0.5 * alpha[k]
        quadratic += 0.5 * alpha[k] * alpha[k] + beta2[k]
    variance = quadratic + b_norm2 + (width_x * width_x + width_y * width_y) / 6.0 + normal
    # A quadratic form of one normal has a much heavier tail than a normal of the same variance.
    return mean, (7.0 + 9.0 * quadratic / variance) * math.sqrt(variance)


@njit(error_model="numpy")
def _interval_probability(alpha, beta2, b_norm2, noise, low, high):
    """Return P(low <= x <= high) for x = quadratic form in normals + noise.

    The noise is two triangular variables of given widths, and a normal one of given variance.
    """
    mean, reach = _tails(alpha, beta2, b_norm2, noise)
    width_x, width_y, normal = noise
    if mean - low > reach and high - mean > reach:
        return 1.0
    if low - mean > reach or mean - high > reach:
        return 0.0
    # what lies outside one period, 2 pi / step, is the error of the nodes: it holds both tails
    step = 2.0 * math.pi / (max(mean - low, high - mean) + reach)
    centre = 0.5 * (low + high)
    half = 0.5 * (high - low)
    total = 0.0
    root_re = 1.0
    root_im = 0.0
    for k in range(_MAX_NODES):
        t = (k + 0.5) * step
        det_re, det_im, inv_re, inv_im = _pivots(t, alpha, beta2)
        # The argument of the determinant turns by less than 1.4 from node to node (step against the variance), so the
        # branch of its root is the one next to the last node's.
        root_re, root_im = _square_root(det_re, det_im, root_re, root_im)
        size2 = root_re * root_re + root_im * root_im
        decay = 0.5 * t * t * b_norm2
        modulus = math.exp(-decay * inv_re - 0.5 * t * t * normal)
        ax = 0.5 * t * width_x
        ay = 0.5 * t * width_y
        if modulus < _TAIL * (k + 0.5) * math.sqrt(size2) * max(1.0, ax * ax) * max(1.0, ay * ay):
            break
        if ax > 1e-4:
            modulus *= (math.sin(ax) / ax) ** 2
        if ay > 1e-4:
            modulus *= (math.sin(ay) / ay) ** 2
        angle = -decay * inv_im - t * centre
        real = (root_re * math.cos(angle) + root_im * math.sin(angle)) / size2
        total += modulus * math.sin(t * half) * real / (k + 0.5)
    return min(1.0, max(0.0, 2.0 / math.pi * total))


def quadratic_probability(
    gradient: NDArray[np.float64],
    hessian: NDArray[np.float64],
    root: NDArray[np.float64],
    noise: NDArray[np.float64],
    limits: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return P(low <= g.delta + 1/2 delta'H delta + noise <= high).

    Parameters
    ----------
    gradient, hessian : array (n, 6), (n, 6, 6)
        Of the error in the displacement.
    root : array (6, 6) or (n, 6, 6)
        S with S S' the covariance of the displacement; one for all or one each.
    noise : array (n, 3)
        Widths of two triangular variables, and variance of a normal one.
    limits : array (n, 2)
        Low and high.

    Returns
    -------
    array (n,)
        Probabilities in [0, 1].
    """
    out = np.empty(len(gradient))
    roots = np.ascontiguousarray(root if root.ndim == 3 else root[None])
    _quadratic_loop(gradient, hessian, roots, noise, limits, out)
    return out


@njit(error_model="numpy")
def _quadratic_loop(gradient, hessian, root, noise, limits, out):
    b = np.empty(6)
    alpha = np.empty(6)
    beta2 = np.zeros(6)
    m = np.empty((6, 6))
    work = np.empty((3, 6))
    shared = len(root) == 1
    for i in range(len(gradient)):
        _whiten(gradient[i], hessian[i], root[0] if shared else root[i], b, m, work)
        b_norm2 = _tridiagonalise(b, m, alpha, beta2, work)
        if b_norm2 == 0.0 and not noise[i].any() and not alpha.any():
            out[i] = 1.0 if limits[i, 0] <= 0.0 <= limits[i, 1] else 0.0
            continue
        parts = noise[i, 0], noise[i, 1], noise[i, 2]
        out[i] = _interval_probability(alpha, beta2, b_norm2, parts, limits[i, 0], limits[i, 1])


# The same probability asked for again and again: parameters checked once, no edge an error.


# The one call: probability that an edge is measured within the required accuracy.


Model = Literal["joint", "independent", "montecarlo"]
MODELS = get_args(Model)

# Edges handled at a time: bounds the memory of whatever a model needs per edge.
_CHUNK = {"joint": 1 << 16, "independent": 1 << 9}


def success_probability(
    endpoints: ArrayLike,
    *,
    focal_length_mm: float,
    pixel_pitch_mm: ArrayLike,
    pose_covariance: ArrayLike,
    accuracy: float,
    model: Model = "joint",
    samples: int = 100_000,
    rng: int | np.random.Generator = 0,
) -> NDArray[np.float64] | np.float64:
    """Return the probability that the image length of an edge is measured to the required accuracy.

    It is P(|epsilon| <= (1 - A) L). L is the nominal image length, and epsilon the error of the
    measured one. The error combines displacement of the camera and quantization of both ends.

    Guarantee: the result of every edge depends on that edge (and its covariance) alone, not on the
    rest of the batch ("independent": up to 1e-7). "joint" agrees with "montecarlo" to 0.002 for
    rotations of up to 0.03 rad s.d. and to 0.004 up to 0.055 rad. The memory beyond the result and
    one bool per coordinate is bounded for every batch size.

    A single bad edge is an error for the whole batch, so remove edges without an image first.

    Parameters
    ----------
    endpoints : array-like, shape (..., 2, 3)
        Edge ends in mm, in the paper's camera frame: C1 right, C2 up, C3 backwards, image plane at 0, lens centre at f.
    focal_length_mm : float
        Distance from image plane to lens centre, in mm: the image distance of a thin lens focused at a distance.
    pixel_pitch_mm : array-like, shape (2,)
        Pixel pitch (r_x, r_y) in mm.
    pose_covariance : array-like, shape (6, 6) or (..., 6, 6)
        Covariance of the displacement (dx, dy, dz, phi_x, phi_y, phi_z) in mm and rad, in the camera frame, phi a
        rotation vector about the frame's origin. Leading dimensions broadcast against those of `endpoints`.
    accuracy : float
        A in (0, 1); 0.98 allows an error of 2 % of the length.
    model : {"joint", "independent", "montecarlo"}
        "joint": both ends moved by one displaced pose, second order (see `errors.model`). "independent": the paper's
        eqs 10-15, which take the ends' displacements as independent. "montecarlo": exact rotation, random poses.
    samples : int
        Number of draws of model "montecarlo"; see `simulate_success` for its interval.
    rng : int or numpy.random.Generator
        Seed or source of chance of model "montecarlo".

    Returns
    -------
    array, shape (...)
        Probabilities in [0, 1]; a numpy scalar for a single edge.

    Raises
    ------
    InvalidShapeError
        If an array does not have the documented shape.
    CovarianceError
        If the covariance is not symmetric or not positive semi-definite.
    BehindLensError
        If an end point has C3 >= focal_length_mm.
    DegenerateSegmentError
        If an edge is seen end-on, so that its image has no length.
    InvalidParameterError
        If accuracy is outside (0, 1), a length is not positive, a value is not finite or the model is unknown. All of
        the above inherit from it.

    Examples
    --------
    An edge of 50 mm, 600 mm in front of the lens, and one half as long:

    >>> import numpy as np
    >>> from errors import success_probability
    >>> edges = [[[-25, 0, -575], [25, 0, -575]], [[-12.5, 0, -575], [12.5, 0, -575]]]
    >>> covariance = np.diag([0.05**2] * 3 + [0.001**2] * 3)
    >>> request = {"focal_length_mm": 25.0, "pixel_pitch_mm": (0.01, 0.01), "pose_covariance": covariance}
    >>> p = success_probability(edges, accuracy=0.995, **request)
    >>> p.round(2).tolist()
    [1.0, 0.77]
    """
    if model not in MODELS:
        raise InvalidParameterError.of_rule("model", f"must be one of {MODELS}", repr(model))
    f = check_positive(focal_length_mm, "focal_length_mm")
    endpoints = check_endpoints(endpoints, f)
    pitch = check_pixel_pitch(pixel_pitch_mm)
    covariance = check_covariance(pose_covariance)
    accuracy = check_probability(accuracy, "accuracy")
    lead = check_leading_shapes(endpoints, covariance)
    if model == "montecarlo":
        estimate = simulate_success(
            endpoints,
            focal_length_mm=f,
            pixel_pitch_mm=pitch,
            pose_covariance=covariance,
            accuracy=accuracy,
            samples=samples,
            rng=rng,
        )
        return estimate.probability[()]
    out = np.empty(lead)
    solve: Callable[..., FloatArray]
    if model == "joint":
        solve = joint_probability
        spread = covariance_root(covariance)
    else:
        solve = independent_probability
        spread = covariance
    for ends, part_spread, part in _chunks(endpoints, spread, out, _CHUNK[model]):
        part[:] = solve(ends, f, pitch, part_spread, accuracy)
    return out[()]


def _chunks(
    endpoints: FloatArray, spread: FloatArray, out: FloatArray, size: int
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """Yield flat pieces (ends, covariance or its root, view of out); a single covariance is passed on unrepeated."""
    flat_out = out.reshape(-1)
    if spread.ndim == 2 and endpoints.shape[:-2] == out.shape:
        flat_ends = endpoints.reshape(-1, 2, 3)
        for start in range(0, len(flat_out), size):
            yield flat_ends[start : start + size], spread[None], flat_out[start : start + size]
        return
    ends = np.broadcast_to(endpoints, (*out.shape, 2, 3))
    spreads = np.broadcast_to(spread, (*out.shape, 6, 6))
    for start in range(0, len(flat_out), size):
        index = np.unravel_index(np.arange(start, min(start + size, len(flat_out))), out.shape)
        yield ends[index], spreads[index], flat_out[start : start + size]


class SuccessModel:
    """A version of `success_probability` for many small calls with the same parameters.

    Guarantee: the values are those of `success_probability`. They are 0 for an edge without an
    image, with an end behind the lens or seen end-on. The ends themselves are not checked.

    Parameters
    ----------
    focal_length_mm : float
        Distance from the image plane to the lens centre, in mm.
    pixel_pitch_mm : array-like, shape (2,)
        Pixel pitch (r_x, r_y) in mm.
    pose_covariance : array-like, shape (6, 6)
        Covariance of (dx, dy, dz, phi_x, phi_y, phi_z) in mm and rad; one for all edges, see `success_probability`.
    accuracy : float
        A in (0, 1). The permitted error is the fraction 1 - A of the length.
    model : {"joint", "independent", "montecarlo"}
        How to compute the probability; see `success_probability`.

    Raises
    ------
    InvalidParameterError
        As `success_probability`; a covariance of another shape raises its kind `InvalidShapeError`.

    Examples
    --------
    >>> import numpy as np
    >>> from errors import SuccessModel
    >>> covariance = np.diag([0.01, 0.01, 0.01, 1e-6, 1e-6, 1e-6])
    >>> model = SuccessModel(
    ...     focal_length_mm=10.0,
    ...     pixel_pitch_mm=(0.005, 0.005),
    ...     pose_covariance=covariance,
    ...     accuracy=0.98,
    ... )
    >>> square_on, end_on = model(np.array([[[-20, 0, -90], [20, 0, -90]], [[0, 0, -90], [0, 0, -50]]]))
    >>> bool(square_on > 0.99), float(end_on)
    (True, 0.0)
    """

    def __init__(
        self,
        *,
        focal_length_mm: float,
        pixel_pitch_mm: ArrayLike,
        pose_covariance: ArrayLike,
        accuracy: float,
        model: Model = "joint",
    ) -> None:
        if model not in MODELS:
            raise InvalidParameterError.of_rule("model", f"must be one of {MODELS}", repr(model))
        self.focal_length_mm = check_positive(focal_length_mm, "focal_length_mm")
        self.pixel_pitch_mm = check_pixel_pitch(pixel_pitch_mm)
        self.covariance = check_covariance(pose_covariance)
        if self.covariance.shape != (6, 6):
            raise InvalidShapeError.of_rule(
                "pose_covariance", "must have shape (6, 6)", f"shape {self.covariance.shape}"
            )
        self.accuracy = check_probability(accuracy, "accuracy")
        self.model = model
        self._root = covariance_root(self.covariance)[None]

    def __call__(
        self, endpoints: NDArray[np.float64], root: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """Return the probability that each edge is measured to the required accuracy.

        Parameters
        ----------
        endpoints : array, shape (..., 2, 3)
            Edge ends in the paper's camera frame, in mm.
        root : array, shape (n, 6, 6), optional
            S with S S' the covariance of each edge's own displacement. Only of the model "joint".
            Default: the covariance of all.

        Returns
        -------
        array, shape (...)
            Probabilities in [0, 1]; 0 for an edge without an image.
        """
        flat = np.asarray(endpoints, dtype=np.float64).reshape(-1, 2, 3)
        shape = endpoints.shape[:-2]
        if self.model == "joint":
            return self._joint(flat, self._root if root is None else root).reshape(shape)
        return self._of_imaged(flat).reshape(shape)

    def _joint(self, flat: NDArray[np.float64], root: NDArray[np.float64]) -> NDArray[np.float64]:
        return joint_probability(
            flat, self.focal_length_mm, self.pixel_pitch_mm, root, self.accuracy
        )

    def _of_imaged(self, flat: NDArray[np.float64]) -> NDArray[np.float64]:
        probability = np.zeros(len(flat))
        imaged = has_image(flat, self.focal_length_mm)
        if imaged.any():
            probability[imaged] = success_probability(
                flat[imaged],
                focal_length_mm=self.focal_length_mm,
                pixel_pitch_mm=self.pixel_pitch_mm,
                pose_covariance=self.covariance,
                accuracy=self.accuracy,
                model=self.model,
            )
        return probability
