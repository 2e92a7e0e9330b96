"""Entities as the command line takes them: all edges, ids, or a file of names."""

from __future__ import annotations

import csv
import io
import json
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from aspectgraph.entities.entity import Entity, is_part_text, parse_part, resolve_entities
from aspectgraph.exceptions import EntityError
from aspectgraph.files import check_plain, read_text
from aspectgraph.solid.solid import Solid, check_solid

# Tables of comma-separated values that a spreadsheet shows and does not run.
#
# Excel, LibreOffice and Google Sheets take text that begins with ``=``, ``+``, ``-`` or ``@`` for
# a formula, and tabs and line breaks for the border of a cell. So such text gets an apostrophe in
# front, which Excel and OWASP advise. Numbers stay as they are. `text_of_cell` takes the
# apostrophe away. Control characters, which a terminal obeys, are shown as Python writes them.
# All tables are written here.


# full-width signs start formulas where Excel runs in Japanese; blanks before a sign are no shelter
_FORMULA = re.compile(r"[\s']*?[=+\-@\t\r\n\0\uff1d\uff0b\uff0d\uff20]")
# C0 but for tab and line ends, DEL, C1; signs that turn the direction; halves of characters
_CONTROL = re.compile(
    "[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)


class NumberText(str):
    """A number that is written out already, such as with a number of decimals; a table takes it as it is."""

    __slots__ = ()


def cell_of_text(text: str) -> str:
    """Return a text as a cell that no spreadsheet takes for a formula.

    Parameters
    ----------
    text : str
        The text.

    Returns
    -------
    str
        With an apostrophe in front if a formula could begin so, otherwise the text itself.

    Examples
    --------
    >>> cell_of_text("=1+1"), cell_of_text("bore"), cell_of_text("it's")
    ("'=1+1", 'bore', "it's")
    """
    return f"'{text}" if _FORMULA.match(text) else text


def text_of_cell(cell: str) -> str:
    """Return the text that `cell_of_text` made a cell of.

    Parameters
    ----------
    cell : str
        The cell.

    Returns
    -------
    str
        Without the apostrophe in front if a formula could begin behind it.

    Examples
    --------
    >>> text_of_cell("'=1+1"), text_of_cell("'bore'")
    ('=1+1', "'bore'")
    """
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell[1:]) else cell


def csv_text(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> str:
    r"""Return a table as comma-separated values with a heading, as RFC 4180 defines them.

    Parameters
    ----------
    columns : sequence of str
        Keys of the rows.
    rows : iterable of mapping
        Values as `table_text` takes them.

    Returns
    -------
    str
        Lines end with ``\r\n``, so that a cell with a line break of any kind is quoted.
    """
    return table_text(columns, ([row[column] for column in columns] for row in rows))


def table_text(
    heading: Sequence[str],
    rows: Iterable[Sequence[Any]],
    head: Sequence[str] = (),
    line_end: str = "\r\n",
) -> str:
    """Return rows of values as comma-separated values; names of columns may come twice.

    Parameters
    ----------
    heading : sequence of str
        Names of the columns.
    rows : iterable of sequence
        Text is written by `cell_of_text`, with control characters shown; numbers without loss,
        None as nothing.
    head : sequence of str, optional
        Lines of a comment before the heading; each gets ``# `` in front.
    line_end : str, optional
        What ends a line.

    Returns
    -------
    str
        As `csv_text` returns it.
    """
    text = io.StringIO()
    for line in head:
        text.write(f"# {_without_control(' '.join(line.split()))}{line_end}")
    writer = csv.writer(text, lineterminator=line_end)
    writer.writerow(map(_cell, heading))
    writer.writerows(map(_cell, row) for row in rows)
    return text.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, NumberText) or not isinstance(value, str):
        return value
    return _without_control(cell_of_text(value))


def _without_control(text: str) -> str:
    return _CONTROL.sub(_shown, text)


def _shown(character: re.Match[str]) -> str:
    code = ord(character[0])
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"


# Python reads no integer of more than some thousand digits
_ID = r"[era]?\d{1,300}"
_IDS = re.compile(rf"{_ID}(-{_ID})?", re.ASCII)
_ENDS = re.compile(r"\(([^()]*)\)\s*-\s*\(([^()]*)\)")
_LONGEST_RANGE = 100_000


def read_entities(
    text_or_path: str | Path, solid: Solid, tolerance_mm: float | None = None
) -> dict[str, Entity]:
    """Read entities from text or a file, as the command line does.

    Parameters
    ----------
    text_or_path : str or Path
        ``"all"`` selects every straight sharp edge. Ids are ``"17, 18"``, ``"e17 e18"``, ranges
        like ``"17-21"``, or ``"r3, a0"`` for rims and arcs. Parts are ``"17[0:1/4]"`` for the first
        quarter of an edge and ``"r3[0:8]"`` for the first eight chords of a rim. End points such as
        ``"(0,0,10)-(25,0,10)"`` are named p1, p2 and so on. A .toml or .json file has ``name =
        id``, ``name = "r3"`` or ``name = [[x, y, z], [x, y, z]]``, at top level or in a table
        ``entities``. A .csv file has rows of a name and an id, or of a name and six coordinates. In
        a .csv file, an apostrophe before a name that a spreadsheet would run, such as ``'=1+1``, is
        not part of the name.
    solid : Solid
        The part.
    tolerance_mm : float, optional
        See `resolve_entities`.

    Returns
    -------
    dict of str to Entity
        By name, in the order given.

    Raises
    ------
    EntityError
        The text has another form, or an entity is not a sharp straight edge, rim or arc.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import read_entities
    >>> list(read_entities("0-2, 5", box))
    ['e0', 'e1', 'e2', 'e5']
    """
    check_solid(solid)
    text = str(text_or_path).strip()
    if text.lower() == "all":
        return resolve_entities(solid, _every_edge(solid), tolerance_mm)
    if Path(text).suffix.lower() in (".toml", ".json"):
        return resolve_entities(solid, _read_file(Path(text)), tolerance_mm)
    if Path(text).suffix.lower() == ".csv":
        return resolve_entities(solid, _read_csv(Path(text)), tolerance_mm)
    points = [(_point(match[1]), _point(match[2])) for match in _ENDS.finditer(text)]
    words = [word for word in re.split(r"[\s,;]+", _ENDS.sub(" ", text)) if word]
    bad = [word for word in words if not (_IDS.fullmatch(word) or is_part_text(word))]
    if bad or not (words or points):
        raise EntityError.of_rule(
            "entities",
            "must be 'all', ids such as 17,18 or r3,a0, ranges such as 17-21, end "
            "points such as (0,0,10)-(25,0,10), or the path of a .toml, .json or .csv file",
            repr(bad[0] if bad else text),
        )
    ids = list(dict.fromkeys(entity_id for word in words for entity_id in _ids(word)))
    named: dict[str, Any] = {_name(entity_id): entity_id for entity_id in ids}
    return resolve_entities(
        solid, {**named, **{f"p{k}": ends for k, ends in enumerate(points, start=1)}}, tolerance_mm
    )


def _every_edge(solid: Solid) -> list[int]:
    """Return the ids of all sharp straight edges; a part of revolution has none."""
    ids = [edge.id for edge in solid.straight_edges()]
    if not ids:
        raise EntityError.of_rule(
            "entities",
            "must name rims or arcs of a part without a sharp straight edge",
            f"'all' for one with {len(solid.rims())} rims and {len(solid.arcs())} arcs",
        )
    return ids


def _name(entity_id: int | str) -> str:
    if isinstance(entity_id, int):
        return f"e{entity_id}"
    return parse_part(entity_id).name if is_part_text(entity_id) else entity_id


def _point(text: str) -> list[float]:
    """Return three numbers."""
    try:
        x, y, z = (float(word) for word in text.split(","))
    except ValueError:
        raise EntityError(
            f"an end point must be three numbers such as (0,0,10). Got ({text})."
        ) from None
    return [x, y, z]


def _ids(word: str) -> list[int | str]:
    """Return the ids of a word: ``17``, ``e17``, ``r3``, ``17-21`` or ``r0-r5``."""
    if is_part_text(word):
        return [word]
    first, _, last = word.partition("-")
    kind = first[0] if first[0] in "ra" else ""
    low = int(first.lstrip("era"))
    high = int(last.lstrip("era")) if last else low
    if last and (last.lstrip("e0123456789") or kind) and last[0] != kind:
        raise EntityError(f"a range must be of one kind, such as 17-21 or r0-r5. Got {word!r}.")
    if not low <= high <= low + _LONGEST_RANGE:
        raise EntityError(f"a range must go upwards, by at most {_LONGEST_RANGE}. Got {word!r}.")
    return [f"{kind}{i}" if kind else i for i in range(low, high + 1)]


def _read_csv(path: Path) -> dict[str, Any]:
    """Return what the rows of a CSV file name; a first row of words is a heading."""
    try:
        # a cell in quotes may hold line breaks
        text = io.StringIO(read_text(path, "utf-8-sig", newline=""), newline="")
        rows = [row for row in csv.reader(text) if any(row)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise EntityError.of_rule(
            "entities", "must name a CSV file that can be read", f"{str(path)!r}: {error}"
        ) from None
    entities: dict[str, Any] = {}
    for number, row in enumerate(rows, start=1):
        name, *values = (cell.strip() for cell in row)
        name = text_of_cell(name)
        if number == 1 and values and not any(character.isdigit() for character in values[0]):
            continue
        if name in entities:
            raise EntityError(
                f"a CSV file must name an entity once. Got {name!r} again in {path.name}, row {number}."
            )
        if len(values) == 1 and (re.fullmatch(_ID, values[0], re.ASCII) or is_part_text(values[0])):
            entities[name] = _ids(values[0])[0]
        elif len(values) == 6:
            entities[name] = [_point(",".join(values[:3])), _point(",".join(values[3:]))]
        else:
            raise EntityError(
                "a CSV row must be a name and an id, or a name and six coordinates. "
                f"Got {','.join(row)!r} in {path.name}, row {number}."
            )
    return entities


def parse_names(path: Path) -> Any:
    """Return what a .toml or .json file holds.

    Parameters
    ----------
    path : Path
        The file; without the ending .json it is TOML.

    Raises
    ------
    ValueError
        It cannot be read, or is not of its format; the message is the reason alone.
    """
    try:
        text = read_text(path)
        is_json = path.suffix.lower() == ".json"
        content = json.loads(text, object_pairs_hook=_once) if is_json else tomllib.loads(text)
    except OSError as error:
        raise ValueError(error.strerror or str(error)) from error
    except RecursionError as error:
        raise ValueError("it is nested too deep") from error
    except (json.JSONDecodeError, tomllib.TOMLDecodeError, UnicodeDecodeError):
        raise
    except _TwiceError:
        raise
    except ValueError as error:
        # Python reads no integer of more than some thousand digits
        raise ValueError("it holds a number of too many digits") from error
    check_plain(content)
    return content


class _TwiceError(ValueError):
    """A name that stands twice, of which JSON would silently keep the last."""


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the names of a JSON object and what they stand for; TOML itself refuses a name twice."""
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise _TwiceError(f"the name {twice!r} stands in it twice")
    return content


def _read_file(path: Path) -> Any:
    if not path.is_file():
        raise EntityError.of_rule("entities", "must name an existing file", repr(str(path)))
    try:
        content = parse_names(path)
    except ValueError as error:
        raise EntityError(
            f"an entity file must be valid {path.suffix[1:].upper()}. Got {path.name}: {error}."
        ) from error
    if isinstance(content, dict) and isinstance(content.get("entities"), dict | list):
        content = content["entities"]
    if not isinstance(content, dict | list):
        raise EntityError(
            f"an entity file must hold names or edge ids. Got {path.name} with {type(content).__name__}."
        )
    return content
