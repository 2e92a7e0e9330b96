"""The commands about the catalogues: which cameras and lights there are. Lists load nothing that takes long."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from cyclopts import Argument

from ground.convert import to_plain
from planner.app.options import COMMANDS, Cameras, Completion, Lights, texts_of
from planner.app.parsing import arguments_of, choices_of, first_line, takes_value
from planner.app.process import DONE, INCOMPLETE
from planner.camera.camera import Camera, camera_names, camera_parts
from planner.exceptions import RequestError
from planner.files import print_json
from planner.light_catalogue import light_parts
from planner.progress import visible
from planner.text_table import Column, print_table, print_text, words


def cameras(options: Cameras) -> int:
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
    listed_cameras = [Camera.named(name) for name in camera_names()]
    if options.json:
        print_json([camera.to_dict() for camera in listed_cameras])
    else:
        _print_cameras(listed_cameras)
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


def lights(options: Lights) -> int:
    """List the catalogue of lights, or what each kind of light shows of a plan."""
    if options.plan is not None:
        return _compare(options.plan, options)
    for name in ("part", "material"):
        if getattr(options, name) is not None:
            raise RequestError(f"--{name} needs a plan.")
    # here, because it loads what takes long
    from planner.app.part import check_nothing_read

    check_nothing_read(options)
    lights_of = light_parts()
    if options.json:
        print_json(lights_of)
        return DONE
    columns = (Column("--light"), Column("size (mm)"), Column("above the part (mm)", right=True))
    rows = []
    for kind, of_kind in lights_of.items():
        for name, facts in of_kind.items():
            above = facts.get("working_mm")
            rows.append(
                (f"{kind}:{name}", _light_size(facts), "" if above is None else f"{above:g}")
            )
    print_table(columns, rows)
    for kind, of_kind in lights_of.items():
        for name, facts in of_kind.items():
            # an address is never broken
            print(f"{kind}:{name}: {visible(facts['source'] or 'a typical size, of no maker')}")
    return DONE


def _light_size(facts: Mapping[str, Any]) -> str:
    """Return the size of a light of the catalogue."""
    if "width_mm" in facts:
        return f"{facts['width_mm']:g} x {facts['height_mm']:g}"
    if "side_mm" in facts:
        return f"window of {facts['side_mm']:g}"
    if "inner_mm" in facts:
        return f"{facts['inner_mm']:g} to {facts['outer_mm']:g}"
    return f"{facts['diameter_mm']:g}, hole of {facts['hole_mm']:g}"


def _compare(path: str, options: Lights) -> int:
    """Print what each kind of light shows of a plan."""
    # here, because they load what takes long
    from planner.app.job import check_same_part
    from planner.app.part import read_part
    from planner.lights import compare_lights, sufficient
    from planner.plan import read_plan
    from planner.progress import terminal_progress

    if options.part is None:
        raise RequestError("lights PLAN needs the part of the plan. Give --part PART.")
    plan = read_plan(path)
    solid = read_part(options.part, options)
    check_same_part(solid, plan, options.part)
    with terminal_progress(quiet=options.quiet, lines=options.verbose) as progress:
        compared = compare_lights(plan, solid, options.material, progress=progress)
    if options.json:
        print_json([to_plain(item) for item in compared])
    else:
        columns = (Column("light"), Column("shows", right=True), Column("does not show"))
        rows = [
            (
                item.kind,
                f"{len(item.shown)} of {len(item.shown) + len(item.dark)}",
                ", ".join(item.dark),
            )
            for item in compared
        ]
        print_table(columns, rows)
        for item in compared:
            print_text(f"{item.kind}: {item.light}")
        print_text(sufficient(compared))
    return INCOMPLETE if compared[0].dark else DONE


# Shell completion: a script made from the parser, so that it knows every command and option.


# $2 is the word to complete, $3 the one before it; files are offered where nothing else fits
_SCRIPT = """\
_aspectgraph() {{
    local word="$2" before="$3" words=""
    case "$before" in
        --camera) words={cameras} ;;
        *) case "${{COMP_WORDS[1]}}" in
{cases}
        esac ;;
    esac
    [ "$COMP_CWORD" -eq 1 ] && words={commands}
    COMPREPLY=()
    if [[ "$word" == -* || "$COMP_CWORD" -eq 1 || "$before" == --camera ]]; then
        COMPREPLY=($(compgen -W "$words" -- "$word"))
    fi
    [ ${{#COMPREPLY[@]}} -eq 0 ] && COMPREPLY=($(compgen -f -- "$word"))
}}
complete -o filenames -F _aspectgraph aspectgraph
"""
_FISH = """\
function __aspectgraph_needs_command
    test (count (commandline -opc)) -eq 1
end
function __aspectgraph_in
    set -l words (commandline -opc)
    test (count $words) -gt 1; and test $words[2] = $argv[1]
end
"""
_ZSH = "autoload -U +X bashcompinit && bashcompinit\n"


def completion(options: Completion) -> int:
    """Print the script for a shell."""
    print(completion_script(camera_names(), options.shell), end="")
    return DONE


def completion_script(cameras: Sequence[str], shell: str) -> str:
    """Return a script that teaches a shell the commands, their options and the cameras.

    Parameters
    ----------
    cameras : sequence of str
        Names for ``--camera``.
    shell : {"bash", "zsh", "fish"}
        The shell.

    Returns
    -------
    str
        To be evaluated when the shell starts.
    """
    if shell == "fish":
        return _fish_script(cameras)
    cases = [
        f"            {command}) words={_words(_names(arguments_of(kind)))} ;;"
        for command, kind in COMMANDS.items()
    ]
    script = _SCRIPT.format(
        cameras=_words(cameras), commands=_words(COMMANDS), cases="\n".join(cases)
    )
    return (_ZSH if shell == "zsh" else "") + script


def _names(arguments: Iterable[Argument]) -> list[str]:
    """Return what options are typed as."""
    return [name for argument in arguments for name in argument.names if name.startswith("-")]


def _fish_script(cameras: Sequence[str]) -> str:
    """Return the script for fish: a line per command and option, with its help."""
    lines = []
    for command, kind in COMMANDS.items():
        lines.append(
            f"complete -c aspectgraph -f -n __aspectgraph_needs_command -a {command} "
            f"-d {_fish_text(first_line(kind))}"
        )
        texts = texts_of(kind)
        for argument in arguments_of(kind):
            text = texts[argument.field_info.name]
            lines.append(_fish_line(command, argument, text, cameras))
    return _FISH + "\n".join(filter(None, lines)) + "\n"


def _fish_line(command: str, argument: Argument, text: str, cameras: Sequence[str]) -> str:
    """Return the line of an option, or of the words that an argument may be."""
    start = f"complete -c aspectgraph -n '__aspectgraph_in {command}'"
    words = cameras if argument.name == "--camera" else choices_of(argument)
    offer = f" -a {_fish_text(' '.join(words))}" if words else ""
    names = _names([argument])
    if not names:
        return f"{start} -f{offer}" if offer else ""
    flags = "".join(
        f" -l {name[2:]}" if name.startswith("--") else f" -s {name[1:]}" for name in names
    )
    # -r: it takes a value, a file unless words are offered
    value = " -r" if takes_value(argument) else ""
    return f"{start}{flags}{value}{offer} -d {_fish_text(text)}"


def _fish_text(text: str) -> str:
    """Return a text in quotes of fish, in which only these two signs are special."""
    quoted = text.replace("\\", "\\\\").replace("'", "\\'")
    return f"'{quoted}'"


def _words(names: Iterable[str]) -> str:
    return shlex.quote(" ".join(names))
