"""Formulas of the documents as MathML, which browsers draw without a script: a hook of mkdocs.

Every formula is translated as a whole, or the build fails and names page and formula. What `latex2mathml` leaves to
attributes that browsers ignore, or sets too close, is put right here. Long names in code get places to break.
"""

from __future__ import annotations

import html
import re
import unicodedata

from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError

# what pymdownx.arithmatex makes of $...$ and $$...$$, with the punctuation after it
_FORMULA = re.compile(
    r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>([.,;:)]*)', re.DOTALL
)
_TAG = re.compile(r"\\tag\{([^}]*)\}")

# bars travel as private characters, so that the opening one is told from the closing one
_BARS = {r"\lvert": "\ue000", r"\rvert": "\ue001"}
_BAR = re.compile("<m[io]([^>]*)>([\ue000\ue001])</m[io]>")

# of `mathvariant` browsers know "normal" only; the characters exist in Unicode
_VARIANT = re.compile(r'<mi mathvariant="(bold|sans-serif|script|double-struck)">([A-Za-z])</mi>')
# names of more than one letter, such as cos and max; other text is mtext
_FUNCTION = re.compile(
    r'<m[io]( movablelimits="true")?>([A-Za-z]{2,})</m[io]>(?=(<mo stretchy="false">&#x00028;)?)'
)
# things that are taken for operations: the empty set, an angle
_THING = re.compile("<mo>(&#x0(?:2205|2220);)</mo>")

_LONGEST_OPTION = 32
_CODE = re.compile(r"(?<!<pre>)<code>([^<\n]+)</code>")


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
        If a command in it is not known, or it is two formulas without an empty line between them.
    """
    if "$" in latex:
        raise ValueError(
            f"formula {latex!r} has a dollar sign: formulas on lines of their own need an empty line between"
        )
    text = " ".join(latex.split())
    for command, character in _BARS.items():
        text = text.replace(command, f"{character} ")
    try:
        found = convert(text, display=display)
    except Exception as error:
        raise ValueError(f"formula {latex!r} cannot be translated: {error!r}") from error
    # a command that is not known is passed on with its backslash
    if unknown := re.search(r"\\[A-Za-z]+", found):
        raise ValueError(f"formula {latex!r} has an unknown command {unknown[0]}")
    for pattern, mended in ((_BAR, _bar), (_VARIANT, _letter), (_FUNCTION, _function)):
        found = pattern.sub(mended, found)
    found = _THING.sub(r"<mi>\1</mi>", found)
    # few fonts have the reverse solidus operator; the set minus is in most
    found = found.replace("<mi>&#x029F5;</mi>", "<mo>&#x02216;</mo>")
    # no space before the first
    return found.replace(
        '<mrow><mo form="prefix" lspace="0.17em"', '<mrow><mo form="prefix" lspace="0"'
    )


def _bar(match: re.Match) -> str:
    """Return a bar that belongs to what it encloses, instead of an operator between two things."""
    form = "prefix" if match[2] == _BARS[r"\lvert"] else "postfix"
    size = match[1] or ' stretchy="false"'
    return f'<mo{size} form="{form}" lspace="0" rspace="0">|</mo>'


def _letter(match: re.Match) -> str:
    """Return a letter of another alphabet as the character it is."""
    case = "CAPITAL" if match[2].isupper() else "SMALL"
    name = f"{match[1].upper()} {case} {match[2].upper()}"
    try:
        letter = unicodedata.lookup(f"MATHEMATICAL {name}")
    except KeyError:  # some are older than the block, such as the script B
        letter = unicodedata.lookup(name)
    return f'<mi mathvariant="normal">{letter}</mi>'


def _function(match: re.Match) -> str:
    """Return the name of a function with space around it, none before a bracket."""
    limits, name, bracket = match.groups(default="")
    return f'<mo{limits} form="prefix" lspace="0.17em" rspace="{"0" if bracket else "0.17em"}">{name}</mo>'


def _breakable(match: re.Match) -> str:
    """Return code that may be broken after a dot, a slash, a colon or an underscore; an option stays whole."""
    if match[1].startswith("--") and len(match[1]) <= _LONGEST_OPTION:
        return f'<code class="option">{match[1]}</code>'
    return f"<code>{re.sub(r'(?<=[./:_])(?=[A-Za-z])', '<wbr>', match[1])}</code>"


def translated(content: str) -> str:
    """Return a page with MathML in place of its formulas."""

    def one(match: re.Match) -> str:
        tag = match[1]
        latex = html.unescape(match[2])
        number = "".join(f'<span class="number">({name})</span>' for name in _TAG.findall(latex))
        formula = mathml(_TAG.sub("", latex), "block" if tag == "div" else "inline")
        # a full stop or comma stays with its formula
        return f'<{tag} class="formula">{formula}{number}{match[3]}</{tag}>'

    return _FORMULA.sub(one, content)


def breakable(html_page: str) -> str:
    """Return a page whose long names in code may be broken.

    Parameters
    ----------
    html_page : str
        After its words are in the search index, which would take a break for a space.
    """
    return _CODE.sub(_breakable, html_page)


def on_page_content(content: str, *, page, **_) -> str:
    """Translate a page that mkdocs has made."""
    try:
        return translated(content)
    except ValueError as error:
        raise PluginError(f"{page.file.src_path}: {error}") from error


def on_post_page(output: str, **_) -> str:
    """Let long names break in a finished page."""
    return breakable(output)
