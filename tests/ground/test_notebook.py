"""What a notebook shows of a value: escaped, with colours that are read, and only what it asks for."""

from html.parser import HTMLParser

import pytest

from ground.notebook import TONES, NotebookTable, NotebookView, ShownInNotebook, Toned

NAME = '<script>"a" & b</script>'


class Texts(HTMLParser):
    def __init__(self, html):
        super().__init__()
        self.tags = []
        self.texts = []
        self.feed(html)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        assert {name for name, _ in attributes} <= {"style"}

    def handle_data(self, data):
        self.texts.append(data)


def test_every_text_is_escaped():
    table = NotebookTable((NAME, "n"), [(NAME, 3), (Toned(NAME, "bad"), 4)], right=(1,))
    view = NotebookView(NAME, (NAME, Toned(NAME, "good")), table, {NAME: NAME})
    page = Texts(view.html())
    assert "script" not in page.tags
    assert page.tags.count("tr") == 3
    assert "".join(page.texts).count(NAME) == 8
    assert page.texts.count("4") == 1


def test_a_table_without_headings_or_rows_has_none():
    assert "th" not in Texts(NotebookView("a", table=NotebookTable(("", ""), [(1, 2)])).html()).tags
    assert "table" not in Texts(NotebookView("a", table=NotebookTable(("x",), [])).html()).tags


def luminance(colour):
    """Relative luminance of a colour (WCAG 2.2)."""
    shares = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in shares]
    return sum(w * c for w, c in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


@pytest.mark.parametrize("tone", TONES)
@pytest.mark.parametrize("page", ["#ffffff", "#111111"])
def test_colours_are_read_on_light_and_on_dark_pages(tone, page):
    low, high = sorted(map(luminance, (TONES[tone], page)))
    assert (high + 0.05) / (low + 0.05) > 4


class Box(ShownInNotebook):
    n_asked = 0

    def __repr__(self):
        return "<Box>"

    def _notebook_view(self):
        self.n_asked += 1
        return NotebookView("Box")


@pytest.mark.parametrize(
    ("asked", "kinds", "n"),
    [
        ({}, {"text/plain", "text/html"}, 1),
        ({"include": ["text/plain"]}, {"text/plain"}, 0),
        ({"exclude": {"text/html"}}, {"text/plain"}, 0),
        ({"include": None, "exclude": None}, {"text/plain", "text/html"}, 1),
        ({"include": {"image/png"}}, set(), 0),
    ],
)
def test_only_what_the_notebook_asks_for_is_made(asked, kinds, n):
    box = Box()
    assert box._repr_mimebundle_(**asked).keys() == kinds
    assert box.n_asked == n
