"""What can be typed: a record for each command, of records for the groups of options that commands share.

A field is an argument or an option, its type says how it is read and which rule it must meet, and its docstring is the
help. Nothing here loads what takes long.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal, get_args, get_origin, get_type_hints

from cyclopts import Parameter

from planner.app.quantities import (
    BOX,
    DEG,
    MM,
    PX,
    SECONDS,
    SHARE,
    WHITE,
    Count,
    all_or_solids,
    break_range,
    lengths,
    material,
    memory,
    registration,
    sigma_angle,
    sigma_pair,
    solid_names,
    value,
    whole,
)
from planner.argument_kinds import (
    ABOVE_0_TO_1,
    BETWEEN_0_AND_1,
    FROM_0_BELOW_1,
    NOT_NEGATIVE,
    POSITIVE,
    POSITIVE_SECONDS,
    NumberRule,
)
from planner.executors import usable_cores


def _text(kind: Any, tokens: Any) -> str:
    """Return a text as it is, also if it is "none"; a choice must be one of its kind."""
    text: str = tokens[-1].value
    if get_origin(kind) is Literal and text not in get_args(kind):
        raise ValueError(text)
    return text


def _named(metavar: str, *names: str) -> Parameter:
    """Return how an option is read that takes a text, and what its value is in the help."""
    return Parameter(name=names or None, metavar=metavar, converter=_text)


_CORES = usable_cores()
_CONTRAST = NumberRule("must lie strictly between 0 and 1", BETWEEN_0_AND_1.holds)
# as `planner.request.camera_limits.MOST_SEED`, and `planner.light.corner_light.DEFAULT_STEP`, which take long to load
_MOST_SEED = 10**300
_GREY_STEP = 0.1

File = Annotated[str | None, _named("FILE")]
Number = Annotated[int, value(whole, "N"), Count(1)]
NumberFrom0 = Annotated[int, value(whole, "N"), Count(0)]
Jobs = Annotated[int, value(whole, "N", "--jobs", "-j"), Count(1)]
Seed = Annotated[int, value(whole, "N"), Count(0, _MOST_SEED)]
Limit = Annotated[int | None, value(whole, "N"), Count(0)]
Signal = Annotated[int, value(whole, "N")]
Length = Annotated[float, value(MM, "MM"), NOT_NEGATIVE]
OptionalLength = Annotated[float | None, value(MM, "MM"), NOT_NEGATIVE]
Pixels = Annotated[float, value(PX, "PX"), NOT_NEGATIVE]
Time = Annotated[float | None, value(SECONDS, "S"), POSITIVE_SECONDS]
Contrast = Annotated[float, value(SHARE, "C"), _CONTRAST]
Box = Annotated[BOX | None, value(MM, "X0 Y0 Z0 X1 Y1 Z1", count=6)]
BreakRange = Annotated[tuple[float, float] | None, value(break_range, "LOW..HIGH|sharp")]
SigmaPair = Annotated[tuple[float, float] | None, value(sigma_pair, "MM,RAD")]
Camera = Annotated[str, _named("NAME|FILE")]
Folder = Annotated[str, _named("DIR", "--out", "-o")]


@dataclass(kw_only=True)
class Command:
    """Messages.

    Attributes
    ----------
    help
        show this help and exit
    """

    # how it is called, and what the help ends with
    usage: ClassVar[tuple[str, ...]] = ()
    epilog: ClassVar[str] = ""
    # what must be given unless another option is; its type says so where that is all
    needed: ClassVar[tuple[str, ...]] = ()
    instead: ClassVar[str] = ""
    # options of which at most one, or exactly one, may be typed
    at_most_one: ClassVar[tuple[str, ...]] = ()
    exactly_one: ClassVar[tuple[str, ...]] = ()

    help: Annotated[bool, Parameter(name=("--help", "-h"))] = False
    # options that were typed, by their long names, and when; a time limit counts from there
    typed: frozenset[str] = field(init=False, default=frozenset())
    begun: float = field(init=False, default=0.0)

    @classmethod
    def name(cls) -> str:
        """Return the word that is typed."""
        return cls.__name__.lower()


@dataclass(kw_only=True)
class Messages(Command):
    """Messages.

    Attributes
    ----------
    json
        print records for other programs instead of tables; mm and degrees where no unit is named
    quiet
        show no progress
    verbose
        show progress as lines that stay, and the origin of an error
    """

    at_most_one: ClassVar[tuple[str, ...]] = ("--quiet", "--verbose")

    json: bool = False
    quiet: Annotated[bool, Parameter(name=("--quiet", "-q"))] = False
    verbose: Annotated[bool, Parameter(name=("--verbose", "-v"))] = False


@dataclass(kw_only=True)
class Units:
    """Reading the part.

    Attributes
    ----------
    units
        unit of a mesh: mm, cm, m, um, inch or ft (default: mm, m for .glb)
    """

    units: Annotated[str | None, _named("UNIT")] = None


@dataclass(kw_only=True)
class PartReading(Units, Messages):
    """Reading the part.

    Attributes
    ----------
    solids
        solids of a STEP file to measure, by number or name, as 'info --list' lists them (default: all); a name with
        commas, or of digits, stands in double quotes: '"12"'
    occluders
        solids that only block the view, likewise; all: those that --solids does not name
    gap_mm
        widest gap between the edges and faces of a STEP file
    read_time_limit
        end the reading of a STEP file after this many seconds (default: 300)
    """

    solids: Annotated[Any, value(solid_names, "N|NAME,...")] = None
    occluders: Annotated[Any, value(all_or_solids, "all|N|NAME,...")] = None
    gap_mm: Annotated[float | None, value(MM, "MM")] = None
    read_time_limit: Time = None


@dataclass(kw_only=True)
class PartFile(PartReading):
    """Reading the part.

    Attributes
    ----------
    part
        .step .stp .stl .obj .ply .off .glb
    """

    part: str = field(kw_only=False)


@dataclass(kw_only=True)
class ChosenEntities:
    """What to measure, by one of the first options.

    Attributes
    ----------
    entities
        TOML, JSON or CSV file; ids like 3,17-21,r2; end points like '(0,0,10)-(25,0,10)'; or all. A plan measures an
        edge's length, a rim's diameter and an arc's radius
    select
        conditions joined by 'and': length > 20, radius > 5, diameter = 12 (within 0.01 mm), turn < 100, convex,
        reentrant, kind = rim, direction = z, face = top (bottom, left, right, front, back: of the part's box), near
        10,20,30 < 5. Without kind, radius or diameter, only edges are selected
    all
        all sharp straight edges
    """

    exactly_one: ClassVar[tuple[str, ...]] = ("--entities", "--select", "--all")

    entities: Annotated[str | None, _named("FILE|IDS|all")] = None
    select: Annotated[str | None, _named("RULE")] = None
    all: bool = False

    def __post_init__(self) -> None:
        if self.all:
            self.entities = "all"


@dataclass(kw_only=True)
class DimensionTargets(Command):
    """What to measure, by one of the first options.

    Attributes
    ----------
    dimensions
        TOML or JSON file of dimensions with tolerances, or all that the part (AP242) states
    one_per_pattern
        with --dimensions all: measure each dimension on one of its features only, such as one hole of a pattern
        (default: on each)
    reference_dimensions
        with --dimensions all: plan reference dimensions, too, which the model gives for information only (default: they
        are listed as not planned)
    no_basic_dimensions
        with --dimensions all: leave out basic dimensions, which are theoretically exact and have no tolerance (default:
        they are planned to --accuracy)
    no_positions
        with --dimensions all: leave out positions, symmetry and coaxiality, whose datums must be in the same image
        (default: they are planned where edges show their datums)
    share
        share of a tolerance's half width that is permitted as error of measurement
    localisation
        error of points in the image: rounding, gaussian[:SIGMA[:FLOOR]] or fit[:SIGMA[:CORRELATION[:FLOOR]]], in px;
        FLOOR does not average out (default: rounding with --entities, --select and --all, gaussian:0.1:0.05 with
        --dimensions, gaussian:0.1:0.01 if --edges is stated, too)
    surfaces_mm
        standard deviation of the position of the part's faces along their normals, for dimensions (default: what
        flatness and profile tolerances of the part state, otherwise 0.02; with rounding 0)
    edges
        by how much the part's edges are broken along their faces, such as 0.1..0.3 mm, or sharp; lengths of edges
        then are measured by edge detectors (default: planned as sharp)
    """

    dimensions: Annotated[str | None, _named("FILE|all")] = None
    one_per_pattern: bool = False
    reference_dimensions: bool = False
    no_basic_dimensions: bool = False
    no_positions: bool = False
    share: Annotated[float, value(SHARE, "S"), ABOVE_0_TO_1] = 0.25
    localisation: Annotated[str | None, _named("MODEL")] = None
    surfaces_mm: OptionalLength = None
    edges: BreakRange = None


@dataclass(kw_only=True)
class ChosenTargets(DimensionTargets, ChosenEntities):
    """What to measure, by one of the first options."""

    exactly_one: ClassVar[tuple[str, ...]] = (*ChosenEntities.exactly_one, "--dimensions")


@dataclass(kw_only=True)
class Promise:
    """Camera and requirement.

    Attributes
    ----------
    accuracy
        98% permits an error of 2% of an edge's length, a rim's diameter or an arc's radius
    probability
        required P_all of each target: the displaced camera has it in the picture, in focus, unhidden and apart from
        other lines, and the error is at most the permitted one
    sigma_mm
        standard deviation of the camera's position
    sigma_rad
        standard deviation of the camera's orientation, in rad or like 0.1deg
    """

    accuracy: Annotated[float, value(SHARE, "A"), BETWEEN_0_AND_1] = 0.98
    probability: Annotated[float, value(SHARE, "P"), BETWEEN_0_AND_1] = 0.9
    sigma_mm: Length = 0.2
    sigma_rad: Annotated[float, value(sigma_angle, "RAD"), NOT_NEGATIVE] = 0.002


@dataclass(kw_only=True)
class WithCamera:
    """Camera and requirement.

    Attributes
    ----------
    camera
        a name that 'aspectgraph cameras' lists, or a TOML file, which may name a calibration of OpenCV, ROS or others
    """

    camera: Camera


@dataclass(kw_only=True)
class Limits:
    """Limits of every setting, which plan.json and the report list.

    Attributes
    ----------
    stand_off
        smallest distance of the camera from the part
    min_length_px
        shortest image of an edge that is measured
    field_margin_px
        strip along the sensor's sides that stays free (default: four standard deviations of the image's motion)
    focus_margin_mm
        distance from both ends of the depth of field (default: for each end of an edge three standard deviations of its
        depth, at most an eighth of the depth of field but at least 1.645 of them)
    visibility_radius_mm
        edges stay visible up to this distance around the camera (default: three standard deviations)
    give_up
        move each setting away from its limits, as long as no probability falls by more than this; 0 does not move it
        (default: 0.001)
    """

    stand_off: Length = 50.0
    min_length_px: Pixels = 20.0
    field_margin_px: Annotated[float | None, value(PX, "PX"), NOT_NEGATIVE] = None
    focus_margin_mm: OptionalLength = None
    visibility_radius_mm: OptionalLength = None
    give_up: Annotated[float | None, value(SHARE, "SHARE"), FROM_0_BELOW_1] = None


@dataclass(kw_only=True)
class Workspace:
    """Limits of every setting, which plan.json and the report list.

    Attributes
    ----------
    workspace
        opposite corners of the box the camera may be in, mm (default: as far around the part as the lens focuses)
    """

    workspace: Box = None


@dataclass(kw_only=True)
class Showing:
    """Conditions for finding edges and dimensions in the image; 0 switches one off.

    Attributes
    ----------
    separation_px
        distance from an edge, or a fitted line or circle, to the next visible line
    surround_px
        distance from the ends of an edge to the border of the image
    min_corner_deg
        angle at which another line leaves each end of an edge
    """

    separation_px: Pixels = 5.0
    surround_px: Pixels = 40.0
    min_corner_deg: Annotated[float, value(DEG, "DEG"), NOT_NEGATIVE] = 25.0


@dataclass(kw_only=True)
class SearchEffort:
    """Search.

    Attributes
    ----------
    effort
        how long to search and to prove (default: standard)
    time_limit
        end after this many seconds with the best plan so far, like 90, 5min or 1h; a few dimensions need some ten
        seconds, a hundred edges a minute or more (default: no limit)
    gap
        end the search when at most this share of the settings is unproven, like 20%
    split
        auto: two settings may measure the ends of a distance or angle, or a hole and its datums, where that inspects
        more or saves a setting; never: one image shows all (default: auto)
    seed
        same seed, same plan
    simulate
        unless it is 0, check the plan with this many displaced poses per setting
    jobs
        processes to use, at most one per core
    """

    effort: Annotated[Literal["quick", "standard", "thorough"] | None, _named("")] = None
    time_limit: Time = None
    gap: Annotated[float, value(SHARE, "G"), FROM_0_BELOW_1] = 0.0
    split: Literal["auto", "never"] = "auto"
    seed: Seed = 0
    simulate: NumberFrom0 = 10_000
    jobs: Jobs = _CORES


@dataclass(kw_only=True)
class ImageRegistration:
    """Registration of images.

    Attributes
    ----------
    registration
        how the camera's pose is known when values are read. edges: aspectgraph measure registers each image to the
        part's own edges; none: it is the planned pose; a length and an angle: standard deviations of a pose that
        something else measures, like 0.02mm,0.1mrad (default: the planned pose, and lamps under which aspectgraph
        measure can register images)
    """

    registration: Annotated[Any, value(registration, "edges|none|MM,RAD", "--register")] = None


@dataclass(kw_only=True)
class GivenPoses:
    """Poses that exist.

    Attributes
    ----------
    poses
        file of camera poses: a plan, views of OpenCV (rvec, tvec), poses of ROS (optical frame, z forward), a program
        of 'aspectgraph program' with --cell, or CSV with x y z and qx qy qz qw; in the part's frame
    pose_units
        unit of lengths in the file of --poses: mm, cm, m, um, in or ft (default: what the file states; ROS: m)
    """

    poses: File = None
    pose_units: Annotated[
        Literal["mm", "cm", "m", "um", "in", "inch", "ft"] | None, _named("UNIT")
    ] = None


@dataclass(kw_only=True)
class Light:
    """Lamps that make the edges of a matt part visible.

    Attributes
    ----------
    light
        backlight, which the part lies on; diffuse-dome, coaxial or ring-light, which the camera carries; each alone or
        with :NAME of the catalogue (aspectgraph lights); backlight:X,Y,Z,WIDTH,HEIGHT, a bright rectangle that shines
        upwards; ring (a lamp on the camera); positions for lamps in box:X0,Y0,Z0,X1,Y1,Z1 or on
        dome:X,Y,Z,RADIUS[,LOWEST]; fixed lamps at:X,Y,Z[;X,Y,Z...] or a TOML file with lamps = [[X, Y, Z], ...]; in
        mm (default: no lamps)
    material
        how the part reflects light: matt, or metal with a roughness from 0.02 (nearly a mirror) to 1; 0.3 is milled
        or blasted (default: matt)
    contrast
        least contrast of an edge, (I1 - I2) / (I1 + I2)
    grey_step
        least difference of grey values across an edge, as a share of a face that is lit frontally
    ground
        background behind the part; bright: a back light
    together
        switch all lamps on in every image, and use as few as possible (default: one by one)
    """

    light: Annotated[str | None, _named("LAMPS")] = None
    material: Annotated[Any, value(material, "matt|metal[:ROUGHNESS]")] = None
    contrast: Contrast = 0.1
    grey_step: Annotated[float, value(SHARE, "STEP")] = _GREY_STEP
    ground: Literal["dark", "bright"] = "dark"
    together: bool = False


@dataclass(kw_only=True)
class PlanOutput:
    """Output.

    Attributes
    ----------
    out
        folder to write to; the command refuses to replace a plan of another request
    force
        replace a plan of another request, and other files, in DIR
    resume
        continue an interrupted plan from its state in DIR
    again
        plan the request of a plan.json, or of its folder, again without its options; give PART, too, if the part was
        moved
    graph_limit
        write graph.graphml, the joint graph, for up to this many entities (default: 24; more if it is small)
    explain
        also print what P and P_all mean, and what is assumed of points in the image and of faces
    operator
        who plans, for plan.json and the report
    """

    out: Folder = "plan"
    force: bool = False
    resume: bool = False
    again: Annotated[str | None, _named("PLAN")] = None
    graph_limit: Limit = None
    explain: bool = False
    operator: Annotated[str | None, _named("TEXT")] = None


@dataclass(kw_only=True)
class ForCell(Workspace):
    """Limits of every setting, which plan.json and the report list.

    Attributes
    ----------
    cell
        TOML file of a robot cell: the robot must reach every setting, and a light of the cell is the plan's
        (default: no robot)
    """

    cell: File = None


@dataclass(kw_only=True)
class PlannedPoses(GivenPoses):
    """Poses that exist.

    Attributes
    ----------
    poses
        choose the fewest of the camera poses in this file, as 'aspectgraph predict' reads it (default: search poses)
    """


@dataclass(kw_only=True)
class Plan(
    ChosenTargets,
    Promise,
    WithCamera,
    PlanOutput,
    SearchEffort,
    Limits,
    ForCell,
    Showing,
    ImageRegistration,
    Light,
    PlannedPoses,
    PartFile,
):
    """Plan the inspection and write plan, graph, report and poses."""

    usage = (
        "PART --entities FILE|IDS   --camera NAME|FILE [options]",
        "PART --select RULE         --camera NAME|FILE [options]",
        "PART --dimensions FILE|all --camera NAME|FILE [options]",
    )
    needed = ("PART", "--camera")
    instead = "--again"

    # the request of a plan that is made again holds both
    part: Any = field(default=None, kw_only=False)
    camera: Annotated[Any, _named("NAME|FILE")] = None


@dataclass(kw_only=True)
class Info(PartFile):
    """List edges, rims and arcs of a part with their ids.

    Attributes
    ----------
    picture
        draw the edges with their ids: .png, which needs the extra .[plot], or .html, which needs none, to pick edges
        from and save them for --entities or --dimensions
    select
        list only edges, rims and arcs for which the rule holds; see plan --help (default: all)
    min_length
        leave out shorter edges
    list
        only list the solids of a STEP file with their names, without reading their shape
    """

    usage = ("PART [options]",)
    epilog = """\
columns:
  turn     angle by which the surface turns over an edge: positive where it is
           convex, negative where it is re-entrant
  ends     corner: another sharp edge leaves; a3: the edge ends in this
           tangent arc, so its length is undefined
  chords   straight edges that stand for a circle
  off by   largest distance of the chords from that circle"""

    picture: File = None
    select: Annotated[str | None, _named("RULE")] = None
    min_length: Length = 0.0
    list: bool = False


@dataclass(kw_only=True)
class Dimensions(PartFile):
    """List the dimensions of an AP242 file, and how to measure them."""

    usage = ("PART [options]",)


@dataclass(kw_only=True)
class Cameras(Messages):
    """List the cameras and lenses that --camera knows by name.

    Attributes
    ----------
    sources
        list camera bodies and lenses with their data sheets instead
    """

    usage = ("[options]",)

    sources: bool = False


@dataclass(kw_only=True)
class Lights(PartReading):
    """List the lights that --light knows by name, or which light suffices for a plan.

    Attributes
    ----------
    plan
        plan.json, or the folder it is in: compare the kinds of lights in its settings (default: list the catalogue)
    part
        the part of the plan; needed with PLAN
    material
        how the part reflects light: matt, or metal with a roughness from 0.02 (nearly a mirror) to 1; 0.3 is milled
        or blasted (default: matt)
    """

    usage = ("[options]", "PLAN --part PART [options]")

    plan: str | None = field(default=None, kw_only=False)
    part: Annotated[str | None, _named("PART")] = None
    material: Annotated[Any, value(material, "matt|metal[:ROUGHNESS]")] = None


@dataclass(kw_only=True)
class OpticsPromise(Promise):
    """Camera and requirement.

    Attributes
    ----------
    probability
        required P of each target: the error is at most the permitted one, if the target is found
    """


@dataclass(kw_only=True)
class Optics(ChosenTargets, OpticsPromise, Limits, Workspace, Showing, ImageRegistration, PartFile):
    """Rank camera bodies, lenses, distances and apertures by how well they measure a part.

    Attributes
    ----------
    body
        try only this camera body; give it again for more (default: all of 'cameras --sources')
    distances
        working distances to try, from the front nodal point (default: 100 to 1600 in seven steps)
    rows
        print at most this many rows
    write
        write the camera of the first row as a TOML file for plan --camera (default: not written)
    """

    usage = (
        "PART --entities FILE|IDS   [options]",
        "PART --select RULE         [options]",
        "PART --dimensions FILE|all [options]",
    )

    body: Annotated[list[str] | None, Parameter(metavar="NAME")] = None
    distances: Annotated[Any, value(lengths, "MM,MM")] = None
    rows: Number = 10
    write: File = None


@dataclass(kw_only=True)
class Predict(
    ChosenTargets,
    Promise,
    WithCamera,
    GivenPoses,
    Limits,
    Workspace,
    Showing,
    ImageRegistration,
    PartFile,
):
    """Say what each of some camera poses measures, how surely, and what none of them does.

    Attributes
    ----------
    cell
        TOML file of the robot cell of a robot program: it turns joints into poses (default: no robot)
    """

    usage = ("PART --poses FILE --camera NAME|FILE [options]",)

    poses: Annotated[str, _named("FILE")]
    cell: File = None


@dataclass(kw_only=True)
class Simulate(PartReading):
    """Check a plan by drawing displaced poses.

    Attributes
    ----------
    plan
        plan.json, or the folder it is in
    poses
        displaced poses per setting
    seed
        same seed, same poses
    part
        the part of the plan; the simulation then also counts the displaced images in which edges can be found (default:
        not counted)
    explain
        also print what P and P_all mean
    """

    usage = ("PLAN [options]",)

    plan: str = field(kw_only=False)
    poses: Number = 100_000
    seed: Seed = 0
    part: Annotated[str | None, _named("PART")] = None
    explain: bool = False


@dataclass(kw_only=True)
class InCell(PartReading):
    """Options.

    Attributes
    ----------
    plan
        plan.json, or the folder it is in
    part
        .step .stp .stl .obj .ply .off .glb
    cell
        TOML file with the robot, the hand-eye calibration, fixturings and obstacles
    """

    usage = ("PLAN PART --cell FILE [options]",)

    plan: str = field(kw_only=False)
    part: str = field(kw_only=False)
    cell: Annotated[str, _named("FILE")]


@dataclass(kw_only=True)
class Reach(InCell):
    """Say which settings of a plan a robot reaches, and where the part should lie.

    Attributes
    ----------
    place
        draw other positions of the part, and print those from which the robot reaches most
    within
        with --place: opposite corners of the box for the middle of the part, in the base of the robot, mm (default:
        before the robot, at the height of the cell file)
    table
        with --place: lay the part on each of its flat sides, on this obstacle or on posts that stand on it;
        it is a box of the cell or of its first fixturing, such as the plate of a turntable or the backlight, "light"
        (default: keep how it lies)
    post_heights
        with --table: heights of the posts, mm; 0 is the table itself (default: 0 to 300 in nine steps)
    post_width
        with --table: side of their square section, mm
    ways
        with --table: in how many ways the part may lie, one after the other: 1 or 2
    draws
        with --place: positions to try (default: 300, or 1500 with --table, there 300 on a
        turntable)
    cell_out
        with --place: write the cell with the best position, as it was evaluated; one that exists is replaced (default:
        print its fixturings only)
    seed
        same seed, same positions and other poses
    plan_out
        write the plan with other poses that inspect the same for settings that are not reached; one that exists is
        replaced (default: say only which there are)
    """

    place: bool = False
    within: Box = None
    table: Annotated[str | None, _named("NAME")] = None
    post_heights: Annotated[Any, value(lengths, "MM,MM")] = None
    post_width: Annotated[float, value(MM, "MM"), POSITIVE] = 20.0
    ways: Annotated[int, value(whole, "1|2"), Count(1, 2)] = 2
    draws: Annotated[int | None, value(whole, "N"), Count(1)] = None
    cell_out: File = None
    seed: Seed = 0
    plan_out: File = None


@dataclass(kw_only=True)
class ArmErrors:
    """Uncertainty of the arm; with one of these, the program states P for each setting.

    Attributes
    ----------
    sigma_joints
        standard deviation of each joint, like 0.1mrad (default: none)
    sigma_hand_eye
        standard deviations of the hand-eye calibration per axis, like 0.05mm,0.5mrad (default: none)
    sigma_part
        standard deviations of the part's registration about its origin, per axis (default: none)
    simulate
        unless it is 0, check P with this many displaced poses per setting
    """

    sigma_joints: Annotated[float | None, value(sigma_angle, "RAD"), NOT_NEGATIVE] = None
    sigma_hand_eye: SigmaPair = None
    sigma_part: SigmaPair = None
    simulate: NumberFrom0 = 10_000


@dataclass(kw_only=True)
class Program(ArmErrors, InCell):
    """Write a robot program that takes the images of a plan.

    Attributes
    ----------
    format
        language of the controller; ros: trajectories as JSON, json: all data (default: by the suffix of --out, urscript
        without it)
    out
        file to write; one that exists is replaced (default: inspection.script, .mod, .src, .ls, .csv,
        inspection_ros.json or program.json)
    speed
        share of the joints' largest speeds, like 0.5 or 50%
    settle
        wait before each image, s
    trigger_output
        digital output that triggers the camera
    ready_input
        digital input at which the camera says that the image is taken
    plan_out
        use other poses that inspect the same for settings that are not reached or hard to drive, and write the plan
        with these; its images must be measured with it
    seed
        same seed, same ways around obstacles
    """

    format: Literal["urscript", "rapid", "krl", "fanuc", "ros", "csv", "json"] | None = None
    out: Annotated[str | None, _named("FILE", "--out", "-o")] = None
    speed: Annotated[float, value(SHARE, "S"), ABOVE_0_TO_1] = 0.5
    settle: Annotated[float, value(SECONDS, "S"), NOT_NEGATIVE] = 0.5
    trigger_output: Signal = 1
    ready_input: Signal = 1
    plan_out: File = None
    seed: Seed = 0


@dataclass(kw_only=True)
class Images:
    """Images.

    Attributes
    ----------
    plan
        plan.json, or the folder it is in
    images
        folder with setting_01.png and so on: PNG, TIFF, BMP or NumPy, 8 or 16 bits
    serial
        name of the measured part, for the files
    operator
        who measures, for the files
    parts
        IMAGES holds a folder of images for each of many parts, named by their serials; a part that cannot be measured
        gets a reason, and the others are measured. A results.csv in the --out folder lists all parts
    partial
        measure although images are missing
    allow_lossy
        accept JPEG and WebP files, and the mosaics of colour cameras
    white_level
        grey value of full exposure, such as 4095 of 12 bits (default: that of the plan's camera, otherwise where the
        image's brightest pixels end)
    response
        how much light a grey value stands for: linear, srgb, a gamma such as 2.2, or a file of two columns, level and
        light (default: that of the plan's camera, otherwise what image files state, tested on the edges of the images)
    """

    plan: str = field(kw_only=False)
    images: str = field(kw_only=False)
    serial: Annotated[str | None, _named("TEXT")] = None
    operator: Annotated[str | None, _named("TEXT")] = None
    parts: bool = False
    partial: bool = False
    allow_lossy: bool = False
    white_level: Annotated[Any, value(WHITE, "GREY")] = None
    response: Annotated[str | None, _named("RESPONSE")] = None


@dataclass(kw_only=True)
class Deciding:
    """Deciding.

    Attributes
    ----------
    floor_px
        error that all points of an edge or rim have in common, standard deviation in pixels (default: that of the
        plan); a smaller one needs a measured part of known sizes as proof
    coverage
        least share of an edge or rim that must be found; otherwise it is not measured
    rule
        iso: ISO 14253-1, right with 95 %; simple: no guard bands; guard: guard bands of U
    exit
        exit with 0 if everything conforms, or if everything is measured
    """

    floor_px: Annotated[float | None, value(PX, "PX")] = None
    coverage: Annotated[float, value(SHARE, "SHARE"), ABOVE_0_TO_1] = 0.8
    rule: Literal["iso", "simple", "guard"] = "iso"
    exit: Literal["conforms", "measured"] = "conforms"


@dataclass(kw_only=True)
class Measure(Deciding, Images, PartReading):
    """Measure a part in images of a plan's settings, and decide whether it conforms.

    Attributes
    ----------
    part
        the part of the plan
    out
        folder for the results
    force
        replace results of another part, and other files, in DIR
    register
        edges: pose and surfaces are estimated from the part's own edges; none: the poses are those of the plan; a JSON
        file: camera poses by setting, such as setting_01, camera to world; a TOML file: a ChArUco board, with edges+
        before it improved by the part's edges
    surfaces_mm
        standard deviation of the position of the part's faces along their normals (default: that of the plan)
    edges
        by how much the part's edges are broken along their faces, such as 0.1..0.3 mm, or sharp (default: that of the
        plan, otherwise assumed sharp within 0.05 mm)
    repeatability
        standard deviations of the camera's displacement between images of a setting under different lamps (default:
        0.02mm,0.1mrad)
    qif
        also write results.qif: QIF 3.0, with statuses and u
    """

    usage = ("PLAN IMAGES --part PART --out DIR [options]",)
    epilog = """\
exit codes:
  0  all that has a tolerance conforms (--exit measured: all is measured)
  1  something does not conform, is undecided or is not measured
  2  bad input; with --parts, of at least one part
  3  an image cannot be registered"""

    part: Annotated[str, _named("PART")]
    out: Folder
    force: bool = False
    register: Annotated[str, _named("edges|none|FILE|edges+FILE")] = "edges"
    surfaces_mm: OptionalLength = None
    edges: BreakRange = None
    repeatability: SigmaPair = None
    qif: bool = False


@dataclass(kw_only=True)
class Render(PartReading):
    """Render the images that a plan takes, of a part that deviates: to rehearse before there is a camera.

    Attributes
    ----------
    plan
        plan.json, or the folder it is in
    part
        the part of the plan
    out
        folder for the images, as measure reads them, and for truth.json, the true values; those of an earlier rendering
        of this plan are replaced
    force
        replace images of another plan, and other files, in DIR
    surfaces_mm
        standard deviation of the part's faces along their normals; 0: the part as designed (default: of each face what
        the plan states)
    exact_poses
        render from the planned poses (default: poses are drawn from the plan's uncertainty)
    seed
        same seed, same part and poses
    """

    usage = ("PLAN --part PART --out DIR [options]",)

    plan: str = field(kw_only=False)
    part: Annotated[str, _named("PART")]
    out: Folder
    force: bool = False
    surfaces_mm: OptionalLength = None
    exact_poses: bool = False
    seed: Seed = 0


@dataclass(kw_only=True)
class BatchOutput:
    """Output.

    Attributes
    ----------
    out
        folder to write to; the command refuses to replace a plan of another request
    force
        replace plans and other files in DIR that no batch wrote
    graph_limit
        write the joint graph of each part for up to this many entities (default: 0)
    """

    out: Folder
    force: bool = False
    graph_limit: NumberFrom0 = 0


@dataclass(kw_only=True)
class Batch(
    DimensionTargets,
    Promise,
    WithCamera,
    BatchOutput,
    SearchEffort,
    Limits,
    Showing,
    ImageRegistration,
    Light,
    Units,
    Messages,
):
    """Plan every part of a folder, on many processes.

    Attributes
    ----------
    folder
        folder with part files, also in its subfolders
    select
        entities for which the rule holds; see plan --help (default: all sharp straight edges)
    all
        all sharp straight edges, the default
    dimensions
        all: the dimensions that each part (AP242) states; FOLDER: those of NAME.toml in it for each part NAME
    localisation
        error of points in the image: rounding, gaussian[:SIGMA[:FLOOR]] or fit[:SIGMA[:CORRELATION[:FLOOR]]], in px;
        FLOOR does not average out (default: rounding, with --dimensions gaussian:0.1:0.05)
    solids
        solids to measure of each STEP file, by number or name (default: all); a name with commas, or of digits, stands
        in double quotes: '"12"'
    jobs
        parts to plan at a time, at most one per core
    scheduler
        work on a Dask scheduler, like tcp://host:8786 (default: on this machine)
    """

    usage = ("FOLDER --camera NAME|FILE --out DIR [options]",)
    epilog = """\
exit codes:
  0  every part has a plan that inspects all its targets
  1  a part has no plan, or its plan is incomplete or not confirmed by the
     simulation; results.csv has the reason. Also if the work was interrupted
  2  bad input"""
    at_most_one = ("--select", "--all", "--dimensions")

    folder: str = field(kw_only=False)
    select: Annotated[str | None, _named("RULE")] = None
    all: bool = False
    dimensions: Annotated[str | None, _named("all|FOLDER")] = None
    solids: Annotated[Any, value(solid_names, "N|NAME,...")] = None
    scheduler: Annotated[str | None, _named("ADDRESS")] = None


@dataclass(kw_only=True)
class Graph(ChosenEntities, Workspace, PartFile):
    """Build the entity-based aspect graph and write it.

    Attributes
    ----------
    graphml
        GraphML for Gephi, yEd, Cytoscape, igraph
    camera
        take the workspace that 'plan' takes for this camera (default: ten diagonals around the part)
    lamps
        build the graph of lamp positions instead of viewpoints: which lamps make edges visible
    contrast
        with --lamps: least contrast, (I1 - I2) / (I1 + I2)
    memory_limit
        stop with an estimate if the graph takes more than about this much memory; like 8, 8GB or 500MB (default: what
        is free)
    """

    usage = (
        "PART --entities FILE|IDS --graphml FILE [options]",
        "PART --select RULE       --graphml FILE [options]",
    )

    graphml: Annotated[str, _named("FILE")]
    camera: Annotated[str | None, _named("NAME|FILE")] = None
    lamps: bool = False
    contrast: Contrast = 0.1
    memory_limit: Annotated[float | None, value(memory, "GIB")] = None


@dataclass(kw_only=True)
class Completion(Command):
    """Print the script that completes commands and options in a shell.

    Attributes
    ----------
    shell
        for bash and zsh: eval "$(aspectgraph completion bash)"; for fish: aspectgraph completion fish | source
    """

    usage = ("{bash,zsh,fish}",)

    shell: Annotated[Literal["bash", "zsh", "fish"], Parameter(name="shell")] = field(kw_only=False)


@dataclass(kw_only=True)
class Help(Command):
    """Show the help of a command.

    Attributes
    ----------
    topic
        the command (default: list all of them)
    """

    usage = ("[COMMAND]",)

    topic: Annotated[str | None, Parameter(name="COMMAND")] = field(default=None, kw_only=False)


_COMMANDS: tuple[type[Command], ...] = (
    *(
        Plan,
        Info,
        Dimensions,
        Cameras,
        Lights,
        Optics,
        Predict,
        Simulate,
        Reach,
        Program,
        Render,
        Measure,
        Batch,
    ),
    Graph,
    *(Completion, Help),
)
COMMANDS = {kind.name(): kind for kind in _COMMANDS}
"""Records by what is typed, in the order of the help."""


# by record: to work them out takes a tenth of the time of a short command
_types: dict[type[Command], Mapping[str, Any]] = {}


def types_of(record: type[Command]) -> Mapping[str, Any]:
    """Return the types of the fields of a record with what they state of them."""
    if record not in _types:
        _types[record] = MappingProxyType(get_type_hints(record, include_extras=True))
    return _types[record]


def texts_of(record: type[Command]) -> dict[str, str]:
    """Return what the docstrings of a record say of its fields; the records it is made of come first."""
    texts = {}
    for base in reversed(record.__mro__):
        _, _, section = inspect.cleandoc(base.__doc__ or "").partition("Attributes\n----------\n")
        for entry in re.split(r"\n(?=\S)", section):
            name, _, text = entry.partition("\n")
            texts[name] = " ".join(text.split())
    return texts


def rules_of(record: type[Command]) -> dict[str, NumberRule | Count]:
    """Return the rules of the numbers of a record, by the names of their fields."""
    return {
        name: part
        for name, kind in types_of(record).items()
        for part in getattr(kind, "__metadata__", ())
        if isinstance(part, NumberRule | Count)
    }


def signature_of(record: type[Command]) -> inspect.Signature:
    """Return the signature of a record in which arguments have no name that can be typed as an option."""
    kinds = inspect.Parameter
    types = types_of(record)
    parameters = [
        kinds(
            entry.name,
            kinds.KEYWORD_ONLY if entry.kw_only else kinds.POSITIONAL_ONLY,
            default=kinds.empty if entry.default is MISSING else entry.default,
            annotation=types[entry.name],
        )
        for entry in fields(record)
        if entry.init
    ]
    return inspect.Signature(sorted(parameters, key=lambda parameter: parameter.kind))
