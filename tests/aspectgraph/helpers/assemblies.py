"""STEP files of assemblies: one part with a semantic dimension, placed as often and as deep as a test asks.

The part is the plate of `dim_two_instances.step`: holes of diameter 12 at (20, 20) and (60, 20), z from 0 to 12. The
dimension belongs to the first one. Placements are 4 x 4 matrices; their products say where the hole must be.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

CASES = Path(__file__).parents[2] / "cases"
RADIUS_MM = 6.0
HOLE = np.array([[20.0, 20.0, 0.0, 1.0], [20.0, 20.0, 12.0, 1.0]])
"""The centres of its two rims in the part's frame, homogeneous, shape (2, 4)."""

_PART_SHAPE = 30
_PART_DEFINITION = 31
_PART_REPRESENTATION = 36
_ORIGIN = 11
_CONTEXT = 535
_STATEMENT = re.compile(r"#(\d+) = (.*?);\s*(?=#\d+ = |ENDSEC)", re.DOTALL)
_ASSEMBLY = {3, 4, 5, 10, *range(15, 23), *range(23, 28), *range(540, 545), *range(546, 551)}


def placement(origin, z=(0, 0, 1), x=(1, 0, 0)) -> np.ndarray:
    """Return the matrix of an AXIS2_PLACEMENT_3D, shape (4, 4), for orthogonal z and x."""
    matrix = np.eye(4)
    matrix[:3, 2] = np.array(z) / np.linalg.norm(z)
    matrix[:3, 0] = np.array(x) / np.linalg.norm(x)
    matrix[:3, 1] = np.cross(matrix[:3, 2], matrix[:3, 0])
    matrix[:3, 3] = origin
    return matrix


def mirrored(origin) -> np.ndarray:
    """Return the matrix that mirrors x and then moves, shape (4, 4)."""
    matrix = np.diag([-1.0, 1.0, 1.0, 1.0])
    matrix[:3, 3] = origin
    return matrix


def step_assembly(tree: dict[str, list[tuple[str, np.ndarray]]]) -> str:
    """Return a STEP file.

    Parameters
    ----------
    tree : dict
        For each assembly its children and their matrices; the child "plate" is the part. The first one is the root.
    """
    text = (CASES / "dim_two_instances.step").read_text()
    head, data = text.split("DATA;\n")
    kept = [
        f"#{number} = {body};"
        for number, body in _STATEMENT.findall(data)
        if int(number) not in _ASSEMBLY
    ]
    writer = _Writer(kept)
    definitions = {"plate": (_PART_DEFINITION, _PART_REPRESENTATION)}
    for name in tree:
        definitions[name] = writer.product(name)
    for name, children in tree.items():
        for child, matrix in children:
            writer.place(definitions[child], definitions[name], matrix)
    return head + "DATA;\n" + "\n".join(writer.lines) + "\nENDSEC;\nEND-ISO-10303-21;\n"


class _Writer:
    def __init__(self, lines: list[str]):
        self.lines = lines
        self.number = 2000

    def add(self, body: str) -> int:
        self.number += 1
        self.lines.append(f"#{self.number} = {body};")
        return self.number

    def product(self, name: str) -> tuple[int, int]:
        """Write an assembly; return the numbers of its definition and of its representation."""
        context = self.add("PRODUCT_CONTEXT('',#2,'mechanical')")
        product = self.add(f"PRODUCT('{name}','{name}','',(#{context}))")
        formation = self.add(f"PRODUCT_DEFINITION_FORMATION('','',#{product})")
        definition = self.add(f"PRODUCT_DEFINITION('design','',#{formation},#35)")
        shape = self.add(f"PRODUCT_DEFINITION_SHAPE('','',#{definition})")
        representation = self.add(f"SHAPE_REPRESENTATION('',(#{_ORIGIN}),#{_CONTEXT})")
        self.add(f"SHAPE_DEFINITION_REPRESENTATION(#{shape},#{representation})")
        return definition, representation

    def place(self, child: tuple[int, int], parent: tuple[int, int], matrix: np.ndarray) -> None:
        """Write an occurrence of a child in its parent."""
        operator = self._transformation(matrix)
        relation = self.add(
            f"( REPRESENTATION_RELATIONSHIP('','',#{child[1]},#{parent[1]}) "
            f"REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION(#{operator}) "
            "SHAPE_REPRESENTATION_RELATIONSHIP() )"
        )
        occurrence = self.add(
            f"NEXT_ASSEMBLY_USAGE_OCCURRENCE('{self.number}','','',#{parent[0]},#{child[0]},$)"
        )
        shape = self.add(f"PRODUCT_DEFINITION_SHAPE('Placement','',#{occurrence})")
        self.add(f"CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#{relation},#{shape})")

    def _transformation(self, matrix: np.ndarray) -> int:
        x, y, z, origin = matrix[:3].T
        if np.linalg.det(matrix[:3, :3]) > 0.0:
            axis = self._placement(origin, z, x)
            return self.add(f"ITEM_DEFINED_TRANSFORMATION('','',#{_ORIGIN},#{axis})")
        point = self.add(f"CARTESIAN_POINT('',{_numbers(origin)})")
        axes = [self.add(f"DIRECTION('',{_numbers(axis)})") for axis in (x, y, z)]
        return self.add(
            f"CARTESIAN_TRANSFORMATION_OPERATOR_3D('','','',#{axes[0]},#{axes[1]},#{point},1.,#{axes[2]})"
        )

    def _placement(self, origin: np.ndarray, z: np.ndarray, x: np.ndarray) -> int:
        point = self.add(f"CARTESIAN_POINT('',{_numbers(origin)})")
        axis = self.add(f"DIRECTION('',{_numbers(z)})")
        reference = self.add(f"DIRECTION('',{_numbers(x)})")
        return self.add(f"AXIS2_PLACEMENT_3D('',#{point},#{axis},#{reference})")


def _numbers(values: np.ndarray) -> str:
    return "(" + ",".join(f"{value:.12f}" for value in values) + ")"
