"""Pages from templates: text is escaped, markup of other templates is not, and nothing is left out silently."""

import json

import pytest
from jinja2 import UndefinedError

from ground import templates

FILES = {
    "outer.html": '{% from "macros.html" import bold %}<p title="{{ text }}">{{ bold(text) }}{{ part }}</p>',
    "macros.html": "{% macro bold(text) %}<b>{{ text }}</b>{% endmacro %}",
    "data.html": "<script>{{ data|tojson }}</script>",
    "plain.css": "a { color: {{ red }}; }",
}


@pytest.fixture
def package(tmp_path, monkeypatch):
    folder = tmp_path / "templates_of_a_test"
    folder.mkdir()
    (folder / "__init__.py").touch()
    for name, text in FILES.items():
        (folder / name).write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    return folder.name


def test_text_is_escaped_and_markup_is_not(package):
    part = templates.render_macro(package, "macros.html", "bold", "<i>")
    page = templates.render(package, "outer.html", text="\"'<&", part=part)
    assert page == ('<p title="&#34;&#39;&lt;&amp;"><b>&#34;&#39;&lt;&amp;</b><b>&lt;i&gt;</b></p>')
    assert type(str(page)) is str


def test_a_missing_value_is_an_error(package):
    with pytest.raises(UndefinedError, match="part"):
        templates.render(package, "outer.html", text="")


def test_data_cannot_end_its_script_and_holds_no_nan(package):
    data = {"b": "</script>", "a": [1.5, None]}
    page = templates.render(package, "data.html", data=data)
    inside = page.removeprefix("<script>").removesuffix("</script>")
    assert "<" not in inside
    assert json.loads(inside) == data
    with pytest.raises(ValueError, match="JSON"):
        templates.render(package, "data.html", data=float("nan"))


def test_a_style_sheet_is_taken_as_it_is(package):
    assert templates.asset(package, "plain.css") == FILES["plain.css"]
