"""What is said of a plan is true: complete or not, empty, one entity or many, simulated or not, whatever came out."""

import itertools
import math
import re
from dataclasses import replace
from types import SimpleNamespace

import networkx as nx
import numpy as np
import pytest
from grid_box import EDGES, BoxSpace
from plan_examples import ENTITIES, changed, plan, setting

from planner import (
    Camera,
    DiffuseDome,
    Lighting,
    LightPlan,
    LitImage,
    SimulationResult,
    SuccessRate,
    read_plan,
)
from planner.bound.lower_bound import _proof, _proof_of_clique
from planner.report.page import NOT_INSPECTED, _figures, report_html, target_colors
from planner.report.terminal_tables import print_graph, print_plan, print_simulation
from planner.report.wording import (
    bound_sentence,
    brief_edges_text,
    brief_verdict,
    calibration_rows,
    dark_sentence,
    edges_text,
    entity_words,
    graph_sentence,
    incumbent_line,
    light_sentence,
    not_shown_texts,
    promise_sentence,
    simulation_sentence,
    stopped_note,
    unstated_edges_text,
    verdict,
)
from planner.sensor_setting import Reason, ReasonKind
from planner.verify.simulate_setting import (
    CONFIRMED,
    CONSERVATIVE,
    CONTRADICTED,
    MODEL_TOLERANCE,
    TOLERATED,
    UNSTATED,
    VERDICTS,
)

# successes of 1000, low, high and prediction
RATES = {
    CONFIRMED: (950, 0.93, 0.965, 0.95),
    CONSERVATIVE: (998, 0.99, 0.9995, 0.93),
    TOLERATED: (940, 0.925, 0.955, 0.958),
    CONTRADICTED: (850, 0.83, 0.87, 0.95),
    UNSTATED: (850, 0.83, 0.87, float("nan")),
}
SPACE = BoxSpace((80.0, 50.0, 60.0), [[-900.0] * 3, [900.0] * 3], EDGES)


def rate(kind):
    successes, low, high, predicted = RATES[kind]
    return SuccessRate(successes, 1000, low, high, 0.995, 0, predicted)


def result(*settings):
    """Make a result of settings, each given by the verdicts on its entities."""
    return SimulationResult(
        tuple({f"e{k}": rate(kind) for k, kind in enumerate(kinds)} for kinds in settings),
        1000,
        0,
        0.99,
    )


@pytest.mark.parametrize("kind", VERDICTS)
def test_a_rate_gets_the_word_that_fits(kind):
    assert rate(kind).verdict == kind
    assert rate(kind).confirms == (kind == CONFIRMED)
    one = result([kind])
    assert one.confirmed == (kind in (CONFIRMED, CONSERVATIVE, TOLERATED))
    assert one.broken == (((0, "e0"),) if kind == CONTRADICTED else ())


def test_the_ends_of_the_interval_confirm_and_the_tolerance_has_an_end():
    ends = [
        SuccessRate(900, 1000, 0.88, 0.92, 0.99, 0, p).verdict
        for p in (0.88, 0.92, 0.9200001, 0.9249, 0.9251)
    ]
    assert ends == [CONFIRMED, CONFIRMED, TOLERATED, TOLERATED, CONTRADICTED]


POSES = "A simulation of 1000 displaced poses per setting "
SAID = [
    ([], "Nothing was simulated: the plan has no settings."),
    ([[CONFIRMED]], f"{POSES}confirms the plan: the one stated probability confirmed."),
    (
        [[CONFIRMED] * 2, [CONFIRMED]],
        f"{POSES}confirms the plan: 3 of 3 stated probabilities confirmed.",
    ),
    (
        [[CONFIRMED] * 29, [CONSERVATIVE] * 4],
        f"{POSES}supports the plan: 29 of 33 stated probabilities confirmed, 4 conservative (measured up to 0.068 "
        f"better).",
    ),
    (
        [[CONSERVATIVE]],
        f"{POSES}supports the plan: 0 of 1 stated probability confirmed, 1 conservative (measured up to 0.068 better).",
    ),
    (
        [[CONFIRMED, TOLERATED]],
        f"{POSES}does not contradict the plan: 1 of 2 stated probabilities confirmed, 1 above the interval by no more "
        f"than the model's tolerance of {MODEL_TOLERANCE:g}.",
    ),
    (
        [[CONFIRMED], [CONTRADICTED]],
        f"{POSES}contradicts the plan: 1 of 2 stated probabilities confirmed, 1 contradicted (measured up to 0.1 "
        "worse).",
    ),
    (
        [[UNSTATED]],
        f"{POSES}cannot judge the plan: 0 of 1 stated probability confirmed, 1 missing.",
    ),
]


@pytest.mark.parametrize(("kinds", "sentence"), SAID)
def test_simulation_is_told_with_every_kind_counted(kinds, sentence):
    assert simulation_sentence(result(*kinds)) == sentence


@pytest.mark.parametrize("kinds", list(itertools.product(VERDICTS, repeat=3)))
def test_only_what_is_all_confirmed_confirms(kinds):
    text = simulation_sentence(result(kinds[:2], kinds[2:]))
    assert ("confirms the plan" in text) == (set(kinds) == {CONFIRMED})
    assert ("supports the plan" in text) == (
        CONSERVATIVE in kinds and set(kinds) <= {CONFIRMED, CONSERVATIVE}
    )
    assert (" contradicts the plan" in text) == (CONTRADICTED in kinds)
    assert f"{kinds.count(CONFIRMED)} of 3 stated probabilities confirmed" in text
    for kind, words in (
        (CONSERVATIVE, "conservative"),
        (TOLERATED, "above the interval"),
        (CONTRADICTED, "contradicted"),
    ):
        assert (f"{kinds.count(kind)} {words}" in text) == (kind in kinds)


def plans():
    """Yield plans of all sizes: settings, entities inspected and not, bounds, with and without simulation."""
    names = list(ENTITIES)
    for n, inspected, left, bound, kind in itertools.product(
        (0, 1, 2), (1, 2), (0, 1), (1, 2), (None, *VERDICTS[:4])
    ):
        if bound > n and (n or bound > 1):
            continue
        seen, unseen = (
            (names[:inspected], names[inspected : inspected + left])
            if n
            else ([], names[:inspected])
        )
        made = plan(
            settings=[setting((40.0, -180.0, 620.0), seen) for _ in range(n)],
            lower_bound=bound if n else 0,
            uninspectable=dict.fromkeys(unseen, "unobservable"),
            entities={name: ENTITIES[name] for name in (*seen, *unseen)},
        )
        rates = tuple({name: rate(kind or CONFIRMED) for name in seen} for _ in range(n))
        yield replace(made, simulation=SimulationResult(rates, 1000, 0, 0.99) if kind else None)


def test_verdict_is_true_of_every_plan():
    for made in plans():
        text = verdict(made)
        n = len(made.settings)
        inspected = len(made.inspected)
        assert text.startswith(f"{inspected} of {len(made.entities)} entit")
        assert ("Proven minimal" in text) == (n > 0 and made.lower_bound == n)
        assert ("Proven lower bound" in text) == (made.lower_bound < n)
        assert ("all 2 entities" in text or "the entity" in text) == (made.complete and n > 0)
        assert ("Not simulated." in text) == (n > 0 and made.simulation is None)
        assert not re.search(
            r"\b1 (entities|settings|poses|probabilities)|\b[02-9] (entity|setting|probability)\b",
            text,
        )
        assert "nan" not in text


@pytest.mark.parametrize(
    ("left", "bound", "sentence"),
    [
        (
            0,
            2,
            "Proven minimal: no plan that inspects all 2 entities under this request has fewer settings.",
        ),
        (
            1,
            2,
            "Proven minimal for the 2 inspected entities: "
            "no plan that inspects them under this request has fewer settings.",
        ),
        (
            0,
            1,
            "Proven lower bound: 1. Every plan that inspects all 2 entities under this request has at least 1 setting.",
        ),
    ],
)
def test_bound_says_for_what_it_is_proven(left, bound, sentence):
    names = list(ENTITIES)[: 2 + left]
    made = plan(
        settings=[setting((40.0, -180.0, 620.0), names[:2])] * 2,
        lower_bound=bound,
        uninspectable=dict.fromkeys(names[2:], "unobservable"),
        entities={name: ENTITIES[name] for name in names},
    )
    assert bound_sentence(made) == sentence


def box_plan(names, kind, left=()):
    """Make a plan of one setting for edges of the box, whose rates are all of a kind."""
    made = plan(
        settings=[setting((40.0, -180.0, 620.0), names)] if names else [],
        lower_bound=int(bool(names)),
        uninspectable=dict.fromkeys(left, "unobservable"),
        entities={name: SPACE.entities[name].endpoints for name in (*names, *left)},
    )
    if kind is None:
        return made
    rates = ({name: rate(kind) for name in names},) if names else ()
    return replace(made, simulation=SimulationResult(rates, 1000, 0, 0.99))


@pytest.mark.parametrize("kind", [None, *VERDICTS[:4]])
@pytest.mark.parametrize(
    ("names", "left"), [(["+z-y"], ["-z+y"]), (["+z-y", "+z+x"], []), ([], ["-z+y"])]
)
def test_report_and_terminal_say_the_same(capsys, names, left, kind):
    made = box_plan(names, kind, left)
    page = re.sub(
        r"<script.*?</script>", "", report_html(made, SPACE, notes=["A note."]), flags=re.S
    )
    print_plan(made)
    printed = " ".join(capsys.readouterr().out.split())
    assert brief_verdict(made) in printed
    assert ("proven to be the fewest" in printed) == made.minimal
    assert "<p>A note.</p>" in page
    assert ("proven minimum" in page) == bool(names)
    if names and kind:
        assert simulation_sentence(made.simulation).replace("'", "&#39;") in page
        assert page.count(f">{kind}</span>".replace("'", "&#39;")) == len(names)
        assert f"<b>{len(names) if kind == CONFIRMED else 0} / {len(names)}</b>" in page
        print_simulation(made, made.simulation)
        printed = " ".join(capsys.readouterr().out.split())
        assert ("confirms the plan" in printed) == (kind == CONFIRMED)
        assert printed.count(kind) >= len(names)
        assert printed.endswith("All intervals hold together with 99 % confidence.")
    if not names:
        assert "0 of 1 edge inspected: the plan has no camera poses." in page
        assert "Simulation." not in page


def test_proof_counts_in_good_english():
    assert "1 box of camera poses was checked" in _proof(1, 0)
    assert "and no pairs of edges were found" in _proof(1, 0)
    assert "20 boxes of camera poses were checked" in _proof(20, 1)
    assert "and 1 pair of edges was found" in _proof(20, 1)
    assert _proof_of_clique(3, "edges").startswith("Of 3 edges no two can be inspected together")
    assert _proof_of_clique(1, "edges") == "Fewer settings than one inspect nothing."


def test_a_skipped_graph_is_told_with_what_to_do():
    assert "--graph-limit is 24, and the plan has 60 entities" in graph_sentence(60, 24)
    text = graph_sentence(60, None)
    assert "joint graph of 60 entities" in text
    assert "--graph-limit 60 builds it anyway" in text
    assert "aspectgraph graph PART --entities IDS --graphml FILE" in text


def test_a_lens_that_focuses_up_to_infinity_is_told_without_a_number():
    made = box_plan(["+z-y"], None)
    far = changed(made, camera=replace(made.camera, focus_distance_mm=1e5))
    assert "100000 mm; sharp from " in report_html(far, SPACE)
    assert not re.search(r"sharp from [^<]*inf", report_html(far, SPACE))


def test_a_graph_of_one_domain_and_one_entity_is_told_in_the_singular(capsys):
    graph = nx.Graph()
    graph.add_node(0, observable=("rim",), volume=1.0)
    regions = SimpleNamespace(listed_as="observable")
    box = np.array([[0, 0, 0], [1, 1, 1]])
    print_graph(SimpleNamespace(graph=graph, entity_names=("rim",), workspace=box, regions=regions))
    assert "1 viewing domain, 0 adjacencies, 1 distinct list of 1 entity" in capsys.readouterr().out


def test_an_unfinished_plan_says_what_more_time_may_give():
    for made in plans():
        assert "stopped early" not in verdict(made)
        text = verdict(replace(made, unfinished=True))
        assert "Planning stopped early. A longer run may" in text
        assert ("inspect more" in text) == (not made.complete)
        assert ("need fewer settings" in text) == (not made.minimal or not made.complete)
        note = stopped_note(replace(made, unfinished=True))
        assert note.startswith("stopped early, so a longer time limit may ")
        more = note.partition(" limit may ")[2]
        assert f"A longer run may {more}. " in f"{text} "
        assert stopped_note(made) == ""


def test_a_line_of_the_log():
    made = plan(
        settings=[setting((40.0, -180.0, 620.0), list(ENTITIES)[:2])] * 3,
        lower_bound=2,
        uninspectable=dict.fromkeys(list(ENTITIES)[2:3], "unobservable"),
        entities={name: ENTITIES[name] for name in list(ENTITIES)[:3]},
    )
    words = " ".join(incumbent_line(made, 12.34).split())
    assert words == "12.3 s 3 settings at least 2 gap 33 %, 2 of 3 entities"


def test_a_calibration_is_told_and_nothing_of_other_cameras():
    camera = Camera.from_opencv(
        [[2320.0, 0, 1251.456], [0, 2326.0, 1009.0], [0, 0, 1]],
        [-0.21, 0.08, 1e-3, -6e-4, 0],
        (2448, 2048),
        pixel_pitch_mm=0.00345,
        f_number=8.0,
        focus_distance_mm=300.0,
    )
    rows = calibration_rows(camera)
    assert rows["Principal point"] == "(1251.46, 1009.00) px"
    assert rows["Lens distortion"].startswith(
        "k1, k2, p1, p2, k3 = -0.21, 0.08, 0.001, -0.0006, 0;"
    )
    assert calibration_rows(plan().camera) == {}


def test_settings_that_take_several_images_are_counted_and_their_images():
    """Three settings of 3, 1 and 2 images: two take more than one, six are taken."""
    each = [[LitImage((0,), {"top front": 0.3})] * n for n in (3, 1, 2)]
    light = LightPlan(
        "placed", 0.1, 0.1, "dark", np.zeros((1, 3)), tuple(map(tuple, each)), ({}, {}, {}), 1, "so"
    )
    asked = plan(
        settings=(setting((0.0, 0.0, 300.0), ["top front", "top right"]),) * 3, light=light
    )
    assert light_sentence(asked).endswith(
        " 2 settings need more than one image, and the plan takes 6."
    )
    one = replace(light, images=(light.images[0], light.images[1], light.images[1]))
    assert light_sentence(replace(asked, light=one)).endswith(
        " 1 setting needs more than one image, and the plan takes 5."
    )
    none = replace(light, images=(light.images[1],) * 3)
    assert "image" not in light_sentence(replace(asked, light=none))


def test_what_no_lamp_shows_is_not_counted_as_inspected():
    """Shown in one of two settings is shown; the other target is in the dark in its only setting."""
    image = (LitImage((0,), {"top front": 0.3}),)
    dark = ({"top right": "in the shadow", "top front": "in the shadow"}, {})
    light = LightPlan("placed", 0.1, 0.1, "dark", np.zeros((1, 3)), ((), image), dark, 1, "by hand")
    settings = (
        setting((0.0, 0.0, 300.0), ["top front", "top right"]),
        setting((0.0, 20.0, 300.0), ["top front"]),
    )
    made = plan(settings=settings, light=light)
    assert made.unlit == ("top right",)
    assert list(made.inspected) == ["top front"]
    assert sorted(made.promises) == ["top front", "top right"]
    all_seen = replace(
        made, uninspectable={}, request=replace(made.request, targets=made.request.targets[:2])
    )
    assert not all_seen.complete
    assert replace(all_seen, light=replace(light, unlit=({}, {}))).complete
    early = replace(made, unfinished=True)
    assert "No lamp shows top right from these poses." in verdict(early)
    assert "may find other poses, from which lamps show more targets" in verdict(early)
    n = len(made.entities)
    for text in (brief_verdict(made), verdict(made)):
        assert text.startswith(f"1 of {n} entities inspected from 2 settings")
        assert "No lamp shows top right." in text
        # both are counted by the bound
        assert re.search(r"2 entities that poses inspect, lit or not\b", text)
    # what has a reason in common stands in one line
    assert not_shown_texts(made, 0) == ["not shown: top right, top front: in the shadow"]
    assert not_shown_texts(made, 1) == []
    domed = replace(light, kind="diffuse-dome", area=DiffuseDome(200.0, 60.0, 270.0))
    assert dark_sentence(replace(made, light=domed)) == "The diffuse dome does not show top right."
    assert f"1 of {n} entities inspected" in repr(made)
    assert target_colors(made)["top right"] == NOT_INSPECTED != target_colors(made)["top front"]
    # the smallest probability of the page is that of what is shown
    sure = replace(made.settings[0], probability={"top front": 0.99, "top right": 0.91})
    shown = replace(made.settings[1], probability={"top front": 0.97})
    tiles = [value for value, _ in _figures(replace(made, settings=(sure, shown)))]
    assert any(value.startswith("0.99") for value in tiles)
    assert not any(value.startswith("0.91") for value in tiles)
    assert replace(made, light=replace(light, unlit=({}, {}))).unlit == ()


def test_edges_planned_as_sharp_are_told_with_the_u_that_measuring_will_state():
    """A diameter whose step is off by up to 2 c, for c up to 0.05 mm: mean 0.025 mm, mean square 4 c²/9."""
    example = read_plan("examples/measured/plan.json")
    text = unstated_edges_text(example)
    sharp = 0.10819982  # U of bore_35_back in plan.json
    assert "would move bore_35_back by up to 0.2 mm, its U is 0.11 mm" in text
    broken = 2.0 * math.sqrt(4.0 * 0.05**2 / 9.0)
    assert f"Its U is then at most about {math.hypot(sharp, broken):.2g} mm" in text
    stated = replace(example, request=replace(example.request, edge_break_mm=(0.0, 0.1)))
    assert unstated_edges_text(stated) == ""
    brief = brief_edges_text(example)
    assert "would move bore_35_back by up to 0.2 mm, its U is 0.11 mm. State --edges" in brief
    assert len(brief.split()) <= 30
    assert brief_edges_text(stated) == edges_text(stated)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("e6[0:85/256]", "e6 from 0 to 33 %"),
        ("17[3/4:1]", "17 from 75 to 100 %"),
        # so short that whole percentages would not tell its ends apart
        ("e6[1/2:129/256]", "e6 from 50.0 to 50.4 %"),
        ("e6", "e6"),
        ("r11[3:22]", "r11[3:22]"),
        ("width", "width"),
    ],
)
def test_a_stretch_is_named_by_percentages(name, words):
    assert entity_words(name) == words


def test_lengths_are_said_to_be_planned_as_sharp():
    """U of `measure` was up to five times that of the plan, as breaks of 0.05 mm may move both ends."""
    lengths = plan()
    text = (
        "planned as sharp, and P holds for that; 'measure' assumes breaks of up to 0.05 mm, so its U of lengths will "
        "be larger"
    )
    assert brief_edges_text(lengths) == f"{text}. State --edges to 'measure'"
    stated = replace(lengths, request=replace(lengths.request, edge_break_mm=(0.0, 0.0)))
    assert text not in brief_edges_text(stated)
    # P and the U of `measure` are for different edges, where both are named
    differing = (
        "P takes edges as sharp, but 'measure' assumes breaks of up to 0.05 mm where none is stated"
    )
    assert differing in promise_sentence(lengths)
    assert differing not in promise_sentence(stated)


@pytest.mark.parametrize(
    ("lamps", "kind", "n"),
    [
        ("backlight", ReasonKind.NO_FEASIBLE_VIEW, 1),
        ("ring", ReasonKind.OUT_OF_FOCUS, 1),
        ("backlight", ReasonKind.PROBABILITY_TOO_LOW, 0),
        (None, ReasonKind.NO_FEASIBLE_VIEW, 0),
    ],
)
def test_a_light_that_limits_the_views_may_be_why_there_is_none(lamps, kind, n, capsys):
    """A rim that a backlight shows from afar only was out of focus, and another camera was proposed alone."""
    lighting = None if lamps is None else Lighting(lamps)
    missing = {"bottom": Reason.of(kind, "out of focus by 201 mm")}
    print_plan(changed(plan(), lighting=lighting, uninspectable=missing))
    out = capsys.readouterr().out
    assert out.count("another light may show more") == n
    assert out.count("another camera may inspect more") == 1


def test_a_reason_states_its_kind_once():
    kind = ReasonKind.OUT_OF_FOCUS
    assert str(Reason.of(kind, "out of focus by 0.4 mm")) == "out of focus: by 0.4 mm"
    assert str(Reason.of(kind, "its far end is")) == "out of focus: its far end is"
