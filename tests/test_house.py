"""The house rules on size: parameters of functions, lines of functions and files, files of folders.

What breaks a rule is listed by name and size, exactly: a listed offender that is mended, or gets worse, fails too.
"""

import ast
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("aspectgraph", "compiled", "errors", "ga", "planner", "benchmarks")
# a compiled loop has no keywords and no objects, so it may take more
MOST_PARAMETERS = 8
MOST_COMPILED = 10
MOST_LINES = 60
MOST_FILE_LINES = 500
MOST_FILES = 15

# public calls whose options have defaults and are given by keyword
PARAMETERS: dict[str, int] = {
    "errors/referee/montecarlo.py:simulate_success": 9,
    "errors/referee/twin.py:simulate_measurement": 10,
    "ga/run.py:maximize": 21,
    "planner/inspection.py:plan_inspection": 28,
    "planner/setting/plan_setting.py:plan_setting": 19,
    "planner/verify/simulate_setting.py:simulate_setting": 9,
}
FOLDERS: dict[str, int] = {}


def sources():
    return [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]


@cache
def nodes(text):
    """All of a file's tree: several rules look at it."""
    return list(ast.walk(ast.parse(text)))


def functions(text):
    """All functions of a file, nested ones and methods too."""
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
    return [node for node in nodes(text) if isinstance(node, kinds)]


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
    compilers = {
        "njit",
        "jit",
        "vectorize",
        "guvectorize",
        "cfunc",
        "entry_kernel",
        "kernel",
        "kernel_without_refcounts",
    }
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


def parallel_assignments(text):
    """Assignments of several values at once, but for swaps and updates whose values depend on each other."""
    found = []
    for node in nodes(text):
        if not isinstance(node, ast.Assign) or len(node.targets) != 1:
            continue
        pair = node.targets[0], node.value
        if not all(isinstance(side, ast.Tuple | ast.List) for side in pair):
            continue
        targets, values = (side.elts for side in pair)
        starred = any(isinstance(one, ast.Starred) for one in (*targets, *values))
        if starred or len(targets) != len(values):
            continue
        before = [ast.unparse(target) for target in targets]
        used = [{ast.unparse(part) for part in ast.walk(value)} for value in values]
        if not any(before[i] in used[j] for j in range(len(used)) for i in range(j)):
            found.append(ast.unparse(node))
    return found


@pytest.mark.parametrize(
    ("text", "n"),
    [
        ("a, b = 1, 2", 1),
        ("self.a, self.b = a, f(a)", 1),
        ("a, b = b, a", 0),
        ("a[0], a[1] = a[1], a[0]", 0),
        ("p, q = q, p + q", 0),
        ("a, b = f()", 0),
        ("a, *b = 1, 2, 3", 0),
        ("for a, b in ((1, 2),): pass", 0),
    ],
)
def test_the_scan_knows_swaps(text, n):
    assert len(parallel_assignments(text)) == n


def test_one_statement_a_line():
    paths = [*sources(), *sorted((ROOT / "tests").rglob("*.py"))]
    found = {str(path.relative_to(ROOT)): parallel_assignments(path.read_text()) for path in paths}
    assert {name: lines for name, lines in found.items() if lines} == {}


def test_no_conditional_expression_holds_another():
    found = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path in sources()
        for node in nodes(path.read_text())
        if isinstance(node, ast.IfExp)
        and any(isinstance(part, ast.IfExp) for part in ast.iter_child_nodes(node))
    ]
    assert found == []


def test_no_file_is_too_long():
    lines = {str(path.relative_to(ROOT)): len(path.read_text().splitlines()) for path in sources()}
    assert {name: n for name, n in lines.items() if n > MOST_FILE_LINES} == {}


def test_no_folder_has_too_many_files():
    files = {}
    for path in sources():
        folder = str(path.parent.relative_to(ROOT))
        files[folder] = files.get(folder, 0) + 1
    assert {folder: n for folder, n in files.items() if n > MOST_FILES} == FOLDERS
