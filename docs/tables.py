"""Tables of the documents that are filled with what the program prints: run without options to fill them anew.

A table stands between two comments, `<!-- table NAME -->` and `<!-- end of table -->`. Its rows come from the program,
or from a file in `docs/measured` where computing them takes long. That file states the command, the date, the program
and the digests of its inputs. `--models FOLDER` reads the models in a folder again, and stores what it finds.
`--example FOLDER` stores what `measure` wrote there of the images in `examples/measured`. `--drawing FOLDER` stores the
rows of `benchmarks/planning/drawing_table.py` in its files `planned.json` and `registered.json`. `--real-images CSV`
stores what `benchmarks/images/real_images.py` wrote. `--gaps JSON` stores rows of
`benchmarks/planning/dense_optimum.py`, each in place of an older one of the same request and effort.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import math
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
MEASURED = DOCS / "measured"
_BLOCK = re.compile(r"(<!-- table ([\w-]+) -->\n\n).*?(\n<!-- end of table -->)", flags=re.DOTALL)
MODELS = {
    "CTC-01": "nist_ctc_01_ap242.stp",
    "CTC-02": "nist_ctc_02_ap242.stp",
    "CTC-03": "nist_ctc_03_ap242.stp",
    "CTC-04": "nist_ctc_04_ap242.stp",
    "CTC-05": "nist_ctc_05_ap242.stp",
    "D2MI 827-9999-904": "nist_d2mi_827-9999-904.stp.gz",
}

COMMAND = (
    "aspectgraph measure examples/measured/plan.json examples/measured/images "
    "--part examples/nist_ctc_01_ap242.stp --out measured"
)
# of the part that the images of the example were rendered from
TRUE = {"bore_25": "24.810", "bore_35": "34.984", "slot_width": "49.998", "bore_35_back": "34.859"}


def stored(name: str) -> dict[str, Any]:
    """Return what was measured and stored under a name."""
    data: dict[str, Any] = json.loads((MEASURED / f"{name}.json").read_text(encoding="utf-8"))
    return data


def measure_models(folder: Path) -> None:
    """Read the dimensions of all models of NIST, and store their counts."""
    from aspectgraph import read_dimensions, read_solid
    from ground.faces import project_version
    from planner.files import timestamp

    models = {}
    for label, name in MODELS.items():
        path = folder / name
        stated = read_dimensions(path, read_solid(path))
        usable = [dimension for dimension in stated if dimension.entities is not None]
        zones = [
            zone
            for dimension in usable
            for zone, reason in zip(dimension.surfaces, dimension.feature_reasons, strict=True)
            if reason is None
        ]
        models[label] = {
            "file": name,
            "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
            "dimensions": len(stated),
            "with_tolerance": sum(dimension.tolerance is not None for dimension in stated),
            "measurable": len(usable),
            "characteristics": len(zones),
            "zones": sorted((zone.tolerance, zone.width_mm) for zone in zones if zone is not None),
        }
    record = {
        "command": "python docs/tables.py --models FOLDER",
        "date": timestamp(),
        "program": project_version(),
        "models": models,
    }
    _store("models", record)


def example_rows(folder: Path) -> list[list[str]]:
    """Return what is printed of the values that `measure` wrote to a folder."""
    from planner.measuring.results import decimals_of

    rows = []
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))["results"]
    for result in results:
        lower, upper = result["tolerance"]
        assert lower == -upper
        decimals = decimals_of(result["U"])
        value = f"{result['value']:.{decimals}f}"
        uncertainty = f"{result['U']:.{decimals}f}"
        found = min(reading["found_share"] for reading in result["readings"])
        nominal = f"{result['nominal']:g} {result['unit']} ±{upper:g}"
        cells = (nominal, value, uncertainty, f"{100 * found:.0f} %", result["decision"])
        rows.append([f"`{result['name']}`", *cells])
    return rows


def store_example(folder: Path) -> None:
    """Store what was measured in the images of the example."""
    source = json.loads((folder / "results.json").read_text(encoding="utf-8"))["source"]
    record = {
        "command": COMMAND,
        **{key: source[key] for key in ("date", "program", "plan_digest", "images")},
        "rows": example_rows(folder),
    }
    _store("example", record)


def store_drawing(folder: Path) -> None:
    """Store what plans cover of the drawings, without registration and with it."""
    from ground.faces import project_version
    from planner.files import timestamp

    command = "python benchmarks/planning/drawing_table.py PARTS --time-limit 120 --json FOLDER/"
    record: dict[str, Any] = {"date": timestamp(), "program": project_version()}
    for name, option in (("planned", ""), ("registered", " --register")):
        path = folder / f"{name}.json"
        if path.is_file():
            rows = json.loads(path.read_text(encoding="utf-8"))
            record[name] = {"command": f"{command}{path.name}{option}", "rows": rows}
    _store("drawing", record)


def _drawing() -> str:
    """Return what plans cover of the drawings: numbers of characteristics, and of positions among them."""
    record = stored("drawing")
    registered = {row["part"]: row for row in record.get("registered", {"rows": []})["rows"]}
    heads = ["part", "requirements", "edges show", "characteristics", "inspected"]
    heads += ["settings / bound"]
    if registered:
        heads += ["inspected, registered", "settings / bound"]
    labels = {name.partition(".")[0]: label for label, name in MODELS.items()}
    rows = []
    for row in record["planned"]["rows"]:
        cells = [labels[row["part"]], row["requirements"], row["measurable"]]
        cells.append(_with_positions(row, "characteristics", "positions"))
        cells += _planned(row)
        if registered:
            cells += _planned(registered.get(row["part"]))
        rows.append(cells)
    return table(heads, rows)


def _planned(row: dict[str, Any] | None) -> list[str]:
    if row is None:
        return ["–", "–"]
    inspected = _with_positions(row, "inspected", "positions inspected")
    return [inspected, f"{row['settings']} / {row['bound']}"]


def _with_positions(row: dict[str, Any], count: str, positions: str) -> str:
    return f"{row[count]} ({row[positions]})"


# requests of the comparison in its order, and three others
GAPS = {
    "demo": "CTC-01, 16 edges, paper's conditions",
    "ctc01": "CTC-01, 116 edges, paper's conditions",
    "mfcad": "MFCAD, wide lens, paper's conditions",
    "d2mi": "D2MI, paper's conditions",
    "mtc": "MTC plate, wide lens, paper's conditions",
    "mfcad-narrow": "MFCAD, narrow lens, paper's conditions",
    "mtc-narrow": "MTC plate, narrow lens, paper's conditions",
    "mfcad-default": "MFCAD, narrow lens, default conditions",
    "d2mi-default": "D2MI, default conditions",
    "own-block": "block, 14 faces, default conditions",
    "mfcad-4-default": "mfcad_4-5-5-6-9-23, default conditions",
    "mfcad-6-default": "mfcad_6-11-11-19, default conditions",
}
# the default effort in a run of 26 November 2026, after 246 s of processor time
EARLIER = {"mfcad-narrow": {"settings": "19", "inspected": "118"}}
# a plan of so many times its bound is short enough
_SHORT = 1.25


def store_gaps(paths: Sequence[Path]) -> None:
    """Store what `benchmarks/planning/dense_optimum.py` measured of requests, beside what is stored of others."""
    from ground.faces import project_version
    from planner.files import timestamp

    old = stored("gaps")["rows"] if (MEASURED / "gaps.json").exists() else []
    by_key = {(row["part"], row["effort"]): row for row in old}
    for path in paths:
        for row in json.loads(path.read_text(encoding="utf-8")):
            by_key[row["part"], row["effort"]] = row
    command = "python benchmarks/planning/dense_optimum.py --folder PARTS --json FILE"
    record = {"command": command, "date": timestamp(), "program": project_version()}
    _store("gaps", {**record, "rows": list(by_key.values())})


def gap_verdict(row: dict[str, Any], *others: dict[str, str] | None) -> str:
    """Return whether a plan is short enough: by its bound, or by the smallest cover known, be it of other plans."""
    if row["plan"] <= _SHORT * row["bound"]:
        return "near the bound"
    smallest = row["counted"]
    for other in others:
        if other is not None and int(other["inspected"]) >= row["targets"]:
            smallest = min(smallest, int(other["settings"]))
    excess = row["plan"] - smallest
    if excess <= 0:
        return "smallest known"
    return f"{excess} above the smallest known"


def _gaps() -> str:
    """Return plans of both efforts beside their bounds and the smallest cover; cells not measured have a dash."""
    heads = ["request", "default effort, 200 s", "bound", "ratio"]
    heads += ["quick", "bound", "ratio", "poses", "smallest cover", "as counted"]
    heads += ["relaxation", "quick is"]
    with (DOCS.parent / "notebooks/anytime.csv").open(encoding="utf-8", newline="") as file:
        plans = [row for row in csv.DictReader(file) if row["planner"] == "plan_inspection"]
    last = {row["part"]: row for row in plans}
    measured = {row["part"]: row for row in stored("gaps")["rows"] if row["effort"] == "quick"}
    rows = []
    for part, label in GAPS.items():
        cells = [label]
        if part in last:
            plan = last[part]
            cells += _beside_bound(plan["settings"], plan["inspected"], plan["bound"])
        else:
            cells += ["–"] * 3
        if part in measured:
            row = measured[part]
            cells += _beside_bound(row["plan"], row["targets"], row["bound"])
            cells += [f"{row['poses']:,}", row["optimum"], row["counted"]]
            cells += [f"{row['relaxation']:.1f}"]
            cells += [gap_verdict(row, last.get(part), EARLIER.get(part))]
        else:
            cells += ["–"] * 8
        rows.append(cells)
    return table(heads, rows)


def _gaps_of_standard() -> str:
    """Return plans of the default effort without a time limit beside their bounds and the smallest cover."""
    heads = ["request", "default effort, no limit", "bound", "ratio", "poses"]
    heads += ["smallest cover", "as counted", "relaxation", "processor time", "the plan is"]
    measured = {row["part"]: row for row in stored("gaps")["rows"] if row["effort"] == "standard"}
    rows = []
    for part, label in GAPS.items():
        if part not in measured:
            continue
        row = measured[part]
        cells = [label, *_beside_bound(row["plan"], row["targets"], row["bound"])]
        cells += [f"{row['poses']:,}", row["optimum"], row["counted"], f"{row['relaxation']:.1f}"]
        cells += [f"{row['plan_seconds']:.0f} s", gap_verdict(row, EARLIER.get(part))]
        rows.append(cells)
    return table(heads, rows)


def _beside_bound(settings: object, edges: object, bound: object) -> list[str]:
    return [f"{settings} for {edges}", f"{bound}", f"{float(str(settings)) / int(str(bound)):.2f}"]


_CONDITION = ("edges", "material", "response", "bits", "state")
_BLIND_SIGMAS = 3


def store_real_images(paths: Sequence[Path]) -> None:
    """Store what `benchmarks/images/real_images.py` measured, a line for each condition; lengths in µm."""
    from ground.faces import project_version
    from planner.files import timestamp

    readings: dict[tuple[str, ...], list[dict[str, str]]] = {}
    for path in paths:
        with path.open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                condition = tuple(row[name] for name in _CONDITION)
                readings.setdefault(condition, []).append(row)
    lines = []
    for condition, rows in readings.items():
        made = [row for row in rows if not row["reason"]]
        errors = [1000 * (float(row["value"]) - float(row["truth"])) for row in made]
        us = [1000 * float(row["u"]) for row in made]
        ratios = [abs(error) / u for error, u in zip(errors, us, strict=True)]
        far = [row for row, ratio in zip(made, ratios, strict=True) if ratio > _BLIND_SIGMAS]
        count = max(len(made), 1)
        lines.append(
            {
                **dict(zip(_CONDITION, condition, strict=True)),
                "promised": sum(row["promised"] == "1" for row in rows),
                "kept": sum(row["promised"] == "1" for row in made),
                "made": len(made),
                "bias": round(sum(errors) / count, 1),
                "rms": round(math.sqrt(sum(error**2 for error in errors) / count), 1),
                "u": round(sum(us) / count, 1),
                "within": sum(ratio <= 2 for ratio in ratios),
                "beyond": len(far),
                "silent": sum(not row["notes"] and not row["image_notes"] for row in far),
            }
        )
    command = "python benchmarks/images/real_images.py FOLDER --lights ring --csv FILE"
    record = {"command": command, "date": timestamp(), "program": project_version()}
    _store("real_images", {**record, "conditions": lines})


def _store(name: str, record: dict[str, Any]) -> None:
    MEASURED.mkdir(exist_ok=True)
    text = json.dumps(record, indent=1, ensure_ascii=False) + "\n"
    (MEASURED / f"{name}.json").write_text(text, encoding="utf-8")


def _example() -> str:
    heads = ("target", "nominal", "value", "U (k = 2)", "found", "decision", "true value")
    rows = stored("example")["rows"]
    return table(heads, ([*row, TRUE[row[0].strip("`")]] for row in rows))


def _model_dimensions() -> str:
    heads = ("part", "dimensions", "with a tolerance", "measurable", "characteristics")
    keys = ("dimensions", "with_tolerance", "measurable", "characteristics")
    models = stored("models")["models"]
    return table(heads, ((label, *(model[key] for key in keys)) for label, model in models.items()))


def _model_zones() -> str:
    rows = []
    for label, model in stored("models")["models"].items():
        widths: dict[str, list[float]] = {}
        for kind, width in model["zones"]:
            widths.setdefault(kind, []).append(width)
        texts = [f"{kind} {_listed(sorted(set(values)))} mm" for kind, values in widths.items()]
        counts = (model["characteristics"], len(model["zones"]))
        rows.append((label, *counts, ", ".join(texts)))
    return table(("part", "characteristics", "with a zone", "zones"), rows)


_STATES = {
    "nothing": "nothing",
    "unseen": "nothing, u with unseen breaks",
    "edges+response": "edges and response",
    "edges+response+white": "edges, response and white",
}


def _real_images() -> str:
    heads = ("edges", "grey values", "stated", "readings", "bias", "rms error", "mean u")
    rows = []
    shown: list[list[Any]] = []
    for line in stored("real_images")["conditions"]:
        key = [line[name] for name in (*_CONDITION[:-1], "made", "bias", "rms", "u")]
        if key in shown:
            # breaks that images show have one U
            continue
        shown.append(key)
        edges = line["edges"] + (" mm" if " " in line["edges"] else "")
        if line["material"] != "matt":
            edges += f", {line['material']}"
        response = line["response"]
        grey = f"gamma {response}" if response[0].isdigit() else response
        if line["bits"] != "8":
            grey += f", {line['bits']} bits"
        numbers: tuple[str, ...] = ("",) * 5
        if line["made"]:
            amounts = (f"{line[key]:.0f}" for key in ("bias", "rms", "u"))
            shares = f"{line['within']} of {line['made']}", f"{line['beyond']}, {line['silent']}"
            numbers = *amounts, *shares
        kept = f"{line['kept']} of {line['promised']}"
        more = line["made"] - line["kept"]
        if more:
            kept += f", and {more}"
        rows.append((edges, grey, _STATES[line["state"]], kept, *numbers))
    return table((*heads, "within 2 u", "beyond 3 u, without a note"), rows)


def _qif_statuses() -> str:
    from planner.measuring.results import STATUSES

    remarks = {"NOT_ANALYZED": ", with the reason as an attribute"}
    rows = (
        (decision.value, f"`{status}`{remarks.get(status, '')}")
        for decision, status in STATUSES.items()
    )
    return table(("decision", "status"), rows)


# plans whose rendered images were measured: the name on the page, and which classes are a row
IMAGED = {
    "conditions, CTC-01": ("example of CTC-01", (("clean",),)),
    "conditions, MFCAD": ("all edges of mfcad_4-5-5-6-9-23, A = .98", (("clean",), ("not lit",))),
    "conditions, D2MI": ("all edges of D2MI, A = .98", (("clean",), ("not lit",))),
    "paper's, CTC-01": ("CTC-01, the paper's constraints", (("no corner",), ("clean", "border"))),
}
METHODS = ("measured", "rounded", "corner", "canny")
ACCURACIES = ("0.98", "0.99", "0.995")


def _edge_images() -> str:
    with (DOCS.parent / "notebooks/edge_images.csv").open(encoding="utf-8", newline="") as file:
        measured = list(csv.DictReader(file))
    lines = []
    for plan, (label, classes) in IMAGED.items():
        for kinds in classes:
            rows = [row for row in measured if row["plan"] == plan and row["kind"] in kinds]
            total = sum(int(row["n"]) for row in rows)
            name = kinds[0] if len(kinds) == 1 else "others"
            cells = [label, name, len(rows), f"{total:,}", _stated(rows, total)]
            cells += [_counted(rows, total, method) for method in METHODS]
            lines.append(cells)
            label = ""
    heads = (
        "plan",
        "class",
        "measurements",
        "images",
        "stated",
        "fit",
        "rounded",
        "corner",
        "Canny",
    )
    return table(heads, lines)


def _sums(rows: Sequence[dict[str, str]], method: str) -> list[float]:
    """Return how many images a method is accurate in, or is stated to be, at each accuracy."""
    return [sum(int(row["n"]) * float(row[f"{method} {a}"]) for row in rows) for a in ACCURACIES]


def _stated(rows: Sequence[dict[str, str]], total: int) -> str:
    """Return stated probabilities, rounded down."""
    shares = [expected / total for expected in _sums(rows, "promised")]
    texts = [
        "> .9999" if share > 0.9999 else f"{math.floor(1000 * share) / 1000:.3f}".lstrip("0")
        for share in shares
    ]
    return " / ".join(texts)


def thousandths(count: int, total: int) -> int:
    """Return a share in thousandths, halves rounded up."""
    return (2000 * count + total) // (2 * total)


def _counted(rows: Sequence[dict[str, str]], total: int, method: str) -> str:
    """Return shares of images; counts of all and of none."""
    counts = [round(value) for value in _sums(rows, method)]
    texts = [
        f"{count} of {total}" if count in (0, total) else f".{thousandths(count, total):03d}"
        for count in counts
    ]
    if len(set(counts)) == 1 and counts[0] in (0, total):
        return f"{texts[0]}, all three"
    return " / ".join(texts)


TABLES: dict[str, Callable[[], str]] = {
    "drawing": _drawing,
    "edge-images": _edge_images,
    "gaps": _gaps,
    "gaps_of_standard": _gaps_of_standard,
    "measured-example": _example,
    "model-dimensions": _model_dimensions,
    "model-zones": _model_zones,
    "qif-statuses": _qif_statuses,
    "real-images": _real_images,
}


def _listed(values: Sequence[float]) -> str:
    texts = [f"{value:g}" for value in values]
    return " and ".join(filter(None, [", ".join(texts[:-1]), texts[-1]]))


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table in Markdown."""
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for row in rows:
        cells = " ".join(f"| {cell}" if str(cell) else "|" for cell in row)
        lines.append(f"{cells} |")
    return "\n".join(lines) + "\n"


def filled(text: str) -> str:
    """Return a page with its tables as they are now."""
    return _BLOCK.sub(lambda match: match[1] + TABLES[match[2]]() + match[3], text)


def pages() -> list[Path]:
    """Return the pages that hold such tables."""
    return [
        path
        for path in sorted(DOCS.rglob("*.md"))
        if _BLOCK.search(path.read_text(encoding="utf-8"))
    ]


def main() -> None:
    """Fill the tables of all pages."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--models", metavar="FOLDER", type=Path)
    parser.add_argument("--example", metavar="FOLDER", type=Path)
    parser.add_argument("--drawing", metavar="FOLDER", type=Path)
    parser.add_argument("--real-images", metavar="CSV", type=Path, nargs="+")
    parser.add_argument("--gaps", metavar="JSON", type=Path, nargs="+")
    options = parser.parse_args()
    if options.models is not None:
        measure_models(options.models)
    if options.example is not None:
        store_example(options.example)
    if options.drawing is not None:
        store_drawing(options.drawing)
    if options.real_images:
        store_real_images(options.real_images)
    if options.gaps:
        store_gaps(options.gaps)
    for path in pages():
        path.write_text(filled(path.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
