"""Exact signs: the only geometric decisions the cell complex makes.

Notation
--------
plane h = (a, b, c, d)
    int64, the set a·x + b·y + c·z = d; positive side a·x + b·y + c·z > d.
vertex v = (X, Y, Z, W)
    homogeneous 256-bit integers with W > 0, the common point X/W, Y/W, Z/W of three planes, stored as four 64-bit
    limbs each (least significant first, two's complement).
point p = (x, y, z) with the common denominator 2**POINT_BITS
    int64, a query viewpoint on a lattice 2**POINT_BITS times finer than the grid of the part.

Guarantee: with |a|, |b|, |c| < 2**43 and |d| < 2**63 no intermediate exceeds 2**200, so every sign is exact. Numbers
are decided by a floating-point filter with a proven error bound first, and by 256-bit integers where that fails.
"""

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from ground.decorators import kernel_without_refcounts

POINT_BITS = 20
LIMBS = 4

# a·x + b·y + c·z - d in doubles: 4 rounded coefficients, 3 coordinates of relative error < 4 ulp, 3 products, 3 sums;
# the sum of magnitudes times 16 units in the last place bounds them all
_FILTER = 16 * np.finfo(np.float64).eps

_WIDE = ir.IntType(64 * LIMBS)


def _element(context, builder, signature, args, array, indices):
    """Pointer to array[indices...], for int64 arrays in C order."""
    array_type = signature.args[array]
    struct = context.make_array(array_type)(context, builder, args[array])
    return cgutils.get_item_pointer(context, builder, array_type, struct, indices, wraparound=False)


def _load_plane(context, builder, signature, args, array, row):
    """Coefficients of one plane, sign-extended."""
    coefficients = []
    for column in range(4):
        pointer = _element(
            context, builder, signature, args, array, [row, ir.Constant(ir.IntType(64), column)]
        )
        coefficients.append(builder.sext(builder.load(pointer), _WIDE))
    return coefficients


def _wide_pointer(context, builder, signature, args, array, row, column):
    zero = ir.Constant(ir.IntType(64), 0)
    pointer = _element(
        context, builder, signature, args, array, [row, ir.Constant(ir.IntType(64), column), zero]
    )
    return builder.bitcast(pointer, _WIDE.as_pointer())


def _det2(builder, a, b, c, d):
    return builder.sub(builder.mul(a, d), builder.mul(b, c))


def _det3(builder, rows):
    (a, b, c), (d, e, f), (g, h, i) = rows
    terms = [
        builder.mul(a, _det2(builder, e, f, h, i)),
        builder.mul(b, _det2(builder, d, f, g, i)),
        builder.mul(c, _det2(builder, d, e, g, h)),
    ]
    return builder.add(builder.sub(terms[0], terms[1]), terms[2])


def _sign(builder, value):
    zero = ir.Constant(_WIDE, 0)
    byte = ir.IntType(64)
    positive = builder.zext(builder.icmp_signed(">", value, zero), byte)
    negative = builder.zext(builder.icmp_signed("<", value, zero), byte)
    return builder.sub(positive, negative)


@intrinsic
def _meet(typingctx, planes, p, q, r, vertices, v):
    """Write the common point of planes p, q, r to vertices[v] (Cramer's rule); return the sign of the determinant."""
    signature = types.int64(planes, types.int64, types.int64, types.int64, vertices, types.int64)

    def codegen(context, builder, signature, args):
        rows = [_load_plane(context, builder, signature, args, 0, args[k]) for k in (1, 2, 3)]
        w = _det3(builder, [row[:3] for row in rows])
        zero = ir.Constant(_WIDE, 0)
        negative = builder.icmp_signed("<", w, zero)
        for column in range(4):
            if column == 3:
                value = w
            else:
                replaced = [[row[3] if k == column else row[k] for k in range(3)] for row in rows]
                value = _det3(builder, replaced)
            # W > 0 by convention
            value = builder.select(negative, builder.sub(zero, value), value)
            pointer = _wide_pointer(context, builder, signature, args, 4, args[5], column)
            builder.store(value, pointer, align=8)
        return _sign(builder, w)

    return signature, codegen


@intrinsic
def _sign_at_vertex_exact(typingctx, planes, h, vertices, v):
    """Sign of plane h at vertices[v]."""
    signature = types.int64(planes, types.int64, vertices, types.int64)

    def codegen(context, builder, signature, args):
        plane = _load_plane(context, builder, signature, args, 0, args[1])
        total = ir.Constant(_WIDE, 0)
        for column in range(4):
            pointer = _wide_pointer(context, builder, signature, args, 2, args[3], column)
            product = builder.mul(plane[column], builder.load(pointer, align=8))
            total = builder.sub(total, product) if column == 3 else builder.add(total, product)
        return _sign(builder, total)

    return signature, codegen


@intrinsic
def _sign_at_point_exact(typingctx, planes, h, x, y, z):
    """Sign of plane h at the point (x, y, z) / 2**POINT_BITS."""
    signature = types.int64(planes, types.int64, types.int64, types.int64, types.int64)

    def codegen(context, builder, signature, args):
        a, b, c, d = _load_plane(context, builder, signature, args, 0, args[1])
        total = builder.sub(ir.Constant(_WIDE, 0), builder.shl(d, ir.Constant(_WIDE, POINT_BITS)))
        for coefficient, coordinate in zip((a, b, c), args[2:5], strict=True):
            total = builder.add(total, builder.mul(coefficient, builder.sext(coordinate, _WIDE)))
        return _sign(builder, total)

    return signature, codegen


@kernel_without_refcounts
def _magnitude(limbs):
    """Double nearest to a 256-bit integer, to a relative error below 4 ulp."""
    negative = limbs[LIMBS - 1] < 0
    total = 0.0
    scale = 1.0
    carry = np.uint64(1)
    for k in range(LIMBS):
        limb = np.uint64(limbs[k])
        if negative:
            # two's complement: all bits turned, plus one that carries
            limb = ~limb + carry
            carry = (
                np.uint64(1) if (carry == np.uint64(1) and limb == np.uint64(0)) else np.uint64(0)
            )
        total += np.float64(limb) * scale
        scale *= 18446744073709551616.0
    return -total if negative else total


@kernel_without_refcounts
def meet(planes, p, q, r, vertices, coordinates, v):
    """Write the common point of three planes as vertex v, exactly and in doubles; False where they have none."""
    if _meet(planes, p, q, r, vertices, v) == 0:
        return False
    w = _magnitude(vertices[v, 3])
    for k in range(3):
        coordinates[v, k] = _magnitude(vertices[v, k]) / w
    return True


@kernel_without_refcounts
def sign_at_vertex(planes, h, vertices, coordinates, v):
    """Sign (-1, 0, 1) of plane h at vertex v."""
    x = planes[h, 0] * coordinates[v, 0]
    y = planes[h, 1] * coordinates[v, 1]
    z = planes[h, 2] * coordinates[v, 2]
    d = np.float64(planes[h, 3])
    value = x + y + z - d
    bound = (abs(x) + abs(y) + abs(z) + abs(d)) * _FILTER
    if value > bound:
        return 1
    if value < -bound:
        return -1
    return _sign_at_vertex_exact(planes, h, vertices, v)


@kernel_without_refcounts
def sign_at_point(planes, h, point):
    """Sign (-1, 0, 1) of plane h at an int64 point of denominator 2**POINT_BITS."""
    scale = 1.0 / (1 << POINT_BITS)
    x = planes[h, 0] * (point[0] * scale)
    y = planes[h, 1] * (point[1] * scale)
    z = planes[h, 2] * (point[2] * scale)
    d = np.float64(planes[h, 3])
    value = x + y + z - d
    bound = (abs(x) + abs(y) + abs(z) + abs(d)) * _FILTER
    if value > bound:
        return 1
    if value < -bound:
        return -1
    return _sign_at_point_exact(planes, h, point[0], point[1], point[2])
