"""Reference pages from the docstrings of the public names: a hook of mkdocs.

A page per package, in the order of its `__all__`. Docstrings are numpydoc; their sections become lists.
"""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Iterator
from typing import Any

from mkdocs.structure.files import File, Files

PACKAGES = ("aspectgraph", "planner", "errors", "ga")

_SECTION = re.compile(r"^([A-Z][A-Za-z ]+)\n-{3,}\n", re.MULTILINE)
# of these sections each entry begins at the margin and is explained below it
_LISTED = {"Parameters", "Other Parameters", "Attributes", "Returns", "Yields", "Raises", "Warns"}
_MOST_LINE = 100


def on_files(files: Files, *, config: Any, **_: Any) -> Files:
    """Add a page for each package."""
    for package in PACKAGES:
        files.append(File.generated(config, f"reference/{package}.md", content=page(package)))
    return files


def page(package: str) -> str:
    """Return the reference of a package as Markdown.

    Parameters
    ----------
    package : str
        Its name.
    """
    module = importlib.import_module(package)
    parts = [f"# {package}", _text(inspect.getdoc(module) or ""), _overview(package, module)]
    for name in sorted(module.__all__, key=str.lower):
        parts += _entry(f"{package}.{name}", getattr(module, name))
    return "\n\n".join(part for part in parts if part) + "\n"


def _overview(package: str, module: Any) -> str:
    """Return a table of the public names, by the folder that defines them."""
    folders: dict[str, list[str]] = {}
    for name in sorted(module.__all__, key=str.lower):
        value = getattr(module, name)
        home = getattr(value, "__module__", package).split(".")
        folders.setdefault(".".join(home[:2]), []).append(name)
    rows = ["| name | what it is | defined in |", "|---|---|---|"]
    for folder, names in sorted(folders.items()):
        for name in names:
            value = getattr(module, name)
            docstring = (inspect.getdoc(value) if callable(value) else None) or ""
            summary = " ".join(docstring.split("\n\n")[0].split()).replace("|", "&#124;")
            rows.append(f"| [`{name}`](#{name.lower()}) | {_text(summary)} | `{folder}` |")
    return "\n".join(rows)


def _entry(name: str, value: Any, level: int = 2) -> Iterator[str]:
    """Yield heading, signature and docstring of a name, and of the public members of a class."""
    yield f"{'#' * level} {name.split('.', 1)[1]}"
    if isinstance(value, type) and issubclass(value, Exception):
        yield markdown(inspect.getdoc(value) or "")
        return
    if callable(value):
        yield f"```python\n{signature(name, value)}\n```"
    yield markdown(inspect.getdoc(value) or "" if callable(value) else "")
    if isinstance(value, type):
        for member, one in _members(value):
            yield from _entry(f"{name}.{member}", one, level + 1)


def _members(cls: type) -> Iterator[tuple[str, Any]]:
    """Yield the public methods and properties that a class or the project's classes above it define."""
    seen: set[str] = set()
    for owner in cls.__mro__:
        if owner.__module__.split(".")[0] not in PACKAGES:
            continue
        for name, raw in vars(owner).items():
            plain = getattr(raw, "__func__", raw)
            documented = isinstance(raw, property) or inspect.isfunction(plain)
            if (
                documented
                and not name.startswith("_")
                and name not in seen
                and inspect.getdoc(plain)
            ):
                seen.add(name)
                yield name, raw if isinstance(raw, property) else getattr(cls, name)


def signature(name: str, value: Any) -> str:
    """Return how a name is called, on lines of their own where it is long."""
    short = name.split(".", 1)[1]
    try:
        given = inspect.signature(value)
    except (TypeError, ValueError):
        return short
    items = []
    kind = None
    for one in given.parameters.values():
        if one.name == "self":
            continue
        if one.kind is one.KEYWORD_ONLY and kind not in (one.KEYWORD_ONLY, one.VAR_POSITIONAL):
            items.append("*")
        items.append(_parameter(one))
        kind = one.kind
    # what a class is called for is plain
    returned = given.return_annotation if not isinstance(value, type) else given.empty
    end = "" if returned is given.empty else f" -> {_annotation(returned)}"
    found = f"{short}({', '.join(items)}){end}"
    return (
        found
        if len(found) <= _MOST_LINE
        else "\n".join([f"{short}(", *(f"    {i}," for i in items), f"){end}"])
    )


def _parameter(one: inspect.Parameter) -> str:
    stars = {one.VAR_POSITIONAL: "*", one.VAR_KEYWORD: "**"}.get(one.kind, "")
    kind = "" if one.annotation is one.empty else f": {_annotation(one.annotation)}"
    default = "" if one.default is one.empty else f" = {one.default!r}"
    return f"{stars}{one.name}{kind}{default}"


def _annotation(value: Any) -> str:
    return value if isinstance(value, str) else inspect.formatannotation(value)


def markdown(docstring: str) -> str:
    """Return a numpydoc docstring as Markdown."""
    pieces = _SECTION.split(docstring)
    parts = [_text(pieces[0])]
    for title, body in zip(pieces[1::2], pieces[2::2], strict=True):
        if title == "Examples":
            parts.append(f"**{title}**\n\n```python\n{body.strip()}\n```")
        elif title in _LISTED:
            parts.append(f"**{title}**\n\n{_list(body, title)}")
        else:
            parts.append(f"**{title}**\n\n{_text(body)}")
    return "\n\n".join(part for part in parts if part)


def _list(body: str, title: str) -> str:
    """Return the entries of a section as a list."""
    entries: list[tuple[str, list[str]]] = []
    for line in body.strip("\n").splitlines():
        if line and not line.startswith(" "):
            entries.append((line, []))
        elif entries:
            entries[-1][1].append(line.strip())
    found = []
    for head, lines in entries:
        name, colon, kind = head.partition(" : ")
        text = " ".join(line for line in lines if line)
        # of what is returned or raised, the type stands alone
        first = f"`{name}`" + (f" ({_text(kind)})" if colon else "")
        if title == "Returns" and colon:
            first = f"`{name}` ({_text(kind)})"
        found.append(f"* {first}{': ' + _text(text) if text else ''}")
    return "\n".join(found)


def _text(text: str) -> str:
    """Return plain text as Markdown: code in single backticks, and no mark-up that was not meant."""
    text = text.strip().replace("``", "`")
    pieces = re.split(r"(`[^`]*`)", text)
    return "".join(piece if piece.startswith("`") else _escaped(piece) for piece in pieces)


def _escaped(text: str) -> str:
    # bold is kept: "**Guarantee.**"
    text = re.sub(r"(?<!\*)\*(?!\*)", r"\\*", text)
    return text.replace("<", "&lt;").replace("$", "&#36;")
