"""A second program that measures dimensions from displaced poses; it shares no code with what it judges.

Frames and symbols
------------------
x_cam = R x + t      planned pose, world to camera (OpenCV: x right, y down, z forward)
displacement         the real camera stands at the planned one times (exp(phi), d): x_real = exp(phi)' (x_cam - d)
image                f (x / z, y / z), mm on the sensor; found there with an error of its own per axis

Found points are carried back along rays of the *planned* camera to a plane of the part; lines are fitted there by
squares of distances across them (principal axis), circles by squares of distances from them. Values are computed from
points and directions in space. Geometry comes as plain tuples: ("line", p, q) or ("circle", centre, axis, radius,
start,
span), start None for a whole circle.
"""

import math

import numpy as np
from scipy.stats import norm, qmc

from ground.decorators import njit

POINTS = 16


def look_at(eye, target, roll):
    """Return a pose world to camera (4, 4) at a place, towards a target, turned about the optical axis."""
    z = np.asarray(target, float) - eye
    z /= np.linalg.norm(z)
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    x = math.cos(roll) * x + math.sin(roll) * np.cross(z, x)
    pose = np.eye(4)
    pose[:3, :3] = np.array([x, np.cross(z, x), z])
    pose[:3, 3] = -pose[:3, :3] @ eye
    return pose


def random_view(rng, *, normal=(0.0, 0.0, 1.0), most_tilt=math.pi / 3):
    """Return a pose that looks at the origin's surroundings from 200 to 450 mm, tilted against a normal."""
    normal = np.asarray(normal, float)
    side = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    side /= np.linalg.norm(side)
    tilt = rng.uniform(0, most_tilt)
    turn = rng.uniform(0, 2 * math.pi)
    way = math.cos(turn) * side + math.sin(turn) * np.cross(normal, side)
    eye = rng.uniform(200, 450) * (math.cos(tilt) * normal + math.sin(tilt) * way)
    return look_at(eye, rng.uniform(-10, 10, 3), rng.uniform(0, 2 * math.pi))


def displacements(covariance, n, seed):
    """Return n displacements (n, 6), evenly spread: scrambled Sobol points through the normal's inverse."""
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    even = qmc.Sobol(6, seed=seed).random(n)
    return norm.ppf(np.clip(even, 1e-12, 1 - 1e-12)) @ root.T


def plane_of(kind, geometry, direction, index):
    """Return a point and two unit vectors that span the plane an entity is carried back to; x along a line."""
    one = geometry[index]
    if one[0] == "circle":
        _, centre, axis, _, start, _ = one
        x = np.cross(axis, [0.3, -0.5, 0.81]) if start is None else np.asarray(start, float)
        x = x / np.linalg.norm(x)
        return np.asarray(centre, float), x, np.cross(axis, x)
    p, q = (np.asarray(end, float) for end in one[1:])
    x = (q - p) / np.linalg.norm(q - p)
    if kind == "angle":
        other = geometry[1 - index]
        inside = np.subtract(other[2], other[1])
    elif kind == "distance":
        inside = _way(geometry, direction)
    else:  # the edge of a centre_to_edge: across the rim's axis
        inside = np.cross(geometry[0][2], x)
    y = inside - (inside @ x) * x
    return (p + q) / 2, x, y / np.linalg.norm(y)


def _way(geometry, direction):
    """Direction of the distance of two parallel lines, from the first to the second; unit."""
    (_, p, q), (_, r, s) = geometry
    p, q, r, s = (np.asarray(end, float) for end in (p, q, r, s))
    along = (q - p) / np.linalg.norm(q - p)
    apart = (r + s - p - q) / 2
    way = apart if direction is None else np.asarray(direction, float)
    way = way - (way @ along) * along
    return way / np.linalg.norm(way) * (1.0 if way @ apart > 0 else -1.0)


def points_of(one, n):
    """Return n points (n, 3) at the middles of equal parts of an entity."""
    share = (np.arange(n) + 0.5)[:, None] / n
    if one[0] == "line":
        return np.asarray(one[1], float) * (1 - share) + np.asarray(one[2], float) * share
    _, centre, axis, radius, start, span = one
    x = np.cross(axis, [0.3, -0.5, 0.81]) if start is None else np.asarray(start, float)
    x = x / np.linalg.norm(x)
    angle = share * span
    return np.asarray(centre, float) + radius * (
        np.cos(angle) * x + np.sin(angle) * np.cross(axis, x)
    )


def measure(
    kind,
    geometry,
    pose,
    moves,
    *,
    f,
    sigma_mm=(0.0, 0.0),
    rng=None,
    direction=None,
    points=POINTS,
    pixel=None,
    pitch=None,
    common=None,
):
    """Return errors (n,) of a value measured from displaced poses; nan where a point is behind the camera.

    sigma_mm is the error of a found point per axis on the sensor; with ``pixel`` (2,) every point is put on a grid
    of that
    pitch instead, which with ``rng`` lies anywhere in every draw (of a length: at each end). ``points`` is their
    number on every entity, or on each. Angles are in degrees.

    ``common`` holds errors that all points of an entity share, (k,) or one row per draw (n, k): ``floor_px`` across its
    image, in pixels of the ``pitch``; ``surfaces_mm`` along its plane's normal, whose largest component is positive.
    A length has instead ``ends_px`` (2,) along its image at each end, and ``places`` (2,) across the edge; or (n, 2).
    """
    common = common or {}
    if kind == "length":
        return _length_errors(geometry[0], pose, moves, f, sigma_mm, rng, pixel, pitch, common)
    fits = []
    shared = {
        name: np.atleast_2d(common.get(name, np.zeros(len(geometry))))
        for name in ("floor_px", "surfaces_mm")
    }
    for index, one in enumerate(geometry):
        plane = np.array(plane_of(kind, geometry, direction, index))
        at = points_of(one, points if isinstance(points, int) else points[index])
        noise = _noise(len(moves), len(at), sigma_mm, rng)
        out = np.empty((len(moves), 3))
        local = np.array([plane[0] @ pose[:3, :3].T + pose[:3, 3], *(plane[1:] @ pose[:3, :3].T)])
        grid = np.zeros(2) if pixel is None else np.asarray(pixel, float)
        phase = (
            np.zeros((1, 2)) if pixel is None or rng is None else rng.random((len(moves), 2)) * grid
        )
        radius = one[3] if one[0] == "circle" else 0.0
        normal = np.cross(plane[1], plane[2])
        normal = normal * np.sign(normal[np.argmax(np.abs(normal))]) @ pose[:3, :3].T
        shares = (
            np.ascontiguousarray(shared["floor_px"][:, index]),
            np.ascontiguousarray(shared["surfaces_mm"][:, index]),
            normal,
            _ahead(one, at) @ pose[:3, :3].T + pose[:3, 3],
            np.asarray(pitch or (1.0, 1.0), float),
        )
        _fit_all(
            at @ pose[:3, :3].T + pose[:3, 3],
            local,
            moves,
            noise,
            (f, radius, grid, phase),
            shares,
            out,
        )
        fits.append((plane, out))
    return _value(kind, geometry, fits, direction) - _nominal(kind, geometry, direction)


def _ahead(one, at):
    """Return points (m, 3) a little farther along an entity than given ones."""
    if one[0] == "line":
        return at + 1e-4 * np.subtract(one[2], one[1])
    _, centre, axis, _, _, _ = one
    return at + 1e-4 * np.cross(axis, at - np.asarray(centre, float))


def _noise(n, m, sigma_mm, rng):
    if rng is None or not any(sigma_mm):
        return np.zeros((1, m, 2))
    return rng.standard_normal((n, m, 2)) * sigma_mm


def _length_errors(one, pose, moves, f, sigma_mm, rng, pixel, pitch, common):
    ends = np.array([one[1], one[2]], float) @ pose[:3, :3].T + pose[:3, 3]
    planned = f * ends[:, :2] / ends[:, 2:]
    along = ends[1] - ends[0]
    first = np.cross(along, [0.3, -0.5, 0.81])
    second = np.cross(along, first)
    off = np.atleast_2d(common.get("places", (0.0, 0.0)))
    basis = np.array([first / np.linalg.norm(first), second / np.linalg.norm(second)])
    # a camera that stands off by the opposite sees the same
    moves = moves - np.hstack([off @ basis, np.zeros((len(off), 3))])
    found = (
        np.array([_images(ends, move, f) for move in moves])
        if len(moves) < 100
        else _images_of_all(ends, moves, f)
    )
    if pixel is not None:
        phase = 0.0 if rng is None else rng.random(found.shape) * pixel
        found = np.floor((found - phase) / pixel + 0.5) * pixel + phase
    found = found + _noise(len(moves), 2, sigma_mm, rng)
    if "ends_px" in common:
        way = (planned[1] - planned[0]) / pitch
        way = way / np.linalg.norm(way) * pitch
        found = found + np.asarray(common["ends_px"], float)[..., None] * way
    ratio = np.linalg.norm(found[:, 1] - found[:, 0], axis=1) / np.linalg.norm(
        planned[1] - planned[0]
    )
    return np.linalg.norm(np.subtract(one[2], one[1])) * (ratio - 1)


def _images(points, move, f):
    turn = _rotation(move[3], move[4], move[5])
    seen = (points - move[:3]) @ turn
    return f * seen[:, :2] / seen[:, 2:]


@njit(error_model="numpy")
def _rotation(x, y, z):
    """Return exp of a rotation vector, by the unit quaternion."""
    angle = math.sqrt(x * x + y * y + z * z)
    half = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    w = math.cos(0.5 * angle)
    i = half * x
    j = half * y
    k = half * z
    turn = np.empty((3, 3))
    turn[0, 0] = 1 - 2 * (j * j + k * k)
    turn[0, 1] = 2 * (i * j - k * w)
    turn[0, 2] = 2 * (i * k + j * w)
    turn[1, 0] = 2 * (i * j + k * w)
    turn[1, 1] = 1 - 2 * (i * i + k * k)
    turn[1, 2] = 2 * (j * k - i * w)
    turn[2, 0] = 2 * (i * k - j * w)
    turn[2, 1] = 2 * (j * k + i * w)
    turn[2, 2] = 1 - 2 * (i * i + j * j)
    return turn


@njit(error_model="numpy")
def _image(turn, move, p, f):
    """Return the image of a point from the displaced camera, and its depth."""
    a = p[0] - move[0]
    b = p[1] - move[1]
    c = p[2] - move[2]
    x = turn[0, 0] * a + turn[1, 0] * b + turn[2, 0] * c
    y = turn[0, 1] * a + turn[1, 1] * b + turn[2, 1] * c
    z = turn[0, 2] * a + turn[1, 2] * b + turn[2, 2] * c
    return f * x / z, f * y / z, z


@njit(error_model="numpy")
def _images_of_all(points, moves, f):
    out = np.empty((len(moves), len(points), 2))
    for i in range(len(moves)):
        turn = _rotation(moves[i, 3], moves[i, 4], moves[i, 5])
        for k in range(len(points)):
            u, v, z = _image(turn, moves[i], points[k], f)
            out[i, k, 0], out[i, k, 1] = (u, v) if z > 0 else (np.nan, np.nan)
    return out


@njit(error_model="numpy")
def _fit_all(points, plane, moves, noise, how, shares, out):
    """Write what is fitted from every displaced pose: a line's point on y and direction, or a circle's centre, radius.

    Points and plane (origin, x, y) are in the planned camera's frame.
    """
    f, radius, grid, phase = how
    floor, off, normal, ahead, pitch = shares
    n = np.cross(plane[1], plane[2])
    c = n[0] * plane[0, 0] + n[1] * plane[0, 1] + n[2] * plane[0, 2]
    flat = np.empty((len(points), 2))
    for i in range(len(moves)):
        turn = _rotation(moves[i, 3], moves[i, 4], moves[i, 5])
        good = True
        lifted = off[i % len(off)] * normal
        for k in range(len(points)):
            u, v, z = _image(turn, moves[i], points[k] + lifted, f)
            good = good and z > 0
            if floor[i % len(floor)] != 0.0:
                u_next, v_next, _ = _image(turn, moves[i], ahead[k] + lifted, f)
                x = (u_next - u) / pitch[0]
                y = (v_next - v) / pitch[1]
                far = math.sqrt(x * x + y * y)
                u -= floor[i % len(floor)] * pitch[0] * y / far
                v += floor[i % len(floor)] * pitch[1] * x / far
            if grid[0] > 0:
                shift_x, shift_y = phase[i % len(phase)]
                u = math.floor((u - shift_x) / grid[0] + 0.5) * grid[0] + shift_x
                v = math.floor((v - shift_y) / grid[1] + 0.5) * grid[1] + shift_y
            u += noise[i % len(noise), k, 0]
            v += noise[i % len(noise), k, 1]
            depth = c / (n[0] * u + n[1] * v + n[2] * f)
            good = good and depth > 0
            a = depth * u - plane[0, 0]
            b = depth * v - plane[0, 1]
            e = depth * f - plane[0, 2]
            flat[k, 0] = a * plane[1, 0] + b * plane[1, 1] + e * plane[1, 2]
            flat[k, 1] = a * plane[2, 0] + b * plane[2, 1] + e * plane[2, 2]
        if not good:
            out[i] = np.nan
        elif radius > 0:
            _fit_circle(flat, radius, out[i])
        else:
            _fit_line(flat, out[i])


@njit(error_model="numpy")
def _fit_line(flat, out):
    """Principal axis: angle in out[2], a point of the line in out[:2]."""
    mx = flat[:, 0].mean()
    my = flat[:, 1].mean()
    xx = 0.0
    xy = 0.0
    yy = 0.0
    for k in range(len(flat)):
        a = flat[k, 0] - mx
        b = flat[k, 1] - my
        xx = xx + a * a
        xy = xy + a * b
        yy = yy + b * b
    out[0] = mx
    out[1] = my
    out[2] = 0.5 * math.atan2(2 * xy, xx - yy)


@njit(error_model="numpy")
def _fit_circle(flat, radius, out):
    """Least squares of distances from a circle, by Gauss-Newton from the algebraic fit (which needs no start)."""
    mx = flat[:, 0].mean()
    my = flat[:, 1].mean()
    normal = np.zeros((3, 3))
    right = np.zeros(3)
    for k in range(len(flat)):
        a = flat[k, 0] - mx
        b = flat[k, 1] - my
        square = a * a + b * b
        normal[0, 0] += 4 * a * a
        normal[0, 1] += 4 * a * b
        normal[1, 1] += 4 * b * b
        normal[2, 2] += 1.0
        right[0] += 2 * a * square
        right[1] += 2 * b * square
        right[2] += square
    x, y, r = _solve(normal, right)
    x, y, r = mx + x, my + y, math.sqrt(r + x * x + y * y)
    for _ in range(40):
        normal[:] = 0.0
        right[:] = 0.0
        for k in range(len(flat)):
            a = flat[k, 0] - x
            b = flat[k, 1] - y
            far = math.sqrt(a * a + b * b)
            a = a / far
            b = b / far
            rest = far - r
            normal[0, 0] += a * a
            normal[0, 1] += a * b
            normal[0, 2] += a
            normal[1, 1] += b * b
            normal[1, 2] += b
            normal[2, 2] += 1.0
            right[0] += a * rest
            right[1] += b * rest
            right[2] += rest
        dx, dy, dr = _solve(normal, right)
        x = x + dx
        y = y + dy
        r = r + dr
        if abs(dx) + abs(dy) + abs(dr) < 1e-10 * radius:
            break
    out[0] = x
    out[1] = y
    out[2] = r


@njit(error_model="numpy")
def _solve(m, b):
    """Solve a symmetric system of three equations by its upper triangle (Cramer)."""
    a00 = m[0, 0]
    a01 = m[0, 1]
    a02 = m[0, 2]
    a11 = m[1, 1]
    a12 = m[1, 2]
    a22 = m[2, 2]
    c00 = a11 * a22 - a12 * a12
    c01 = a02 * a12 - a01 * a22
    c02 = a01 * a12 - a02 * a11
    c11 = a00 * a22 - a02 * a02
    c12 = a01 * a02 - a00 * a12
    c22 = a00 * a11 - a01 * a01
    det = a00 * c00 + a01 * c01 + a02 * c02
    return (
        (c00 * b[0] + c01 * b[1] + c02 * b[2]) / det,
        (c01 * b[0] + c11 * b[1] + c12 * b[2]) / det,
        (c02 * b[0] + c12 * b[1] + c22 * b[2]) / det,
    )


def _lift(plane, x, y):
    """Return points in space (n, 3) by coordinates in a plane."""
    return plane[0] + x[:, None] * plane[1] + y[:, None] * plane[2]


def _line_in_space(fit):
    plane, found = fit
    along = np.cos(found[:, 2:]) * plane[1] + np.sin(found[:, 2:]) * plane[2]
    return _lift(plane, found[:, 0], found[:, 1]), along


def _value(kind, geometry, fits, direction):
    """Return values (n,) of fitted lines and circles, in space."""
    if kind in ("diameter", "radius"):
        return fits[0][1][:, 2] * (2 if kind == "diameter" else 1)
    if kind == "centre_distance":
        axis = np.asarray(geometry[0][2], float)
        first, second = (_lift(plane, found[:, 0], found[:, 1]) for plane, found in fits)
        apart = second - first
        apart = apart - (apart @ axis)[:, None] * axis
        if direction is None:
            return np.linalg.norm(apart, axis=1)
        way = np.asarray(direction, float) - (np.asarray(direction, float) @ axis) * axis
        way = way / np.linalg.norm(way) * np.sign(way @ np.subtract(geometry[1][1], geometry[0][1]))
        return apart @ way
    if kind == "centre_to_edge":
        axis = np.asarray(geometry[0][2], float)
        centre = _lift(fits[0][0], fits[0][1][:, 0], fits[0][1][:, 1])
        on, along = _line_in_space(fits[1])
        across = np.cross(axis, along)
        return np.abs(np.einsum("ni,ni->n", centre - on, across)) / np.linalg.norm(across, axis=1)
    (on, along), (other, turned) = map(_line_in_space, fits)
    if kind == "angle":
        cosine = np.einsum("ni,ni->n", along, turned)
        # the obtuse angle of two edges is reported as its supplement, as at the nominal pose
        flip = -1.0 if np.subtract(*geometry[0][1:]) @ np.subtract(*geometry[1][1:]) < 0 else 1.0
        return np.degrees(np.arccos(np.clip(flip * cosine, -1, 1)))
    (_, p, q), (_, r, s) = geometry
    station = np.add(np.add(p, q), np.add(r, s)) / 4
    straight = np.subtract(q, p) / np.linalg.norm(np.subtract(q, p))
    turned = turned * np.sign(np.einsum("ni,ni->n", along, turned))[:, None]
    first, second = (
        a + (((station - a) @ straight) / (b @ straight))[:, None] * b
        for a, b in ((on, along), (other, turned))
    )
    if direction is not None:
        return (second - first) @ _way(geometry, direction)
    # without a direction: across the mean direction of both lines
    mean = along + turned
    mean = mean / np.linalg.norm(mean, axis=1, keepdims=True)
    apart = second - first
    return np.linalg.norm(apart - np.einsum("ni,ni->n", apart, mean)[:, None] * mean, axis=1)


def _nominal(kind, geometry, direction):
    """Return the value of the part's own lines and circles."""
    fits = []
    for index, one in enumerate(geometry):
        plane = np.array(plane_of(kind, geometry, direction, index))
        fits.append((plane, np.array([[0.0, 0.0, one[3] if one[0] == "circle" else 0.0]])))
    return float(_value(kind, geometry, fits, direction)[0])
