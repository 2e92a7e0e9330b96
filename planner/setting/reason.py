"""Why something is not inspected: a kind for programs, and a text for people."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum


class ReasonKind(Enum):
    """Kinds of reasons why a plan does not inspect an item. The values are those of the files."""

    UNOBSERVABLE = "unobservable"
    IN_VIEW_FROM_NO_POSE_TRIED = "in view from no pose tried"
    TOO_SHORT = "too short"
    OUT_OF_FOCUS = "out of focus"
    TOO_LARGE = "too large"
    OUT_OF_REACH = "out of reach"
    TOO_NEAR = "too near"
    NO_CORNER = "no corner"
    LINE_NEARBY = "line nearby"
    NO_FEASIBLE_VIEW = "no feasible view"
    PROBABILITY_TOO_LOW = "probability too low"
    NOT_FOUND_YET = "not found yet"
    NOT_STATED = "not stated"

    @property
    def words(self) -> str:
        """The kind in words."""
        return _WORDS.get(self, self.value)


_WORDS = {
    ReasonKind.IN_VIEW_FROM_NO_POSE_TRIED: "not in view from any tried pose",
    ReasonKind.TOO_SHORT: "too short for the resolution",
    ReasonKind.TOO_LARGE: "larger than the field of view",
    ReasonKind.TOO_NEAR: "in view only from too close to the part",
    ReasonKind.NO_CORNER: "no corner to measure to",
    ReasonKind.LINE_NEARBY: "too close to another line in the image",
    ReasonKind.NOT_FOUND_YET: "no view found yet",
    ReasonKind.NOT_STATED: "other reasons",
}


class Reason(str):
    """The text of a reason, with its kind.

    Parameters
    ----------
    text : str
        The whole sentence.
    kind : ReasonKind
        Kind of the reason. Default: that of a text from elsewhere, such as an older plan file.

    Examples
    --------
    >>> from planner import Reason, ReasonKind
    >>> reason = Reason.of(ReasonKind.OUT_OF_REACH, "the wall is in the way.")
    >>> print(reason)
    out of reach: the wall is in the way.
    >>> reason.kind
    <ReasonKind.OUT_OF_REACH: 'out of reach'>
    """

    kind: ReasonKind

    def __new__(cls, text: str, kind: ReasonKind = ReasonKind.NOT_STATED) -> Reason:
        """Make a text with a kind."""
        reason = super().__new__(cls, text)
        reason.kind = kind
        return reason

    @classmethod
    def of(cls, kind: ReasonKind, details: object) -> Reason:
        """Return the sentence "KIND: DETAILS".

        Parameters
        ----------
        kind : ReasonKind
            Its words begin the sentence.
        details : object
            The rest of it.

        Returns
        -------
        Reason
            The sentence with its kind.
        """
        return cls(f"{kind.words}: {details}", kind)


def kind_of(reason: str) -> ReasonKind:
    """Return the kind of a reason; a plain text states none."""
    return reason.kind if isinstance(reason, Reason) else ReasonKind.NOT_STATED


def kinds_record(reasons: Mapping[str, str]) -> dict[str, str]:
    """Return the values of the kinds that are stated, by name, as files hold them."""
    kinds = {name: kind_of(reason) for name, reason in reasons.items()}
    return {name: kind.value for name, kind in kinds.items() if kind is not ReasonKind.NOT_STATED}


def reasons_from(texts: Mapping[str, str], kinds: Mapping[str, str]) -> dict[str, Reason]:
    """Return reasons from the texts and kinds of a file; of what has no kind, none is stated."""
    stated = ReasonKind.NOT_STATED.value
    return {name: Reason(text, ReasonKind(kinds.get(name, stated))) for name, text in texts.items()}
