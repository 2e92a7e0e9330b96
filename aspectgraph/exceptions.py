"""Exceptions raised by :mod:`aspectgraph`; each also inherits the builtin one would expect."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from typing_extensions import Self


class AspectGraphError(Exception):
    """Base of every error this package raises on purpose.

    Attributes
    ----------
    parameter : str
        The parameter that breaks its rule, as a call has it; empty if the error is of none.
    rule : str
        The rule, beginning with its verb. Other parameters in it stand as ``{name}`` or ``{name=}``.
    got : str
        The value that breaks it.
    hint : str
        What helps, in the words of a call.
    shell_hint : str or None
        What helps, in the words of a shell; None: the same.
    mentions : tuple of str
        The other parameters in `rule`.
    place : str
        File or item in which that is, if the text begins with it.
    stem : str
        The text in front of a hint, where it is no rule.
    """

    parameter: str = ""
    rule: str = ""
    got: str = ""
    hint: str = ""
    shell_hint: str | None = None
    mentions: tuple[str, ...] = ()
    place: str = ""
    stem: str = ""

    def __reduce__(self) -> tuple[Any, ...]:
        """Keep the data when the error crosses a process boundary, with Dask's pickling, too."""
        return type(self), self.args, dict(vars(self))

    @classmethod
    def of_rule(
        cls,
        parameter: str,
        rule: str,
        got: str,
        *,
        hint: str = "",
        shell_hint: str | None = None,
        mentions: tuple[str, ...] = (),
    ) -> Self:
        """Return the error of a broken rule: "PARAMETER RULE. Got GOT; HINT.".

        Parameters
        ----------
        parameter, rule, got, hint : str
            See the attributes; without a parameter, the rule is the whole sentence.
        shell_hint : str, optional
            Default: as `hint`.
        mentions : tuple of str
            Other parameters in the rule.

        Returns
        -------
        AspectGraphError
            Of this class.
        """
        data = {
            "parameter": parameter,
            "rule": rule,
            "got": got,
            "hint": hint,
            "shell_hint": shell_hint,
            "mentions": mentions,
        }
        error = cls(_sentence(data, str, hint))
        vars(error).update(data)
        return error

    def for_shell(self, name_of: Callable[[str], str]) -> str:
        """Return the text for somebody at a shell.

        Parameters
        ----------
        name_of : callable
            Gives the option of a parameter.

        Returns
        -------
        str
            One or two sentences.
        """
        hint = self.hint if self.shell_hint is None else self.shell_hint
        if self.rule:
            text = _sentence(vars(self), name_of, hint)
        elif self.stem:
            text = f"{self.stem} {hint}."
        else:
            return str(self)
        return f"{self.place}: {text}" if self.place else text

    def within(self, place: object) -> Self:
        """Return the error with the file or item that it is in; it keeps its data.

        Parameters
        ----------
        place : object
            Named in front of the text.

        Returns
        -------
        AspectGraphError
            Of this class.
        """
        error = type(self)(f"{place}: {self}")
        vars(error).update(vars(self))
        error.place = f"{place}: {self.place}" if self.place else str(place)
        return error

    def with_hint(self, hint: str, shell_hint: str) -> Self:
        """Return an error that is of no rule, with a hint behind its text.

        Parameters
        ----------
        hint, shell_hint : str
            See the attributes; here a sentence without its full stop.

        Returns
        -------
        AspectGraphError
            Of this class.
        """
        error = type(self)(f"{self} {hint}.")
        vars(error).update(vars(self), stem=str(self), hint=hint, shell_hint=shell_hint)
        return error


def _sentence(data: Mapping[str, Any], name_of: Callable[[str], str], hint: str) -> str:
    """Return the text of a broken rule, its parameters named as somebody knows them."""
    rule = data["rule"]
    for name in data["mentions"]:
        shown = name_of(name)
        rule = rule.replace(f"{{{name}}}", shown)
        # a value follows: `gap_mm=1` of a call is `--gap-mm 1` at a shell
        rule = rule.replace(f"{{{name}=}}", f"{shown}=" if shown == name else f"{shown} ")
    parameter = data["parameter"]
    subject = f"{name_of(parameter)} " if parameter else ""
    if not hint:
        return f"{subject}{rule}. Got {data['got']}."
    # a hint is a sentence of its own if it begins like one
    mark = "." if hint[0].isupper() else ";"
    return f"{subject}{rule}. Got {data['got']}{mark} {hint}."


class SolidError(AspectGraphError, ValueError):
    """The vertices and faces given do not describe a valid solid."""


class OpenSolidError(SolidError):
    """An edge has a face on one side only: the surface has a hole."""


class NonManifoldError(SolidError):
    """An edge has more than two faces, or a vertex more than one fan of faces."""


class OrientationError(SolidError):
    """Faces disagree about which side is outside, or the whole is inside out."""


class PlanarityError(SolidError):
    """The vertices of a face do not lie in one plane."""


class SelfIntersectionError(SolidError):
    """Parts of the surface cross each other, or solids overlap."""


class TouchingError(SelfIntersectionError):
    """Parts of the surface that are not neighbours touch without crossing."""


class ResolutionError(SolidError):
    """Details of the part are too small for its grid: snapping could make one what is apart."""


class ReadError(AspectGraphError, ValueError):
    """A part file cannot be read, or does not hold what its name says."""


class PartFileNotFoundError(ReadError, FileNotFoundError):
    """There is no such part file."""


class MissingExtraError(ReadError, ImportError):
    """An optional package needed for this operation is not installed."""


class EntityError(AspectGraphError, ValueError):
    """An entity of interest is not a sharp straight edge of the solid."""


class WorkspaceError(AspectGraphError, ValueError):
    """The workspace is not a box around the solid, or a point lies outside it."""


class LightError(AspectGraphError, ValueError):
    """A lamp lies inside the part, or the contrast asked for is none."""


class GraphMLError(AspectGraphError, ValueError):
    """A graph cannot be written as GraphML without loss, or a GraphML file does not hold such a graph."""


class OutputError(AspectGraphError, OSError):
    """A file cannot be written."""


class PictureError(AspectGraphError, ValueError):
    """A picture cannot be made as asked."""


class WidthError(AspectGraphError, ValueError):
    """The width asked for is below what the part's own rounding leaves of a domain, or above the workspace's."""


class ContradictionError(AspectGraphError, ArithmeticError):
    """Ray casting and exact arbitration refute a viewing domain's list."""


class MemoryLimitError(AspectGraphError, MemoryError):
    """The work would take more memory than it may, or than there is."""
