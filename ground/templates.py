"""Pages and pictures from templates beside the code: whatever no template made is escaped."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup


def render(package: str, template: str, **values: Any) -> Markup:
    """Return a filled template as markup, which other templates do not escape again.

    Parameters
    ----------
    package : str
        Name of the package that holds the template.
    template : str
        Path of the template in the package.
    **values : object
        What the template shows; text of them is escaped.
    """
    from markupsafe import Markup

    return Markup(_environment(package).get_template(template).render(values))


def render_macro(package: str, template: str, macro: str, *values: Any) -> Markup:
    """Return what a macro of a template makes of values, as markup.

    Parameters
    ----------
    package, template : str
        See `render`.
    macro : str
        Its name.
    *values : object
        What it takes.
    """
    from markupsafe import Markup

    module = _environment(package).get_template(template).module
    return Markup(getattr(module, macro)(*values))


def asset(package: str, path: str) -> Markup:
    """Return a script or style sheet of a package, which a template takes as it is.

    Parameters
    ----------
    package : str
        Name of the package.
    path : str
        Path of the file in the package.
    """
    from importlib import resources

    from markupsafe import Markup

    return Markup(resources.files(package).joinpath(path).read_text(encoding="utf-8"))


@cache
def _environment(package: str) -> Environment:
    # a command that makes no page does not wait for jinja2
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader(package, ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=False,
    )
    # inside a page, JSON has to be short, and no NaN, which no browser reads
    environment.policies["json.dumps_kwargs"] = {
        "sort_keys": True,
        "allow_nan": False,
        "separators": (",", ":"),
    }
    return environment
