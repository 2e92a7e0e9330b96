"""Change one operator, comparison or constant of a module at a time and see whether the tests of its room notice.

Loops run uncompiled, unless one asks for it. Mutants are drawn with a seed; each runs in a process of its own, in a
copy of the repository. What survives is told.

Usage: python benchmarks/running/mutants.py MODULE.py TEST.py [--mutants 40] [--seed 0] [--compiled]
"""

import argparse
import ast
import copy
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LIBRARIES = (
    "numba",
    "scipy.optimize",
    "scipy.integrate",
    "scipy.stats",
    "scipy.spatial",
    "networkx",
    "shapely",
    "hypothesis",
)
OTHER = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.And: ast.Or,
    ast.Or: ast.And,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
}


def changed(node: ast.AST) -> bool:
    """Change a node where it stands; False if there is nothing to change."""
    if isinstance(node, ast.Compare) and type(node.ops[0]) in OTHER:
        node.ops[0] = OTHER[type(node.ops[0])]()
    elif isinstance(node, ast.BinOp | ast.BoolOp | ast.AugAssign) and type(node.op) in OTHER:
        node.op = OTHER[type(node.op)]()
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        node.value = not node.value
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        node.value += 1
    elif isinstance(node, ast.If | ast.While):
        node.test = ast.UnaryOp(ast.Not(), node.test)
    else:
        return False
    return True


def bodies(tree: ast.AST) -> list[ast.AST]:
    """Nodes inside functions, without annotations, decorators and defaults."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    found = {id(node): node for one in functions for line in one.body for node in ast.walk(line)}
    return list(found.values())


def told(node: ast.AST) -> str:
    """What stands there, but for what an ``if`` or a loop holds."""
    return ast.unparse(node.test if isinstance(node, ast.If | ast.While) else node)


def mutants(text: str, n: int, seed: int) -> list[tuple[str, str]]:
    """What was changed, and the text, of n mutants."""
    tree = ast.parse(text)
    sites = [k for k, node in enumerate(bodies(tree)) if changed(copy.deepcopy(node))]
    made = []
    for k in random.Random(seed).sample(sites, min(n, len(sites))):
        other = ast.parse(text)
        node = bodies(other)[k]
        before = told(node)
        changed(node)
        ast.fix_missing_locations(other)
        made.append((f"{node.lineno}: {before} -> {told(node)}", ast.unparse(other)))
    return made


def passes(folder: Path, tests: list[str], limit_s: float) -> bool:
    """Whether the tests notice nothing; a loop without end is noticed.

    Libraries are loaded once, by the parent; the project itself is loaded anew by every child.
    """
    child = os.fork()
    if child == 0:
        try:
            os._exit(_tested(folder, tests))
        finally:
            os._exit(3)
    end = time.monotonic() + limit_s
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status) == 0
        time.sleep(0.05)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return False


def _tested(folder: Path, tests: list[str]) -> int:
    """Run the tests in the copy; in a process group of their own, so that what they start ends with them."""
    os.setpgid(0, 0)
    os.chdir(folder)
    # a loop compiled for one mutant must not answer for another
    import_module("numba").config.CACHE_DIR = tempfile.mkdtemp(dir=folder)
    sys.path.insert(0, str(folder))
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    os.dup2(silence, 2)
    return pytest.main(
        [
            "-x",
            "-q",
            "-p",
            "no:cacheprovider",
            "-W",
            "ignore::pytest.PytestAssertRewriteWarning",
            *tests,
        ]
    )


def main() -> int:
    """Try mutants of a module and print those that its tests overlook."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("module")
    parser.add_argument("tests", nargs="+")
    parser.add_argument("--mutants", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--compiled", action="store_true")
    options = parser.parse_args()
    source = (ROOT / options.module).read_text()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for name in ("aspectgraph", "ground", "errors", "ga", "planner", "tests", "examples"):
            shutil.copytree(
                ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__")
            )
        shutil.copy(ROOT / "pyproject.toml", folder)
        os.environ |= {"PYTHONPATH": place, "NUMBA_DISABLE_JIT": "0" if options.compiled else "1"}
        sys.dont_write_bytecode = True
        for name in LIBRARIES:
            import_module(name)
        started = time.monotonic()
        if not passes(folder, options.tests, 600.0):
            print("the tests must pass before anything is changed")
            return 2
        limit_s = 20.0 + 5.0 * (time.monotonic() - started)
        every = mutants(source, options.mutants, options.seed)
        survivors = 0
        for change, text in every:
            (folder / options.module).write_text(text)
            if passes(folder, options.tests, limit_s):
                survivors += 1
                print(f"survived: {options.module}:{change}", flush=True)
    print(f"{options.module}: {len(every) - survivors} of {len(every)} mutants noticed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
