"""What notebooks show of a value: a title, sentences and a table.

A class that shows itself inherits `ShownInNotebook` and makes a `NotebookView`. Templates and
pictures are loaded when a notebook asks for them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from ground.templates import render

TONES: Final = {"good": "#228b52", "bad": "#d33f34", "open": "#a87000"}
"""Colours that are read on white and on black."""


@dataclass(frozen=True)
class Toned:
    """Text in a colour.

    Attributes
    ----------
    text : str
        The text.
    tone : str
        A key of `TONES`.
    """

    text: str
    tone: str

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True)
class NotebookTable:
    """A table in a notebook.

    Attributes
    ----------
    headings : sequence of str
        A heading per column.
    rows : sequence of sequence
        A text, a number or a `Toned` per column.
    right : collection of int
        Columns that are aligned on the right, by number from 0.
    note : str
        A sentence below the rows, such as how many are left out; empty for none.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[Any]]
    right: Collection[int] = ()
    note: str = ""


@dataclass(frozen=True)
class NotebookView:
    """What a notebook shows of a value.

    Attributes
    ----------
    title : str
        What it is.
    lines : sequence of str or Toned
        Sentences below the title.
    table : NotebookTable or None
        Below the sentences; none without rows.
    items : mapping of str to str
        A list below the tables: names, and what is said of them.
    details : sequence of NotebookTable
        Tables below the first; none without rows.
    """

    title: str
    lines: Sequence[str | Toned] = ()
    table: NotebookTable | None = None
    items: Mapping[str, str] = field(default_factory=dict)
    details: Sequence[NotebookTable] = ()

    def html(self) -> str:
        """Return a part of a page that needs nothing else; every text is escaped."""
        tables = (self.table, *self.details)
        page = render(
            "ground",
            "notebook.html",
            title=self.title,
            lines=self.lines,
            tables=[table for table in tables if table and table.rows],
            items=self.items,
            tones=TONES,
        )
        return str(page)


class ShownInNotebook:
    """A value that shows itself in Jupyter and other notebooks."""

    def _notebook_view(self) -> NotebookView:
        raise NotImplementedError

    def _repr_html_(self) -> str:
        """Return what a notebook shows, as HTML that loads nothing."""
        return self._notebook_view().html()

    def _views(self) -> dict[str, Callable[[], Any]]:
        """Return by MIME type what makes each view."""
        return {"text/plain": self.__repr__, "text/html": self._repr_html_}

    def _repr_mimebundle_(
        self, include: Collection[str] | None = None, exclude: Collection[str] | None = None
    ) -> dict[str, Any]:
        """Return the views of a notebook by MIME type, those that it asks for."""
        kinds = set(self._views())
        if include:
            kinds &= set(include)
        kinds -= set(exclude or ())
        return {kind: view() for kind, view in self._views().items() if kind in kinds}
