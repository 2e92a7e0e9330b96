"""What a reader should look at first: targets that are not inspected, and warnings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

from planner.report.tables import setting_link, unbroken
from planner.report.wording import names_by_reason
from planner.setting.reason import ReasonKind, kind_of

if TYPE_CHECKING:
    from planner.rows.measured_rows import Row, WarningKind

FEW = 6
"""Up to this many warnings of a kind, or targets without a setting, are listed one by one at the head of the page."""


def attention(rows: Sequence[Sequence[Row]], unsharp: Sequence[int] = ()) -> str:
    """Return all warnings, by kind; nothing if there are none.

    Parameters
    ----------
    rows : sequence of sequence of Row
        The rows of each setting.
    unsharp : sequence of int
        Settings, from 1, in which displaced poses may be out of focus, see `may_be_unsharp`.
    """
    kinds: dict[WarningKind, list[tuple[Row, str]]] = {}
    for row in (row for setting in rows for row in setting):
        for warning in row.warnings:
            kinds.setdefault(warning.kind, []).append((row, warning.text))
    told = [line for kind, found in kinds.items() for line in _kind(kind, found)]
    if unsharp:
        which = ", ".join(map(setting_link, unsharp))
        told.append(
            f"<b>Narrow margin of focus</b> in setting{'s' * (len(unsharp) > 1)} {which}: a point is less than "
            "three standard deviations of its depth from a limit. --focus-margin-mm sets a larger margin"
        )
    if not told:
        return ""
    lines = "".join(f"<li>{one}</li>" for one in told)
    return f'<h2 id="look">Worth a look</h2><ul class="warnings">{lines}</ul>'


def _kind(kind: WarningKind, found: Sequence[tuple[Row, str]]) -> list[str]:
    """Return a line per warning if they are few, else one for all."""
    if len(found) <= FEW:
        return [
            f"<b>{escape(row.name)}</b> (setting {setting_link(row.setting)}): {escape(t)}"
            for row, t in found
        ]
    settings: dict[str, list[int]] = {}
    for row, _ in found:
        settings.setdefault(row.name, []).append(row.setting)
    names = ", ".join(
        f"{escape(name)} ({', '.join(map(setting_link, where))})"
        for name, where in settings.items()
    )
    return [f"<b>{escape(kind.value)}</b> in {len(found)} measurements: {names}"]


def not_inspected(reasons: Mapping[str, str], noun: str) -> str:
    """Return what is in no setting: each with its reason, or of many their number and names by kind of reason.

    Parameters
    ----------
    reasons : mapping of str to str
        By name; a `Reason` has a kind.
    noun : str
        What a target is called.
    """
    if not reasons:
        return ""
    head = '<h2 class="bad">Not inspected</h2>'
    if len(reasons) <= FEW:
        return head + _table(reasons, noun)
    kinds: dict[ReasonKind, list[str]] = {}
    for name, why in reasons.items():
        kinds.setdefault(kind_of(why), []).append(name)
    lines = "".join(
        f"<li><b>{escape(kind.words)}</b> ({len(names)}): {escape(', '.join(names))}</li>"
        for kind, names in kinds.items()
    )
    told = '<p class="note"><a href="#reasons">See the reason of each.</a></p>'
    return f'{head}{told}<ul class="warnings">{lines}</ul>'


def reasons_section(reasons: Mapping[str, str], noun: str) -> str:
    """Return why each is not inspected, if the head of the page only counts them; otherwise nothing.

    Parameters
    ----------
    reasons : mapping of str to str
        By name.
    noun : str
        What an item is called.
    """
    if len(reasons) <= FEW:
        return ""
    return f'<h2 id="reasons">Reasons for targets not inspected</h2>{_table(reasons, noun)}'


def _table(reasons: Mapping[str, str], noun: str) -> str:
    rows = "".join(
        f"<tr><td>{', '.join(map(unbroken, names))}</td><td>{escape(why)}</td></tr>"
        for why, names in names_by_reason(reasons).items()
    )
    head = f"<thead><tr><th>{noun.capitalize()}</th><th>Reason</th></tr></thead>"
    return f'<div class="scroll"><table>{head}<tbody>{rows}</tbody></table></div>'
