"""The 256-bit instructions of the exact signs in Python's own integers: they stand in where nothing is compiled."""

from aspectgraph.exact import grid as predicates

_BITS = 64
_ALL = predicates.LIMBS * _BITS


def limbs(value):
    """Split an integer into 64-bit limbs, least significant first, two's complement."""
    whole = value % (1 << _ALL)
    parts = [(whole >> (_BITS * k)) % (1 << _BITS) for k in range(predicates.LIMBS)]
    return [part - (1 << _BITS) if part >> (_BITS - 1) else part for part in parts]


def value_of(parts):
    """Integer of these limbs."""
    whole = sum((int(part) % (1 << _BITS)) << (_BITS * k) for k, part in enumerate(parts))
    return whole - (1 << _ALL) if whole >> (_ALL - 1) else whole


def sign(x):
    return (x > 0) - (x < 0)


def determinant(rows):
    (a, b, c), (d, e, f), (g, h, i) = rows
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)


def _meet(planes, p, q, r, vertices, v):
    rows = [[int(x) for x in planes[k]] for k in (p, q, r)]
    w = determinant([row[:3] for row in rows])
    replaced = [
        [[row[3] if k == column else row[k] for k in range(3)] for row in rows]
        for column in range(3)
    ]
    for column, value in enumerate([*map(determinant, replaced), w]):
        vertices[v, column] = limbs(-value if w < 0 else value)
    return sign(w)


def _sign_at_vertex_exact(planes, h, vertices, v):
    x, y, z, w = map(value_of, vertices[v])
    a, b, c, d = map(int, planes[h])
    return sign(a * x + b * y + c * z - d * w)


def _sign_at_point_exact(planes, h, x, y, z):
    a, b, c, d = map(int, planes[h])
    return sign(a * int(x) + b * int(y) + c * int(z) - (d << predicates.POINT_BITS))


def stand_in():
    """Let the exact signs use Python's integers; only for loops that are not compiled."""
    for one in (_meet, _sign_at_vertex_exact, _sign_at_point_exact):
        setattr(predicates, one.__name__, one)
