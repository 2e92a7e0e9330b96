"""Tables for the terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aspectgraph import EntityAspectGraph
from aspectgraph.dimensions.geometric import entity_text
from errors.checks import frequency_text, interval_text, probability_text
from planner.optics import PosePrediction, PosesPrediction
from planner.plan import InspectionPlan
from planner.progress import visible
from planner.report.coverage import coverage, verdict_text
from planner.report.part_tables import vector_text
from planner.report.tables import nearest_limits
from planner.report.wording import (
    STOPPED_EARLY,
    brief_edges_text,
    brief_verdict,
    evolved_sentence,
    features_cell,
    features_sentence,
    given_text,
    lamps_named,
    margin_texts,
    names_by_reason,
    near_lines_text,
    not_shown_texts,
    percent,
    promise_sentence,
    share_text,
    shown_sentence,
    simulation_sentence,
    unshown_texts,
    unstated_edges_text,
    verdict,
    white_text,
    window_text,
)
from planner.request.problem import why_missed
from planner.request.targets import targets_of, words_of
from planner.request.words import amount_text, requirements_text, tolerance_text
from planner.rows import split_rows
from planner.sensor_setting import ReasonKind, kind_of
from planner.text_table import (
    Cell,
    Column,
    WholePieces,
    count,
    digits_text,
    listed,
    print_table,
    print_text,
    words,
)
from planner.verify.joint_counts import CONFIDENCE, lower_bound
from planner.verify.simulate_setting import CONFIRMED

if TYPE_CHECKING:
    from aspectgraph import GeometricTolerance, ModelDimension, ModelRequirements
    from planner.camera.camera import Camera
    from planner.light.light_plan import Exposure
    from planner.request.targets import Target
    from planner.sensor_setting import SensorSetting
    from planner.verify.simulate_plan import SimulationResult
    from planner.verify.simulate_setting import SuccessRate


# What the commands say with ``--json``: plain values in mm and degrees, for other programs.


def graph_record(result: EntityAspectGraph, path: str | Path) -> dict[str, Any]:
    """Return the viewing domains of a graph, which are adjacent, and where the GraphML is."""
    nodes = result.graph.nodes
    listed = result.regions.listed_as
    return {
        "entities": list(result.entity_names),
        "workspace": np.asarray(result.workspace, dtype=float).tolist(),
        "domains": [
            {"id": n, "volume": float(nodes[n]["volume"]), listed: sorted(nodes[n][listed])}
            for n in nodes
        ],
        "adjacent": [list(pair) for pair in result.graph.edges()],
        "file": str(path),
    }


def plan_record(
    plan: InspectionPlan, files: Sequence[str], not_planned: Mapping[str, str]
) -> dict[str, Any]:
    """Return a plan as in its file, the files written, and what could not be planned, with the reason.

    ``plan.features`` counts the characteristics, and those that are not planned. ``from_genetic_algorithm`` counts the
    settings whose pose comes from it. ``light_missing`` tells whether light was requested and is not planned.
    """
    return {
        "plan": plan.to_dict(),
        "files": list(files),
        "not_planned": dict(not_planned),
        "from_genetic_algorithm": plan.n_evolved,
        "light_missing": plan.light_missing,
    }


_MOST_ROWS = 60
# of a part in a batch, the best first
_STATUSES = ("planned", "incomplete", "refused", "failed")


def print_graph(graph: EntityAspectGraph) -> None:
    """Print the size of an aspect graph and its domains, largest lists first."""
    nodes = graph.graph.nodes
    listed_as = graph.regions.listed_as
    lists = {frozenset(nodes[n][listed_as]) for n in nodes}
    domains = "viewing domain" if listed_as == "observable" else "light domain"
    print_text(
        f"{count(len(nodes), domains)}, "
        f"{count(graph.graph.number_of_edges(), 'adjacency', 'adjacencies')}, "
        f"{count(len(lists), 'distinct list')} of "
        f"{count(len(graph.entity_names), 'entity', 'entities')}"
    )
    low, high = graph.workspace
    print_text(f"workspace: {vector_text(low)} to {vector_text(high)} mm")
    columns = (
        Column("domain", right=True),
        Column("volume", right=True, unit="mm3", spec=".4g"),
        Column(listed_as),
    )
    ordered = sorted(nodes, key=lambda n: (-len(nodes[n][listed_as]), n))
    rows = [
        (n, nodes[n]["volume"], listed(nodes[n][listed_as] or ("none",)))
        for n in ordered[:_MOST_ROWS]
    ]
    print_table(columns, rows)
    if len(ordered) > _MOST_ROWS:
        print(f"and {len(ordered) - _MOST_ROWS} more in the GraphML file")


def print_requirements(stated: ModelRequirements) -> None:
    """Print the requirements of a model: values, and the entities that measure them or why none do."""
    print_text(requirements_text(stated))
    if stated.dimensions:
        _print_dimensions(stated.dimensions)
    if stated.tolerances:
        print()
        _print_tolerances(stated.tolerances)
    for text in stated.disagreements:
        print_text(f"note: {text}")


def _print_tolerances(tolerances: Sequence[GeometricTolerance]) -> None:
    """Print geometric tolerances, each with the reason why edges do not show it."""
    columns = (
        Column("name"),
        Column("kind"),
        Column("zone and datums"),
        Column("features", right=True),
        Column("entities or reason"),
    )
    rows = [
        (
            tolerance.name,
            tolerance.kind,
            tolerance.frame,
            tolerance.n_features,
            _entities_or_reason(tolerance),
        )
        for tolerance in tolerances
    ]
    print_table(columns, rows)
    for tolerance in tolerances:
        if tolerance.note:
            print_text(words(f"note: {tolerance.name}: {tolerance.note}", [f"{tolerance.name}:"]))


def _print_dimensions(dimensions: Sequence[ModelDimension]) -> None:
    able = [dimension for dimension in dimensions if dimension.entities is not None]
    n_stated = sum(dimension.tolerance is not None for dimension in dimensions)
    n_characteristics = sum(bool(ways) for dimension in able for ways in dimension.features)
    roles = Counter(dimension.role for dimension in dimensions if dimension.role)
    special = "".join(f", {n} {role}" for role, n in sorted(roles.items()))
    print_text(
        f"{count(len(dimensions), 'dimension')}, {n_stated} with a tolerance{special}, {len(able)} measurable: "
        f"{count(n_characteristics, 'characteristic')}"
    )
    columns = (
        Column("name"),
        Column("kind"),
        Column("nominal", right=True),
        Column("tolerance", right=True),
        Column("features", right=True),
        Column("entities or reason"),
    )
    print_table(columns, [_dimension_row(dimension) for dimension in dimensions])
    for dimension in dimensions:
        if dimension.note:
            print_text(words(f"note: {dimension.name}: {dimension.note}", [f"{dimension.name}:"]))


def _entities_or_reason(requirement: ModelDimension | GeometricTolerance) -> Any:
    """Return the entities that measure a requirement, or why none do."""
    if requirement.entities is None:
        return words(requirement.reason or "")
    return listed(map(entity_text, requirement.entities))


def _dimension_row(dimension: Any) -> tuple[Any, ...]:
    nominal = (
        "" if dimension.nominal is None else amount_text(f"{dimension.nominal:.6g}", dimension.unit)
    )
    tolerance = ""
    if dimension.tolerance is not None:
        tolerance = f"{tolerance_text(dimension.tolerance)} {dimension.unit}"
    if dimension.tolerance_class is not None:
        tolerance = f"{dimension.tolerance_class} {tolerance}".rstrip()
    if dimension.role is not None:
        tolerance = f"{tolerance} {dimension.role}".lstrip()
    entities = _entities_or_reason(dimension)
    kind = dimension.kind.replace("_", " ")
    return (dimension.name, kind, nominal, tolerance, dimension.n_features, entities)


def print_plan(plan: InspectionPlan) -> None:
    """Print the plan: settings, what each measures and how surely, and what cannot be inspected.

    Of the margins of a setting only the tightest is shown; plan.json and the report hold all. Where edges are not
    stated, it says what `measure` will state, if that is foreseen.
    """
    names = list(plan.entities)
    columns = (
        Column("setting", right=True),
        Column("camera at", right=True, unit="mm", spec="z.1f"),
        Column("measures", right=True),
        Column("search window", right=True),
        Column("tightest margin"),
    )
    rows = [
        (
            number,
            view.position,
            len(view.entities),
            window_text(plan, number - 1),
            words(tightest_margin(plan, view)),
        )
        for number, view in enumerate(plan.settings, start=1)
    ]
    print_table(columns, rows)
    if rows:
        print()
    print_table(*_measurements(plan))
    _print_lamps(plan)
    print()
    print_text(words(brief_verdict(plan), names))
    if plan.not_planned:
        print_text(f"drawing: {verdict_text(coverage(plan))}")
    _print_not_inspected(plan)
    for text in _notes(plan):
        print_text(words(text, names), indent="  ")


def _print_lamps(plan: InspectionPlan) -> None:
    """Print where the lamp of each image is, and what it shows least; nothing without lamps."""
    if plan.light is None or not plan.settings:
        return
    columns = (
        Column("setting", right=True),
        Column("lamp on"),
        Column("lamp at", right=True, unit="mm", spec="z.1f"),
        Column("targets", right=True),
        Column("least contrast"),
        Column("expose so that"),
    )
    rows = []
    for number, images in enumerate(plan.light.images, start=1):
        for image in images:
            name, contrast = min(image.contrast.items(), key=lambda shown: shown[1])
            silhouette = " (silhouette)" if name in image.silhouettes else ""
            places = plan.light.lamps[list(image.lamps)]
            rows.append(
                (
                    number,
                    lamps_named(image, plan.light),
                    places[0] if len(places) == 1 else None,
                    len(image.contrast),
                    words(f"{name} {contrast:.2f}{silhouette}", [name]),
                    _exposed(image.expose_for, plan.camera),
                )
            )
    if rows:
        print()
        print_table(columns, rows)


def _exposed(exposure: Exposure | None, camera: Camera) -> str:
    """Say which place of an image must be how bright; nothing of plans that do not state it."""
    if exposure is None:
        return ""
    column, row = exposure.pixel
    place = f"the mean within {exposure.radius_px} px of pixel" if exposure.radius_px else "pixel"
    return f"{place} ({column}, {row}) has {white_text(exposure.share, camera)}"


# reasons that may not hold with another camera or lens
_OF_CAMERA = {
    ReasonKind.TOO_SHORT,
    ReasonKind.OUT_OF_FOCUS,
    ReasonKind.TOO_LARGE,
    ReasonKind.LINE_NEARBY,
    ReasonKind.NO_FEASIBLE_VIEW,
    ReasonKind.PROBABILITY_TOO_LOW,
}
# reasons that the views to which a light limits a target may be the cause of
_OF_VIEW = {ReasonKind.OUT_OF_FOCUS, ReasonKind.NO_FEASIBLE_VIEW}


def _notes(plan: InspectionPlan) -> list[str]:
    """Return what else to know of a plan: what is not shown, lines near others, the state of edges."""
    texts = []
    images = None if plan.simulation is None else plan.simulation.shown
    for k in range(len(plan.settings)):
        unshown = not_shown_texts(plan, k)
        texts += [f"setting {k + 1}: {text}" for text in [*unshown_texts(images, k), *unshown]]
    kinds = {kind_of(reason) for reason in plan.uninspectable.values()}
    lighting = plan.request.lighting
    # a light that the camera carries, and one behind the part, show a target from some views only
    limits_views = lighting is not None and (lighting.is_ring or lighting.is_area)
    if ReasonKind.NOT_SHOWN in kinds or (limits_views and kinds & _OF_VIEW):
        texts.append(
            "another light may show more: plan without --light, and 'aspectgraph lights' with that plan prints which"
        )
    if plan.unlit:
        texts.append(
            "'aspectgraph lights' with this plan and its part prints which light shows most"
        )
    if kinds & _OF_CAMERA:
        texts.append(
            "another camera may inspect more: 'aspectgraph optics' with the part and its targets ranks bodies and "
            "lenses"
        )
    if text := given_text(plan):
        texts.append(text)
    if text := near_lines_text(plan):
        texts.append(text)
    if text := brief_edges_text(plan):
        texts.append(f"edges: {text}")
    return texts


def print_explanation(plan: InspectionPlan) -> None:
    """Print what the probabilities of a plan mean, and what breaks of edges do; nothing of a plan without settings."""
    if plan.settings:
        print_text(promise_sentence(plan))
    if text := unstated_edges_text(plan):
        print_text(f"edges: {text}")


def print_details(plan: InspectionPlan) -> None:
    """Print what is proven, simulated and lit, and how poses were found; nothing of a plan without settings."""
    if plan.settings:
        sentences = [verdict(plan), evolved_sentence(plan)]
        print_text(words(" ".join(filter(None, sentences)), list(plan.entities)))


def _print_not_inspected(plan: InspectionPlan) -> None:
    """Print which targets are not inspected, and why; a reason of several once."""
    for reason, names in names_by_reason(plan.uninspectable).items():
        print_text(words(f"not inspected: {', '.join(names)}: {reason}", plan.entities))


def _measurements(plan: InspectionPlan) -> tuple[list[Column], list[tuple[Any, ...]]]:
    """Return the columns and rows of what each setting measures."""
    words = words_of(plan.targets)
    columns = [Column(words.items[0]), Column("setting", right=True)]
    if words.requirement_column:
        columns.append(Column("measured"))
    several = any(len(target.ways) > 1 for target in plan.targets.values())
    columns += [Column("by")] if several else []
    counted = any(setting.p_all for setting in plan.settings)
    columns += [Column("P_all", right=True)] if counted else []
    columns += [Column("P", right=True), Column("simulated")]
    rows: list[tuple[Any, ...]] = []
    for k, setting in enumerate(plan.settings):
        rates = plan.simulation.rates[k] if plan.simulation else {}
        targets = targets_of(plan.targets, setting)
        for name in setting.entities:
            stated = [setting.promise[name]] if counted else []
            stated.append(setting.probability[name])
            texts = [probability_text(p, plan.probability) for p in stated]
            simulated = _interval(rates.get(name))
            measured = [_measured(plan.targets[name])] if words.requirement_column else []
            entities = ", ".join(targets[name].entities)
            by = [entities] if several else []
            label = f"{name} ({entities} alone)" if name in setting.ends else name
            rows.append((label, k + 1, *measured, *by, *texts, simulated))
    for row in split_rows(plan):
        stated = [row.promise, row.probability] if counted else [row.probability]
        texts = [probability_text(p, plan.probability) for p in stated]
        measured = [_measured(plan.targets[row.name])] if words.requirement_column else []
        by = [", ".join(row.entities)] if several else []
        both = both_settings(plan, row.name)
        rows.append((row.name, both, *measured, *by, *texts, _interval(row.rate)))
    return columns, rows


def both_settings(plan: InspectionPlan, name: str) -> str:
    """Return the numbers of the settings that measure the ends of a dimension."""
    first, second = sorted(plan.ends[name].values())
    return f"{first + 1} + {second + 1}"


def tightest_margin(plan: InspectionPlan, setting: SensorSetting) -> str:
    """Return the margin that leaves the smallest share of its room, with its unit.

    Parameters
    ----------
    plan : InspectionPlan
        Gives the request.
    setting : SensorSetting
        One of its settings.

    Returns
    -------
    str
        Like ``focus: 9 % left (+0.51 mm)``. The probability is not a margin; empty if no margin is a number.
    """
    for limit in nearest_limits(plan, setting):
        if limit.key is not None:
            margin = margin_texts({limit.key: setting.margins[limit.key]})[0]
            value = margin.removeprefix(limit.name).strip()
            return f"{limit.name}: {share_text(limit.share)} left ({value})"
    return ""


def print_simulation(
    plan: InspectionPlan, result: SimulationResult, *, explain: bool = False
) -> None:
    """Print predicted probabilities beside simulated frequencies, and what they mean if asked to explain."""
    columns = (
        Column(words_of(plan.targets).items[0]),
        Column("setting", right=True),
        Column("predicted", right=True),
        Column("frequency", right=True),
        Column("interval", right=True),
        Column(""),
    )
    names = list(plan.entities)
    rows = []
    named_rates = []
    for k, rates in enumerate(result.rates):
        for name, rate in rates.items():
            named_rates.append((name, str(k + 1), rate))
    for name, rate in result.split.items():
        named_rates.append((name, both_settings(plan, name), rate))
    for name, place, rate in named_rates:
        interval = interval_text(rate.low, rate.high, " .. ")
        predicted = probability_text(rate.predicted, plan.probability)
        frequency = frequency_text(rate.successes, rate.n)
        rows.append((name, place, predicted, frequency, interval, words(rate.verdict)))
    print_table(columns, rows)
    _print_not_inspected(plan)
    if plan.features_text:
        print_text(features_sentence(plan))
    print_text(words(simulation_sentence(result), names))
    if result.shown is not None:
        print_text(shown_sentence(result.shown))
        for k in range(len(plan.settings)):
            for text in unshown_texts(result.shown, k):
                print_text(words(f"setting {k + 1}: {text}", names), indent="  ")
    if explain:
        print_explanation(plan)
    if any(result.rates):
        print_text(f"All intervals hold together with {percent(result.confidence)} confidence.")


def _measured(target: Target) -> Cell:
    """Return a cell that says what is measured and how wrong it may be."""
    nominal, error = target.requirement_texts
    texts = (f"{nominal},", *_split(error), features_cell(target) and f"({features_cell(target)})")
    return WholePieces(tuple(filter(None, texts)))


def _split(error: str) -> tuple[str, ...]:
    """Return "error up to" and the rest, between which a narrow terminal may break."""
    start = "error up to "
    return (start.strip(), error.removeprefix(start))


def _interval(rate: SuccessRate | None) -> Cell:
    """Return the frequency and its interval, and what they say of the prediction unless they confirm it."""
    if rate is None:
        return ""
    verdict_text = "" if rate.verdict == CONFIRMED else rate.verdict
    frequency = frequency_text(rate.successes, rate.n)
    interval = f"({interval_text(rate.low, rate.high, ' .. ')})"
    return WholePieces((frequency, interval, *verdict_text.split()))


def print_batch(results: Sequence[Any]) -> None:
    """Print how many parts are planned, and of the others the reasons (`PartResult`)."""
    counts = {status: sum(result.status == status for result in results) for status in _STATUSES}
    texts = ", ".join(f"{n} {status}" for status, n in counts.items() if n)
    print_text(f"{count(len(results), 'part')}: {texts}")
    n_early = sum(STOPPED_EARLY in result.reason for result in results)
    if n_early:
        print_text(f"{n_early} of them {STOPPED_EARLY}; see the reasons in the tables")
    n_left_out = sum(result.left_out for result in results)
    if n_left_out:
        print_text(f"{count(n_left_out, 'dimension')} left out, see left_out_reasons in the tables")
    lacking = [result for result in results if result.status != _STATUSES[0]]
    for result in lacking[:_MOST_ROWS]:
        text = f"{result.part} is {result.status}: {result.reason}"
        print_text(words(text, [result.part]), indent="  ")
    if len(lacking) > _MOST_ROWS:
        print(f"and {len(lacking) - _MOST_ROWS} more, see the tables")


def print_written(files: Sequence[str], folder: str, to_open: str) -> None:
    """Print how many files were written, and which one to open.

    Parameters
    ----------
    files : sequence of str
        All of them.
    folder : str
        The folder they are in.
    to_open : str
        The one to begin with.
    """
    # a path stays on one line, so that it can be copied
    print(visible(f"{count(len(files), 'file')} in {folder.rstrip('/')}/; open {to_open}"))


# What poses that exist measure.


_OPTICAL_AXES = "x right, y down, z forward"
_PREDICTED = (
    Column("pose"),
    Column("target"),
    Column("nominal", right=True),
    Column("permitted", right=True),
    Column("U", right=True),
    Column("P", right=True),
    Column("P_all", right=True),
)
_MISSED = (Column("target"), Column("nearest miss"))
_NOT_INSPECTED = (Column("pose"), Column("why not"), Column("targets"))


def prediction_record(
    predicted: PosesPrediction, source: str, frame: str, left_out: Mapping[str, str]
) -> dict[str, Any]:
    """Return what poses measure as plain values, in mm and degrees.

    Parameters
    ----------
    predicted : PosesPrediction
        The prediction.
    source, frame : str
        Of the file of poses, see `planner.PoseFile`.
    left_out : mapping of str to str
        Targets of the model that cannot be planned, and why.
    """
    required = predicted.required
    poses = []
    for pose, targets in zip(predicted.poses, predicted.predictions, strict=True):
        by_name = {
            name: {
                **_without_nan(vars(target)),
                "inspected": target.is_sure(required),
                "reason": target.reason(required) or None,
            }
            for name, target in targets.items()
        }
        poses.append({"name": pose.name, "cam2world": pose.cam2world.tolist(), "targets": by_name})
    return {
        "source": source,
        "frame": frame,
        "required": required,
        "poses": poses,
        "not_inspected": predicted.missed,
        "not_planned": dict(left_out),
    }


def _without_nan(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a prediction with None for what is no number."""
    return {
        name: None if isinstance(value, float) and np.isnan(value) else value
        for name, value in values.items()
    }


def print_prediction(predicted: PosesPrediction, source: str, frame: str) -> None:
    """Print what each pose inspects, why it does not inspect the other targets, and what no pose inspects.

    Parameters
    ----------
    predicted, source, frame
        As `prediction_record` takes them.
    """
    named = f"; frame {frame!r} is taken as that of the part" if frame not in ("", "part") else ""
    print_text(f"{count(len(predicted.poses), 'pose')}: {source}{named}")
    required = predicted.required
    rows = []
    others = []
    for pose, targets in zip(predicted.poses, predicted.predictions, strict=True):
        rows += [
            _predicted_row(pose.name, name, target)
            for name, target in targets.items()
            if target.is_sure(required)
        ]
        short = {name: item for name, item in targets.items() if not item.is_sure(required)}
        others += [(pose.name, why, listed(names)) for why, names in _grouped(short, required)]
    print_table(_PREDICTED, rows)
    if rows and others:
        print()
    print_table(_NOT_INSPECTED, others)
    print()
    names = list(predicted.predictions[0])
    missed = predicted.missed
    if missed:
        print_text(f"No pose inspects {len(missed)} of {count(len(names), 'target')}:")
        print_table(_MISSED, [(name, words(why)) for name, why in missed.items()])
    else:
        print_text(f"The poses inspect {count(len(names), 'target')}, all that are wanted.")
    if rows:
        print_text(_counted_over(predicted))
    if note := _doubts(predicted):
        print_text(note)


def _counted_over(predicted: PosesPrediction) -> str:
    """Return how P_all was counted, which limits how large it can be."""
    n = max(target.p_all_poses for targets in predicted.predictions for target in targets.values())
    return (
        f"P_all: lower bound with {100 * CONFIDENCE:g} % confidence over {n} displaced poses, as in a plan; "
        f"{probability_text(lower_bound(n, n))} if none of them fails."
    )


def _predicted_row(pose: str, name: str, target: PosePrediction) -> tuple[str, ...]:
    unit = target.unit
    return (
        pose,
        name,
        target.nominal_text,
        amount_text(digits_text(target.permitted_error, 3), unit),
        amount_text(digits_text(target.expanded_uncertainty, 3), unit),
        probability_text(target.probability),
        probability_text(target.p_all),
    )


def _grouped(short: Mapping[str, PosePrediction], required: float) -> list[tuple[str, list[str]]]:
    """Return targets by their worst reason, each with the range of its amounts."""
    groups: dict[str, list[str]] = {}
    for name, target in short.items():
        behind = np.isnan(target.conditional_probability)
        key = target.reason(required)
        if target.missed and not behind:
            key = next(iter(target.missed))
        groups.setdefault(key, []).append(name)
    lines = []
    for key, names in groups.items():
        amounts = [short[name].missed.get(key) for name in names]
        stated = [amount for amount in amounts if amount is not None]
        text = key
        if len(stated) == len(names):
            text = why_missed(key, min(stated))
            if digits_text(max(stated), 3) != digits_text(min(stated), 3) and " by " in text:
                head, _, unit = text.rpartition(" ")
                text = f"{head} to {digits_text(max(stated), 3)} {unit}"
        lines.append((text, names))
    return lines


def _doubts(predicted: PosesPrediction) -> str:
    """Return what may be wrong with all poses: their axes, or their unit and frame; empty if nothing is."""
    targets = [target for targets in predicted.predictions for target in targets.values()]
    if all(np.isnan(target.conditional_probability) for target in targets):
        return (
            "note: the part is behind the camera in every pose. Poses must be those of the optical frame "
            f"({_OPTICAL_AXES}), camera to part; those of a camera's body or flange are others."
        )
    if all("workspace_mm" in target.missed for target in targets):
        return (
            "note: every pose is outside the workspace. Unit or frame of the file may be others: "
            "poses must be given in the frame of the part."
        )
    return ""
