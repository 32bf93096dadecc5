"""Change one thing of a module at a time, in memory, and see whether its tests notice.

    python tools/mutate.py uw_recon_ros.pairing test/test_pairing.py

Comparisons move their bound or turn round, ``and`` becomes ``or``, ``+`` becomes ``-``, conditions are negated, numbers
grow, calls for their effect are left out. Each change runs in a process of its own, forked before anything of the
package is loaded; no file is written. Printed are the changes that no test noticed: each is a test that is missing, a
line that is not needed, or a change that changes nothing (for a reader to say which).
"""

from __future__ import annotations

import argparse
import ast
import copy
import importlib.abc
import importlib.util
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, NamedTuple

ROOT = Path(__file__).parent.parent
LONGEST_S = 120  # of the tests of one change; what takes longer has no end
_COMPARE: dict[type, tuple[type, ...]] = {
    ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.LtE), ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,), ast.NotIn: (ast.In,),
}  # fmt: skip
_ARITHMETIC: dict[type, type] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip


class Change(NamedTuple):
    """One change: where, what was there, and what is there now."""

    line: int
    before: str
    after: str
    tree: ast.Module


def _set(name: str, value: Any) -> Callable[[Any], None]:
    return lambda node: setattr(node, name, value)


def _negate(node: Any) -> None:
    node.test = ast.UnaryOp(ast.Not(), node.test)


def _compare(position: int, kind: type) -> Callable[[Any], None]:
    return lambda node: node.ops.__setitem__(position, kind())


def edits(node: ast.AST) -> Iterator[Callable[[Any], None]]:
    """What may be changed of a node, in place."""
    if isinstance(node, ast.Compare):
        for position, op in enumerate(node.ops):
            yield from (_compare(position, kind) for kind in _COMPARE.get(type(op), ()))
    elif isinstance(node, (ast.BinOp, ast.AugAssign, ast.BoolOp)) and type(node.op) in _ARITHMETIC:
        yield _set("op", _ARITHMETIC[type(node.op)]())
    elif isinstance(node, (ast.If, ast.IfExp)):
        yield _negate
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield _set("value", not node.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
        yield _set("value", node.value + 1 if isinstance(node.value, int) else node.value * 2)
    elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        yield _set("value", ast.Constant(None))


def _left_alone(tree: ast.Module) -> set[int]:
    """Nodes that run nothing: annotations, decorators."""
    kept: list[ast.AST] = []
    for node in ast.walk(tree):
        kept += [part for name in ("annotation", "returns") if (part := getattr(node, name, None)) is not None]
        kept += getattr(node, "decorator_list", [])
    return {id(part) for node in kept for part in ast.walk(node)}


def changes(source: str) -> Iterator[Change]:
    """Every change of a module, one after the other."""
    tree = ast.parse(source)
    alone = _left_alone(tree)
    for place, node in enumerate(ast.walk(tree)):
        for number in range(0 if id(node) in alone else len(list(edits(node)))):
            other = copy.deepcopy(tree)
            changed = list(ast.walk(other))[place]
            before = ast.unparse(changed)
            list(edits(changed))[number](changed)
            ast.fix_missing_locations(other)
            yield Change(getattr(node, "lineno", 0), before, ast.unparse(changed), other)


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Gives one module its changed code."""

    def __init__(self, name: str, path: Path, code: CodeType) -> None:
        self.name, self.path, self.code = name, path, code

    def find_spec(self, name: str, path: Any, target: ModuleType | None = None) -> ModuleSpec | None:
        """Know that one module."""
        return importlib.util.spec_from_file_location(name, self.path, loader=self) if name == self.name else None

    def exec_module(self, module: ModuleType) -> None:
        """Run the changed code."""
        exec(self.code, module.__dict__)


def passes(name: str, path: Path, tree: ast.Module, tests: Sequence[str]) -> bool:
    """Whether the tests pass with this code for the module, in a process of their own."""
    child = os.fork()
    if child == 0:
        signal.alarm(LONGEST_S)
        silent = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silent, 1)
        os.dup2(silent, 2)
        import pytest

        sys.meta_path.insert(0, _Finder(name, path, compile(tree, str(path), "exec")))
        os._exit(int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", *tests])))
    return os.waitpid(child, 0)[1] == 0


def main() -> int:
    """Try every change; return the exit code: 1 where the tests fail unchanged."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("module", help="e.g. uw_recon_ros.pairing")
    parser.add_argument("tests", nargs="+", help="arguments for pytest: the tests that should notice")
    args = parser.parse_args()
    os.chdir(ROOT)
    os.environ |= {"CI": "1", "UW_RECON_KERNELS_READY": "1"}  # hypothesis with the same examples; see test/conftest.py
    path = ROOT.joinpath(*args.module.split(".")).with_suffix(".py")
    source = path.read_text(encoding="utf-8")
    for heavy in ("numpy", "cv2", "scipy", "numba", "pytest"):  # once, not in every process
        importlib.import_module(heavy)
    if not passes(args.module, path, ast.parse(source), args.tests):
        sys.stderr.write("mutate: expected tests that pass on the unchanged code; run them alone\n")
        return 1
    tried, survived = 0, 0
    for change in changes(source):
        tried += 1
        if passes(args.module, path, change.tree, args.tests):
            survived += 1
            sys.stdout.write(f"{path.relative_to(ROOT)}:{change.line}: {change.before[:90]}  ->  {change.after[:90]}\n")
            sys.stdout.flush()
    sys.stdout.write(f"{args.module}: {tried} changes, {tried - survived} noticed, {survived} not\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
