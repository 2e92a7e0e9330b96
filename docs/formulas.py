"""Formulas of the documents as MathML, which browsers draw without a script: a hook of mkdocs.

Every formula is translated as a whole, or the build fails and names page and formula.
"""

from __future__ import annotations

import html
import re

from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError

# what pymdownx.arithmatex makes of $...$ and $$...$$
_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
# latex2mathml knows \bigl| but not \bigl\lvert
_SIZED_BAR = re.compile(r"(\\[bB]igg?[lr])\\[lr]vert\b")


def mathml(latex: str, display: str = "inline") -> str:
    """Return a formula as MathML.

    Parameters
    ----------
    latex : str
        The formula without its dollar signs.
    display : {"inline", "block"}

    Raises
    ------
    ValueError
        If a command in it is not known.
    """
    latex = " ".join(latex.split())
    try:
        found = convert(_SIZED_BAR.sub(r"\1|", latex), display=display)
    except Exception as error:
        raise ValueError(f"formula {latex!r} cannot be translated: {error!r}") from error
    # a command that is not known is passed on with its backslash
    if unknown := re.search(r"\\[A-Za-z]+", found):
        raise ValueError(f"formula {latex!r} has an unknown command {unknown[0]}")
    return found


def translated(content: str) -> str:
    """Return a page with MathML in place of its formulas."""

    def one(match: re.Match) -> str:
        tag, latex = match[1], html.unescape(match[2])
        return f'<{tag} class="formula">{mathml(latex, "block" if tag == "div" else "inline")}</{tag}>'

    return _FORMULA.sub(one, content)


def on_page_content(content: str, *, page, **_) -> str:
    """Translate a page that mkdocs has made."""
    try:
        return translated(content)
    except ValueError as error:
        raise PluginError(f"{page.file.src_path}: {error}") from error
