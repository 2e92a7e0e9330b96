"""The documents as pages for a browser: their formulas, and the picture that is drawn from the code."""

import csv
import importlib.util
import itertools
import json
import re
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
from mkdocs.exceptions import PluginError

ROOT = Path(__file__).parents[1]


def load(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


FORMULAS = load(ROOT / "docs/formulas.py")
NOTEBOOK_PICTURES = load(ROOT / "docs/figures/notebook_pictures.py")
SITE_EXTRAS = load(ROOT / "docs/site_extras.py")
ROOMS = load(ROOT / "docs/figures/rooms.py")


@pytest.mark.parametrize(
    ("latex", "part"),
    [
        (r"\lvert x", '<mo stretchy="false" form="prefix" lspace="0" rspace="0">|</mo>'),
        (r"x\rvert", '<mo stretchy="false" form="postfix" lspace="0" rspace="0">|</mo>'),
        (r"x\bigr\rvert", 'form="postfix" lspace="0" rspace="0">|</mo>'),
        (r"\mathbf m", "𝐦"),
        (r"R^{\mathsf T}", "𝖳"),
        (r"\mathcal A\mathcal B", '𝒜</mi><mi mathvariant="normal">ℬ'),
        (r"2\tan\kappa", '<mo form="prefix" lspace="0.17em" rspace="0.17em">tan</mo>'),
        (r"v\in\operatorname{int}S", '<mo form="prefix" lspace="0.17em" rspace="0.17em">int</mo>'),
        (r"\cos\kappa", '<mo form="prefix" lspace="0" rspace="0.17em">cos</mo>'),
        (r"A=\emptyset", "<mi>&#x02205;</mi>"),
        (r"S\setminus F", "<mo>&#x02216;</mo>"),
        (r"\ln(x)", '<mo form="prefix" lspace="0" rspace="0">ln</mo>'),
    ],
)
def test_what_browsers_would_set_wrong_is_put_right(latex, part):
    assert part in FORMULAS.mathml(latex)


def test_a_formula_is_replaced_with_its_number_beside_it():
    page = r'<p>a</p><div class="arithmatex">\[x &lt; 1, \tag{L9}\]</div><span class="arithmatex">\(y\)</span>, z'
    found = FORMULAS.translated(page)
    assert found.startswith('<p>a</p><div class="formula"><math')
    assert found.count("</math>") == 2
    assert '</math><span class="number">(L9)</span></div>' in found
    assert found.endswith("</math>,</span> z")
    assert "arithmatex" not in found
    assert "tag" not in found


def test_a_command_that_is_not_known_fails_with_page_and_formula():
    page = SimpleNamespace(file=SimpleNamespace(src_path="some.md"))
    with pytest.raises(PluginError, match=r"some\.md: formula .* has an unknown command \\nosuch"):
        FORMULAS.on_page_content(r'<span class="arithmatex">\(\nosuch x\)</span>', page=page)


def test_two_formulas_without_an_empty_line_between_are_refused():
    with pytest.raises(ValueError, match="empty line between"):
        FORMULAS.translated(r'<div class="arithmatex">\[x $$ $$ y\]</div>')


def test_long_names_may_be_broken_and_code_blocks_stay():
    assert FORMULAS.breakable("<code>a.b_c</code>") == "<code>a.<wbr>b_<wbr>c</code>"
    assert FORMULAS.breakable("<code>--sigma-mm</code>") == '<code class="option">--sigma-mm</code>'
    assert FORMULAS.breakable("<pre><code>a.b</code></pre>") == "<pre><code>a.b</code></pre>"


def test_the_picture_of_the_rooms_is_that_of_the_code():
    """If this fails, run docs/figures/rooms.py, after giving a new wing a place there, or a new module its words."""
    assert ROOMS.draw() == (ROOT / "docs/figures/rooms.svg").read_text("utf-8")


@pytest.mark.parametrize("package", ROOMS.PLACES)
def test_every_arrow_in_the_picture_leads_downward(package):
    floor = {room: k for k, level in enumerate(ROOMS.floors(package)) for room in level}
    assert floor.keys() == ROOMS.PLACES[package].keys() | ROOMS.BESIDE[package].keys()
    assert all(floor[upper] < floor[lower] for upper, lower in ROOMS.arrows(package))


@pytest.mark.parametrize("package", ROOMS.PLACES)
def test_no_box_of_the_picture_covers_another_and_texts_fit(package):
    for level in ROOMS.floors(package):
        wings = ROOMS.PLACES[package].keys() & set(level)
        places = sorted(ROOMS.PLACES[package][wing][0] for wing in wings)
        assert all(ROOMS.COLUMN * (right - left) > ROOMS.BOX[0] for left, right in pairwise(places))
    # a letter of the small text is about half as wide as high
    widest = ROOMS.BOX[0] / 5
    assert all(len(what) <= widest for _, what in ROOMS.PLACES[package].values())


def test_search_has_the_index_as_a_script(tmp_path):
    """A browser lets no script fetch a file from a disk."""
    (tmp_path / "search").mkdir()
    entries = [{"location": "a.html", "title": "Größe", "text": "</script> \u2028 x"}]
    index = tmp_path / "search" / "search_index.json"
    index.write_text(json.dumps({"config": {}, "docs": entries}), encoding="utf-8")
    SITE_EXTRAS.on_post_build(SimpleNamespace(site_dir=str(tmp_path)))
    assert not index.exists()
    script = index.with_suffix(".js").read_text(encoding="utf-8")
    assert script.startswith("window.searchIndex = ")
    assert json.loads(script.removeprefix("window.searchIndex = ").rstrip(";\n")) == entries


def test_the_version_is_that_of_the_package():
    config = SITE_EXTRAS.on_config(SimpleNamespace(extra={}))
    assert config.extra["version"] == f"version {version('aspectgraph')}"


def test_every_page_is_in_the_menu_and_on_the_first_page():
    menu = yaml.safe_load((ROOT / "mkdocs.yml").read_text("utf-8"))["nav"]
    pages = re.findall(r"[\w/-]+\.md", str(menu))
    found = {str(path.relative_to(ROOT / "docs")) for path in (ROOT / "docs").rglob("*.md")}
    assert found == {page for page in pages if not page.startswith("reference/")}
    index = (ROOT / "docs/index.md").read_text("utf-8")
    assert [page for page in found if f"({page})" not in index] == ["index.md"]
    # a picture before anything longer than two lines
    assert index.index("![") < 300


def test_the_corner_figure_is_that_of_its_script():
    corners = load(ROOT / "docs/figures/corners.py")
    assert corners.draw() == (ROOT / "docs/figures/corners.svg").read_text("utf-8")


def test_every_notebook_is_shown_with_a_small_picture_of_its_own():
    names = {path.stem for path in (ROOT / "notebooks").glob("*.ipynb")}
    page = (ROOT / "docs/notebooks.md").read_text("utf-8")
    shown = re.findall(
        r"^## (\w+)\n\n(.*?)\n\n!\[[^\]\n]+\]\(figures/(\w+)\.png\)$",
        page,
        flags=re.MULTILINE | re.DOTALL,
    )
    assert {name for name, _, _ in shown} == names == NOTEBOOK_PICTURES.CHOSEN.keys()
    for name, told, picture in shown:
        assert picture == name
        assert "##" not in told
        assert (ROOT / f"docs/figures/{name}.png").stat().st_size < 150_000


def test_the_notebook_of_measuring_has_the_values_of_its_guide():
    """The guide's table is compared with the program, so that stored outputs that are older are noticed."""
    book = json.loads((ROOT / "notebooks/measuring.ipynb").read_text("utf-8"))
    streams = [
        "".join(output["text"])
        for cell in book["cells"]
        for output in cell.get("outputs", ())
        if "text" in output
    ]
    text = next(stream for stream in streams if " true " in stream)
    stored = re.findall(r"^(\w+) +([\d.]+) ± ([\d.]+) mm", text, flags=re.MULTILINE)
    guide = (ROOT / "docs/guides/measuring.md").read_text("utf-8")
    rows = re.findall(r"^\| `(\w+)` \| [^|]* \| ([\d.]+) \| ([\d.]+) \|", guide, flags=re.MULTILINE)
    assert len(stored) == 4
    assert stored == rows[:4]


def test_proposals_are_compared_with_the_numbers_that_were_stored():
    with (ROOT / "notebooks/pricers.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    page = (ROOT / "docs/comparison.md").read_text("utf-8")
    lines = dict(re.findall(r"^\| ([^|]*) \| (.*\(.*) \|$", page, flags=re.MULTILINE))
    names = {
        "genetic algorithm, no slope": "... without a slope",
        "genetic algorithm, three targets": "... for three targets",
        "random restarts in viewing domains": "random restarts",
        "poses near known ones": "near known poses",
        "several targets in focus": "in focus together",
        "column generation, as in a plan": "column generation",
        "column generation with crossover": "column generation, crossed",
    }
    parts = list(dict.fromkeys(row["part"] for row in rows))
    for told in ("genetic algorithm", "CMA-ES", "memetic algorithm", *names):
        method = names.get(told, told)
        for part, cell in zip(parts, lines[told].split(" | "), strict=True):
            own = [
                float(r["relaxation"]) for r in rows if (r["part"], r["method"]) == (part, method)
            ]
            mean = sum(own) / len(own)
            assert cell == f"{mean:.2f} ({min(own):.2f}–{max(own):.2f})"


def test_methods_are_compared_with_the_numbers_that_were_stored():
    with (ROOT / "notebooks/anytime.csv").open(encoding="utf-8", newline="") as file:
        last = {(row["part"], row["planner"]): row for row in csv.DictReader(file)}
    page = (ROOT / "docs/comparison.md").read_text("utf-8").split("## Methods")[1]
    tables = (
        ("demo", "ctc01", "d2mi", "mfcad-narrow", "mtc-narrow"),
        ("mfcad-default", "d2mi-default"),
    )
    for planner in {planner for _, planner in last}:
        lines = re.findall(rf"^\| `?{planner}`? \| (.*) \|$", page, flags=re.MULTILINE)
        cells = [cell for line in lines for cell in line.split(" | ")]
        for part, cell in zip(itertools.chain(*tables), cells, strict=True):
            row = last.get((part, planner))
            if row is None:
                assert cell == "not run"
                continue
            seconds = float(row["seconds"])
            less = "" if row["supported"] == row["inspected"] else f" ({row['supported']})"
            told = f"{row['settings']} for {row['inspected']}{less}; {seconds:.{1 if seconds >= 0.1 else 2}f} s"
            assert cell == (f"{told}; at least {row['bound']}" if row["bound"] else told)
