"""Change one operator, comparison or constant of a module at a time and see whether the tests of its room notice.

Loops run uncompiled, but for the predicates, which are made of instructions. Mutants are drawn with a seed; each runs
in a process of its own, in a copy of the repository. What survives is told with its line.

Usage: python benchmarks/mutants.py MODULE.py TEST.py [--mutants 40] [--seed 0] [--compiled]
"""

import argparse
import ast
import copy
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parent.parent
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


def mutants(text: str, n: int, seed: int) -> list[tuple[int, str]]:
    """Line and text of n mutants."""
    tree = ast.parse(text)
    sites = [k for k, node in enumerate(bodies(tree)) if changed(copy.deepcopy(node))]
    made = []
    for k in random.Random(seed).sample(sites, min(n, len(sites))):
        other = ast.parse(text)
        node = bodies(other)[k]
        changed(node)
        made.append((node.lineno, ast.unparse(ast.fix_missing_locations(other))))
    return made


def passes(folder: Path, tests: list[str], environment: dict[str, str], limit_s: float) -> bool:
    """Whether the tests notice nothing; a loop without end is noticed."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    with tempfile.TemporaryDirectory() as cache:
        try:
            done = subprocess.run(
                command,
                cwd=folder,
                env=environment | {"NUMBA_CACHE_DIR": cache},
                capture_output=True,
                timeout=limit_s,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return False
    return done.returncode == 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("module")
    parser.add_argument("tests", nargs="+")
    parser.add_argument("--mutants", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--compiled", action="store_true")
    options = parser.parse_args()
    source = (ROOT / options.module).read_text()
    lines = source.splitlines()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for name in ("aspectgraph", "errors", "ga", "planner", "tests", "examples"):
            shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(ROOT / "pyproject.toml", folder)
        environment = os.environ | {"PYTHONPATH": place, "PYTHONDONTWRITEBYTECODE": "1"}
        environment["NUMBA_DISABLE_JIT"] = "0" if options.compiled else "1"
        started = time.monotonic()
        if not passes(folder, options.tests, environment, 600.0):
            print("the tests must pass before anything is changed")
            return 2
        limit_s = 20.0 + 5.0 * (time.monotonic() - started)
        every = mutants(source, options.mutants, options.seed)
        survivors = 0
        for line, text in every:
            (folder / options.module).write_text(text)
            if passes(folder, options.tests, environment, limit_s):
                survivors += 1
                print(f"survived: {options.module}:{line}: {lines[line - 1].strip()}", flush=True)
    print(f"{options.module}: {len(every) - survivors} of {len(every)} mutants noticed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
