"""Picking in a notebook: the picker page as a widget that holds what is clicked."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

from aspectgraph.exceptions import MissingExtraError, how_to_install
from planner.argument_kinds import check_kinds
from planner.request.dimension_files import wanted_of

if TYPE_CHECKING:
    from aspectgraph import Solid

_HEIGHT_PX = 640


def pick(solid: Solid) -> Any:
    """Show a part in a notebook, to pick its edges, rims and arcs with the mouse.

    The widget shows the page that ``aspectgraph info --picture`` writes. Names, tolerances and the
    share of them that is permitted as error are typed in it. Show the widget as the last line of a
    cell; another cell reads what is picked.

    Parameters
    ----------
    solid : Solid
        The part.

    Returns
    -------
    anywidget.AnyWidget
        A widget with these traits, which follow each click:

        * ``entities``, a dict from names to ids, such as ``{"front": 17, "bore": "r3"}``, and
        * ``dimensions``, a dict from names to `Dimension`. It is empty while the page refuses a
          tolerance.
        * ``fault`` is the page's sentence on what it refuses, otherwise empty.

        `plan_inspection` takes both dicts.

    Raises
    ------
    aspectgraph.MissingExtraError
        The package anywidget is not installed.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> from planner import pick
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> picker = pick(block)  # doctest: +SKIP
    >>> picker  # doctest: +SKIP
    >>> plan = plan_inspection(block, picker.entities, camera, uncertainty)  # doctest: +SKIP
    """
    from aspectgraph.plot.picker import picker_html

    check_kinds(solid=(solid, "Solid"))
    widget = _picker_class()
    return widget(page=picker_html(solid), part=solid.name, height_px=_HEIGHT_PX)


@cache
def _picker_class() -> Any:
    """Return the class of the widget; the package that it needs is an extra."""
    try:
        import anywidget
        import traitlets
    except ImportError as error:
        raise MissingExtraError(
            f"picking in a notebook needs the package anywidget. Got {error}; "
            f"{how_to_install('notebook')}"
        ) from error
    from ground.templates import asset

    class Picker(anywidget.AnyWidget):  # type: ignore[misc, unused-ignore]
        """A part of which edges, rims and arcs are picked."""

        _esm = str(asset("aspectgraph.plot", "page/widget.js"))
        page = traitlets.Unicode().tag(sync=True)
        height_px = traitlets.Int().tag(sync=True)
        # what the page said last
        picked = traitlets.Dict().tag(sync=True)
        part = traitlets.Unicode()
        entities = traitlets.Dict(read_only=True)
        dimensions = traitlets.Dict(read_only=True)
        fault = traitlets.Unicode(read_only=True)

        @traitlets.observe("picked")
        def _follow(self, change: Mapping[str, Any]) -> None:
            rows = change["new"].get("rows", ())
            entities, dimensions, fault = _content(rows)
            with self.hold_trait_notifications():
                self.set_trait("entities", entities)
                self.set_trait("dimensions", dimensions)
                self.set_trait("fault", fault)

        def __repr__(self) -> str:
            return f"<Picker of {self.part!r}: {len(self.entities)} picked>"

    return Picker


def _content(rows: Any) -> tuple[dict[str, Any], dict[str, Any], str]:
    """Return entities, dimensions and what is refused, of what the page has in its list."""
    from errors.measurands.measurand import kinds

    entities = {row["key"]: row["entity"] for row in rows}
    faults = [f"{row['key']}: {row['fault']}" for row in rows if row["fault"]]
    if faults:
        return entities, {}, faults[0]
    return entities, {row["key"]: wanted_of(row["key"], row["asked"], kinds()) for row in rows}, ""
