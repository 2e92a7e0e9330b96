"""The command about the catalogue: which cameras there are. It loads nothing that takes long."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from typing import Any

from planner.camera.camera import Camera
from planner.camera.catalogue import camera_names, camera_parts
from planner.cli.process.exit_codes import DONE
from planner.progress.terminal_text import visible
from planner.progress.text_table import Column, print_table, print_text, words
from planner.records.json_file import print_json


def cameras(options: argparse.Namespace) -> int:
    """List the catalogue: its cameras, or where the facts on their parts were read."""
    if options.sources:
        parts = camera_parts()
        if options.json:
            # JSON knows no infinity: an iris that closes fully has no narrowest aperture
            print_json(
                {
                    kind: {name: _finite(facts) for name, facts in of.items()}
                    for kind, of in parts.items()
                }
            )
        else:
            _print_sources(parts)
        return DONE
    known = [Camera.named(name) for name in camera_names()]
    if options.json:
        print_json([camera.to_dict() for camera in known])
    else:
        _print_cameras(known)
    return DONE


def _finite(facts: Mapping[str, Any]) -> dict[str, Any]:
    return {key: None if value == math.inf else value for key, value in facts.items()}


def _print_cameras(cameras: Sequence[Camera]) -> None:
    """Print cameras: sensor, lens as it is set, and what is sharp."""
    columns = (
        Column("name"),
        Column("pixels", right=True),
        Column("pitch (um)", right=True),
        Column("f (mm)", right=True),
        Column("f/", right=True),
        Column("focus (mm)", right=True),
        Column("sharp (mm)", right=True),
        Column("field at focus (mm)", right=True),
    )
    rows = []
    for camera in cameras:
        # similar triangles: the sensor's size by how many times farther the object is than the image
        field = [
            side * camera.focus_distance_mm / camera.image_distance_mm
            for side in camera.sensor_size_mm
        ]
        row = (
            camera.name,
            f"{camera.resolution[0]} x {camera.resolution[1]}",
            " x ".join(dict.fromkeys(f"{1000 * pitch:g}" for pitch in camera.pixel_pitch_mm)),
            f"{camera.focal_length_mm:g}",
            f"{camera.f_number:g}",
            f"{camera.focus_distance_mm:g}",
            camera.depth_of_field_text,
            " x ".join(f"{side:.0f}" for side in field),
        )
        rows.append(row)
    print_table(columns, rows)
    cameras_text = "1 camera" if len(cameras) == 1 else f"{len(cameras)} cameras"
    print_text(f"{cameras_text}; distances are from the front nodal point")


def _print_sources(parts: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> None:
    """Print bodies and lenses: their facts, and where these were read."""
    for kind, facts in (("body", _body_facts), ("lens", _lens_facts)):
        for name, record in parts[kind].items():
            text = words(f"{kind} {name}: {facts(record)}", [f"{kind} {name}:"])
            print_text(text, indent="    ")
            whose = "" if record["maker"] else " (not the maker's page on it)"
            # an address is never broken
            print(f"    {visible(record['source'])}{whose}")


def _body_facts(body: Mapping[str, Any]) -> str:
    pitch = " x ".join(dict.fromkeys(f"{1000 * side:g}" for side in body["pixel_pitch_mm"]))
    return f"{body['resolution'][0]} x {body['resolution'][1]} px of {pitch} um; {body['sensor']}"


def _lens_facts(lens: Mapping[str, Any]) -> str:
    narrowest = (
        "closed" if lens["narrowest_f_number"] == math.inf else f"f/{lens['narrowest_f_number']:g}"
    )
    return (
        f"{lens['focal_length_mm']:g} mm, f/{lens['widest_f_number']:g} to {narrowest}, "
        f"from {lens['closest_object_mm']:g} mm on, image circle {lens['image_circle_mm']:g} mm"
    )
