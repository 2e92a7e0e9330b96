"""The figures of ISO 286-1:2010: standard tolerances and fundamental deviations, in µm.

A row belongs to one range of nominal sizes: over the limit of the row before, up to and including its own.
Source: ISO 286-1:2010, Tables 1 to 5, as catalogues and textbooks repeat them. The tests compare them with such tables
and with the formulas of the standard.
"""

from __future__ import annotations

from collections.abc import Mapping

GRADES = ("01", "0", *(str(grade) for grade in range(1, 19)))
"""Standard tolerance grades, in the order of `TOLERANCES_UM`."""

TOLERANCE_LIMITS_MM = (3, 6, 10, 18, 30, 50, 80, 120, 180, 250, 315, 400, 500)
LARGE_TOLERANCE_LIMITS_MM = (630, 800, 1000, 1250, 1600, 2000, 2500, 3150)


def _rows(text: str) -> tuple[tuple[float | None, ...], ...]:
    """Return the rows of a table; a dash is None."""
    return tuple(
        tuple(None if word == "-" else float(word) for word in line.split())
        for line in text.strip().splitlines()
    )


# one row per range of TOLERANCE_LIMITS_MM and LARGE_TOLERANCE_LIMITS_MM, one column per grade
TOLERANCES_UM = _rows("""
0.3 0.5 0.8 1.2 2 3 4 6 10 14 25 40 60 100 140 250 400 600 1000 1400
0.4 0.6 1 1.5 2.5 4 5 8 12 18 30 48 75 120 180 300 480 750 1200 1800
0.4 0.6 1 1.5 2.5 4 6 9 15 22 36 58 90 150 220 360 580 900 1500 2200
0.5 0.8 1.2 2 3 5 8 11 18 27 43 70 110 180 270 430 700 1100 1800 2700
0.6 1 1.5 2.5 4 6 9 13 21 33 52 84 130 210 330 520 840 1300 2100 3300
0.6 1 1.5 2.5 4 7 11 16 25 39 62 100 160 250 390 620 1000 1600 2500 3900
0.8 1.2 2 3 5 8 13 19 30 46 74 120 190 300 460 740 1200 1900 3000 4600
1 1.5 2.5 4 6 10 15 22 35 54 87 140 220 350 540 870 1400 2200 3500 5400
1.2 2 3.5 5 8 12 18 25 40 63 100 160 250 400 630 1000 1600 2500 4000 6300
2 3 4.5 7 10 14 20 29 46 72 115 185 290 460 720 1150 1850 2900 4600 7200
2.5 4 6 8 12 16 23 32 52 81 130 210 320 520 810 1300 2100 3200 5200 8100
3 5 7 9 13 18 25 36 57 89 140 230 360 570 890 1400 2300 3600 5700 8900
4 6 8 10 15 20 27 40 63 97 155 250 400 630 970 1550 2500 4000 6300 9700
- - 9 11 16 22 32 44 70 110 175 280 440 700 1100 1750 2800 4400 7000 11000
- - 10 13 18 25 36 50 80 125 200 320 500 800 1250 2000 3200 5000 8000 12500
- - 11 15 21 28 40 56 90 140 230 360 560 900 1400 2300 3600 5600 9000 14000
- - 13 18 24 33 47 66 105 165 260 420 660 1050 1650 2600 4200 6600 10500 16500
- - 15 21 29 39 55 78 125 195 310 500 780 1250 1950 3100 5000 7800 12500 19500
- - 18 25 35 46 65 92 150 230 370 600 920 1500 2300 3700 6000 9200 15000 23000
- - 22 30 41 55 78 110 175 280 440 700 1100 1750 2800 4400 7000 11000 17500 28000
- - 26 36 50 68 96 135 210 330 540 860 1350 2100 3300 5400 8600 13500 21000 33000
""")

_LIMITS_MM = (
    3, 6, 10, 14, 18, 24, 30, 40, 50, 65, 80, 100, 120, 140, 160, 180, 200, 225, 250, 280, 315, 355,
    400, 450, 500,
)  # fmt: skip
_LARGE_LIMITS_MM = (
    560, 630, 710, 800, 900, 1000, 1120, 1250, 1400, 1600, 1800, 2000, 2240, 2500, 2800, 3150,
)  # fmt: skip

# distances of the tolerance interval from the nominal size: of shafts a to g the upper limit lies below it
_ABOVE_UM = """
a b c cd d e ef f fg g
270 140 60 34 20 14 10 6 4 2
270 140 70 46 30 20 14 10 6 4
280 150 80 56 40 25 18 13 8 5
290 150 95 - 50 32 - 16 - 6
290 150 95 - 50 32 - 16 - 6
300 160 110 - 65 40 - 20 - 7
300 160 110 - 65 40 - 20 - 7
310 170 120 - 80 50 - 25 - 9
320 180 130 - 80 50 - 25 - 9
340 190 140 - 100 60 - 30 - 10
360 200 150 - 100 60 - 30 - 10
380 220 170 - 120 72 - 36 - 12
410 240 180 - 120 72 - 36 - 12
460 260 200 - 145 85 - 43 - 14
520 280 210 - 145 85 - 43 - 14
580 310 230 - 145 85 - 43 - 14
660 340 240 - 170 100 - 50 - 15
740 380 260 - 170 100 - 50 - 15
820 420 280 - 170 100 - 50 - 15
920 480 300 - 190 110 - 56 - 17
1050 540 330 - 190 110 - 56 - 17
1200 600 360 - 210 125 - 62 - 18
1350 680 400 - 210 125 - 62 - 18
1500 760 440 - 230 135 - 68 - 20
1650 840 480 - 230 135 - 68 - 20
"""

# of shafts k to zc the lower limit lies above it; k of IT4 to IT7
_BELOW_UM = """
k m n p r s t u v x y z za zb zc
0 2 4 6 10 14 - 18 - 20 - 26 32 40 60
1 4 8 12 15 19 - 23 - 28 - 35 42 50 80
1 6 10 15 19 23 - 28 - 34 - 42 52 67 97
1 7 12 18 23 28 - 33 - 40 - 50 64 90 130
1 7 12 18 23 28 - 33 39 45 - 60 77 108 150
2 8 15 22 28 35 - 41 47 54 63 73 98 136 188
2 8 15 22 28 35 41 48 55 64 75 88 118 160 218
2 9 17 26 34 43 48 60 68 80 94 112 148 200 274
2 9 17 26 34 43 54 70 81 97 114 136 180 242 325
2 11 20 32 41 53 66 87 102 122 144 172 226 300 405
2 11 20 32 43 59 75 102 120 146 174 210 274 360 480
3 13 23 37 51 71 91 124 146 178 214 258 335 445 585
3 13 23 37 54 79 104 144 172 210 254 310 400 525 690
3 15 27 43 63 92 122 170 202 248 300 365 470 620 800
3 15 27 43 65 100 134 190 228 280 340 415 535 700 900
3 15 27 43 68 108 146 210 252 310 380 465 600 780 1000
4 17 31 50 77 122 166 236 284 350 425 520 670 880 1150
4 17 31 50 80 130 180 258 310 385 470 575 740 960 1250
4 17 31 50 84 140 196 284 340 425 520 640 820 1050 1350
4 20 34 56 94 158 218 315 385 475 580 710 920 1200 1550
4 20 34 56 98 170 240 350 425 525 650 790 1000 1300 1700
4 21 37 62 108 190 268 390 475 590 730 900 1150 1500 1900
4 21 37 62 114 208 294 435 530 660 820 1000 1300 1650 2100
5 23 40 68 126 232 330 490 595 740 920 1100 1450 1850 2400
5 23 40 68 132 252 360 540 660 820 1000 1250 1600 2100 2600
"""

_LARGE_UM = """
d e f g k m n p r s t u
260 145 76 22 0 26 44 78 150 280 400 600
260 145 76 22 0 26 44 78 155 310 450 660
290 160 80 24 0 30 50 88 175 340 500 740
290 160 80 24 0 30 50 88 185 380 560 840
320 170 86 26 0 34 56 100 210 430 620 940
320 170 86 26 0 34 56 100 220 470 680 1050
350 195 98 28 0 40 66 120 250 520 780 1150
350 195 98 28 0 40 66 120 260 580 840 1300
390 220 110 30 0 48 78 140 300 640 960 1450
390 220 110 30 0 48 78 140 330 720 1050 1600
430 240 120 32 0 58 92 170 370 820 1200 1850
430 240 120 32 0 58 92 170 400 920 1350 2000
480 260 130 34 0 68 110 195 440 1000 1500 2300
480 260 130 34 0 68 110 195 460 1100 1650 2500
520 290 145 38 0 76 135 240 550 1250 1900 2900
520 290 145 38 0 76 135 240 580 1400 2100 3200
"""

# one row per range of TOLERANCE_LIMITS_MM: lower limits of shafts j5 and j6, j7, j8; upper limits of holes J6, J7, J8
_J_UM = """
j5 j6 j7 j8 J6 J7 J8
-2 -2 -4 -6 2 4 6
-2 -2 -4 - 5 6 10
-2 -2 -5 - 5 8 12
-3 -3 -6 - 6 10 15
-4 -4 -8 - 8 12 20
-5 -5 -10 - 10 14 24
-7 -7 -12 - 13 18 28
-9 -9 -15 - 16 22 34
-11 -11 -18 - 18 26 41
-13 -13 -21 - 22 30 47
-16 -16 -26 - 25 36 55
-18 -18 -28 - 29 39 60
-20 -20 -32 - 33 43 66
"""


def _columns(text: str) -> dict[str, tuple[float | None, ...]]:
    """Return the columns of a table by their names in its first line."""
    names, rows = text.strip().split("\n", 1)
    return dict(zip(names.split(), zip(*_rows(rows), strict=True), strict=True))


def _by_size(*tables: tuple[tuple[int, ...], str]) -> dict[str, dict[int, float]]:
    """Return the values of each letter by the upper limit of the range, mm; blanks are left out."""
    found: dict[str, dict[int, float]] = {}
    for limits, text in tables:
        for letter, column in _columns(text).items():
            rows = zip(limits, column, strict=True)
            values = {limit: value for limit, value in rows if value is not None}
            found.setdefault(letter, {}).update(values)
    return found


DEVIATION_LIMITS_MM = (*_LIMITS_MM, *_LARGE_LIMITS_MM)
"""Upper limits of the ranges of nominal sizes for fundamental deviations, in mm."""

DEVIATIONS_UM: Mapping[str, Mapping[int, float]] = _by_size(
    (_LIMITS_MM, _ABOVE_UM), (_LIMITS_MM, _BELOW_UM), (_LARGE_LIMITS_MM, _LARGE_UM)
)
"""Distance of a shaft's tolerance interval from the nominal size, in µm, by letter and range.

Those of a to g lie below the nominal size and those of k to zc above it. For k it is that of IT4 to IT7.
"""

J_UM: Mapping[str, Mapping[int, float]] = _by_size((TOLERANCE_LIMITS_MM, _J_UM))
"""Lower limit deviations of shafts j5 to j8 and upper ones of holes J6 to J8, in µm, by class and range."""
