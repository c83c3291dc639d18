"""Do the tests notice when an equation is wrong? One sign, operator, index or constant is changed at a time.

``make mutants`` makes every such change in the functions that are the report's equations, in a process of its own that
runs the module's unit tests until the first fails. A change that no test notices *survives*. The table is stored in
``book/tables/mutants.csv``; ``--only NAME`` looks at one function, ``--core`` at whole modules.
"""

import argparse
import ast
import importlib.abc
import importlib.util
import multiprocessing
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "book" / "tables" / "mutants.csv"
WORKERS = int(os.environ.get("WORKERS", "2"))
LIMIT = 120.0
"""Seconds after which a mutant's tests are ended: a loop that no longer ends is noticed too."""

# Equations of the report, the module and the functions that are theirs, and the tests that should notice.
EQUATIONS = [
    ("1, 3, 5", "motion", ["motion_model", "motion_model_arc", "integrate"], ["test_motion"]),
    ("2", "metrics", ["slam_cost", "predicted_ranges"], ["test_metrics"]),
    ("4", "texture", ["project_floor"], ["test_texture"]),
    ("6, 8, 9", "correlation", ["map_correlation"], ["test_correlation"]),
    ("7", "sensors", ["scan_points", "scan_points_3d", "LidarModel"], ["test_sensors"]),
    ("10", "particles", ["Particles", "log_sum_exp"], ["test_particles"]),
    ("11", "particles", ["predict"], ["test_particles"]),
    ("12", "particles", ["reweight"], ["test_particles"]),
    ("13", "particles", ["effective_sample_size"], ["test_particles"]),
    ("14", "grid", ["probability", "log_odds"], ["test_grid"]),
    ("15", "grid", ["integrate_scan", "free_cells", "trace_rays"], ["test_grid"]),
    ("16", "floor", ["associate_rgb", "inverse_depth"], ["test_floor"]),
    ("17", "floor", ["back_project", "depth_from_disparity"], ["test_floor"]),
    ("18", "floor", ["to_world"], ["test_floor"]),
    ("19", "motion", ["wheel_speed", "wheel_distance", "controls"], ["test_motion"]),
]
CORE = [
    ("core", "poses", None, ["test_poses"]),
    ("core", "sensors", None, ["test_sensors"]),
    ("core", "motion", None, ["test_motion"]),
    ("core", "grid", None, ["test_grid"]),
    ("core", "particles", None, ["test_particles"]),
    ("core", "correlation", None, ["test_correlation"]),
    ("core", "matching", None, ["test_matching"]),
    ("core", "refinement", None, ["test_refinement"]),
    ("core", "metrics", None, ["test_metrics"]),
    ("core", "floor", None, ["test_floor"]),
]
SWAPS = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Lt: ast.GtE,
    ast.LtE: ast.Gt,
    ast.Gt: ast.LtE,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
TWINS = {
    "cos": "sin",
    "sin": "cos",
    "minimum": "maximum",
    "maximum": "minimum",
    "floor": "ceil",
    "ceil": "floor",
}


def changes(node: ast.AST) -> Iterator:
    """Functions that each spoil ``node`` in one way, in place."""
    if isinstance(node, ast.BinOp | ast.AugAssign | ast.BoolOp) and type(node.op) in SWAPS:
        yield lambda n: setattr(n, "op", SWAPS[type(n.op)]())
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in SWAPS:
        yield lambda n: setattr(n, "ops", [SWAPS[type(n.ops[0])]()])
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not | ast.Invert):
        yield lambda n: setattr(n, "op", ast.UAdd())
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        yield lambda n: setattr(n, "value", n.value + 1)
        if node.value and not getattr(node, "is_index", False):  # of two things, the second is the last
            yield lambda n: setattr(n, "value", -n.value)
    if isinstance(node, ast.Attribute) and node.attr in TWINS:
        yield lambda n: setattr(n, "attr", TWINS[n.attr])
    if (
        isinstance(node, ast.Tuple) and len(node.elts) == 2
    ):  # indices, coordinates, results the wrong way round
        yield lambda n: n.elts.reverse()
    if isinstance(node, ast.Call) and len(node.args) == 2 and not node.keywords and not _commutes(node):
        yield lambda n: n.args.reverse()


def _commutes(node: ast.Call) -> bool:
    return ast.unparse(node.func).split(".")[-1] in ("min", "max", "minimum", "maximum", "isclose")


def looked_at(tree: ast.Module, names: list[str] | None) -> Iterator[ast.AST]:
    """The nodes that may be spoilt: code of the named functions and classes (None: all), no messages, no docstrings."""
    for top in tree.body:
        if isinstance(top, ast.FunctionDef | ast.ClassDef) and (names is None or top.name in names):
            yield from _code(top)


def _code(node: ast.AST) -> Iterator[ast.AST]:
    """A node and all below it, in order; what an error says and what a type is called are no code."""
    if isinstance(node, ast.Raise):
        return
    yield node
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list"):
            continue
        if name == "slice" or (name == "value" and getattr(node, "arg", None) == "axis"):
            for part in ast.walk(value):
                part.is_index = True
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _code(child)


def mutants(module: str, names: list[str] | None) -> Iterator[tuple[int, str, str]]:
    """Every mutant of a module as (line, what was changed, source)."""
    text = (ROOT / "pfslam" / f"{module}.py").read_text(encoding="utf-8")
    count = sum(1 for _ in looked_at(ast.parse(text), names))
    for at in range(count):
        which = 0
        while True:
            tree = ast.parse(text)
            node = list(looked_at(tree, names))[at]
            ways = list(changes(node))
            if which >= len(ways):
                break
            before, line = ast.unparse(node), node.lineno
            ways[which](node)
            after = ast.unparse(node)
            yield line, f"{before} -> {after}", ast.unparse(tree)
            which += 1


class Spoilt(importlib.abc.MetaPathFinder, importlib.abc.SourceLoader):
    """Imports one module from spoilt source."""

    def __init__(self, name: str, source: str):
        self.name, self.source = name, source
        self.path = str(ROOT.joinpath(*name.split(".")).with_suffix(".py"))

    def find_spec(self, fullname, path=None, target=None):
        return importlib.util.spec_from_loader(fullname, self) if fullname == self.name else None

    def get_filename(self, fullname):
        return self.path

    def get_data(self, path):
        return self.source.encode()


def trial(module: str, source: str, tests: list[str]) -> None:
    """Run the tests on the spoilt module; the process ends with 0 if none notices."""
    import pytest

    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"  # they take longer to load than the tests to run
    sys.meta_path.insert(0, Spoilt(f"pfslam.{module}", source))
    files = [str(ROOT / "tests" / f"{name}.py") for name in [*tests, "test_equation_values"]]
    options = ["-x", "-q", "-p", "no:cacheprovider", "--no-header", "--tb=no"]
    os._exit(int(pytest.main([*options, "-m", "not slow", *files])))


def noticed(module: str, source: str, tests: list[str]) -> bool:
    """Whether any test fails, or never ends, with this source in place of the module's."""
    process = multiprocessing.get_context("fork").Process(target=trial, args=(module, source, tests))
    process.start()
    process.join(LIMIT)
    if process.is_alive():
        process.kill()
        process.join()
        return True
    return process.exitcode != 0


def judge(work: list, only: str | None) -> list[tuple[str, str, int, int, list[str]]]:
    """For each entry: equation, functions, mutants, caught, and the survivors in words."""
    rows = []
    for equation, module, names, tests in work:
        if only and only not in (names or [module]):
            continue
        names = [only] if only and names else names
        source = (ROOT / "pfslam" / f"{module}.py").read_text(encoding="utf-8")
        if noticed(module, source, tests):
            raise SystemExit(f"{module}: {', '.join(tests)} fail without any change")
        begun, survivors = time.perf_counter(), []
        tried = list(mutants(module, names))
        with ThreadPoolExecutor(WORKERS) as pool:
            found = pool.map(lambda mutant: noticed(module, mutant[2], tests), tried)  # noqa: B023
            for (line, what, _), seen in zip(tried, found, strict=True):
                if not seen and f"{module}.py: {what}" not in SAME:
                    survivors.append(f"{module}.py:{line}: {what}")
                    print("survived", survivors[-1], flush=True)
        count = len(tried)
        rows.append((equation, " ".join(names or [module]), count, count - len(survivors), survivors))
        spent = time.perf_counter() - begun
        print(f"Eq. {equation}: {count - len(survivors)} of {count} noticed, {spent:.0f} s", flush=True)
    return rows


# Changes that no test can notice, because nothing changes.
SAME = {
    "metrics.py: 2 -> 3": "two of three coordinates are used, whatever is handed over",
    "metrics.py: 64 -> 65": "how many samples are looked at in one go",
    "metrics.py: 64 -> -64": "the same: all in one go",
    "metrics.py: (odometry, poses) -> (poses, odometry)": "a difference of two motions, either way round",
    "metrics.py: (dead_reckoning(recording).at(trajectory.t), trajectory.poses) -> "
    "(trajectory.poses, dead_reckoning(recording).at(trajectory.t))": "the same",
}


def main() -> int:
    """Make all mutants, print the survivors, write the table."""
    parser = argparse.ArgumentParser(description="Mutation testing of the equations.")
    parser.add_argument("--only", help="one function")
    parser.add_argument("--core", action="store_true", help="whole core modules instead of the equations")
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    import cv2
    import hypothesis  # noqa: F401
    import numpy
    import pytest  # noqa: F401
    import scipy.stats  # noqa: F401

    cv2.setNumThreads(1)
    print("NumPy", numpy.__version__)
    rows = judge(CORE if arguments.core else EQUATIONS, arguments.only)
    if arguments.out is not None:
        lines = [f'"{eq}",{names},{count},{caught}' for eq, names, count, caught, _ in rows]
        arguments.out.write_text(
            "\n".join(["equation,functions,mutants,noticed", *lines]) + "\n", encoding="utf-8"
        )
    missed = [eq for eq, _, count, caught, _ in rows if caught < 0.95 * count]
    print("below 95 %: " + ", ".join(missed) if missed else "at least 95 % everywhere")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
