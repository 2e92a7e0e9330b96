"""The house rules on size: parameters of functions, lines of functions and files, files of folders.

What breaks a rule is listed by name and size, exactly: a listed offender that is mended, or gets worse, fails too.
"""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("aspectgraph", "compiled", "errors", "ga", "planner", "benchmarks")
# a compiled loop has no keywords and no objects, so it may take more
MOST_PARAMETERS, MOST_COMPILED = 8, 10
MOST_LINES, MOST_FILE_LINES, MOST_FILES = 60, 500, 15

PARAMETERS: dict[str, int] = {}
FOLDERS: dict[str, int] = {}


def sources():
    return [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]


def functions(text):
    """All functions of a file, nested ones and methods too."""
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
    return [node for node in ast.walk(ast.parse(text)) if isinstance(node, kinds)]


def n_parameters(node):
    """Parameters that a caller gives: *args and **options count as one each, self and cls do not."""
    given = node.args
    names = [one.arg for one in (*given.posonlyargs, *given.args)]
    own = names[:1] in (["self"], ["cls"])
    return (
        len(names)
        - own
        + len(given.kwonlyargs)
        + (given.vararg is not None)
        + (given.kwarg is not None)
    )


def is_compiled(node):
    compilers = {"njit", "jit", "vectorize", "guvectorize", "cfunc", "compiled", "inner", "lean"}
    used = {
        part.attr if isinstance(part, ast.Attribute) else getattr(part, "id", "")
        for decorator in getattr(node, "decorator_list", [])
        for part in ast.walk(decorator)
    }
    return bool(compilers & used)


def n_lines(node):
    """Lines of a function without its docstring."""
    lines = node.end_lineno - node.lineno + 1
    if isinstance(node, ast.Lambda) or ast.get_docstring(node) is None:
        return lines
    return lines - (node.body[0].end_lineno - node.body[0].lineno + 1)


def found(measure, limit):
    """Functions whose measure is above their limit, by file and name."""
    over = {}
    for path in sources():
        for node in functions(path.read_text()):
            size = measure(node)
            if size > limit(node):
                over[f"{path.relative_to(ROOT)}:{getattr(node, 'name', 'lambda')}"] = size
    return over


@pytest.mark.parametrize(
    ("text", "parameters", "compiled"),
    [
        ("def f(a, /, b, *c, d, **e): pass", 5, False),
        ("class A:\n def f(self, a): pass", 1, False),
        ("@nb.njit(cache=True)\ndef f(a, b): pass", 2, True),
        ("@njit\ndef f(): pass", 0, True),
        ("f = lambda a, b: a", 2, False),
    ],
)
def test_the_scan_counts_as_a_reader_does(text, parameters, compiled):
    (node,) = functions(text)
    assert (n_parameters(node), is_compiled(node)) == (parameters, compiled)


def test_the_scan_leaves_docstrings_out():
    (node,) = functions('def f():\n    """One.\n\n    Two.\n    """\n    return 1\n')
    assert n_lines(node) == 2


def test_no_function_has_too_many_parameters():
    limit = {True: MOST_COMPILED, False: MOST_PARAMETERS}
    assert found(n_parameters, lambda node: limit[is_compiled(node)]) == PARAMETERS


def test_no_function_is_too_long():
    assert found(n_lines, lambda _: MOST_LINES) == {}


def test_no_file_is_too_long():
    lines = {str(path.relative_to(ROOT)): len(path.read_text().splitlines()) for path in sources()}
    assert {name: n for name, n in lines.items() if n > MOST_FILE_LINES} == {}


def test_no_folder_has_too_many_files():
    files = {}
    for path in sources():
        folder = str(path.parent.relative_to(ROOT))
        files[folder] = files.get(folder, 0) + 1
    assert {folder: n for folder, n in files.items() if n > MOST_FILES} == FOLDERS
