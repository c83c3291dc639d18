"""Do the tests notice when an equation is wrong? One sign, operator, index or constant is changed at a time.

``make mutants`` makes every such change in the functions that are the report's equations, in a process of its own that
runs the module's unit tests until the first fails. A change that no test notices *survives*. The table is stored in
``book/tables/mutants.csv``; ``--only NAME`` looks at one function, ``--core`` at whole modules, ``--sample N`` at N
mutants, evenly spread over all.
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
LIMIT = 120
"""Seconds of processor time after which a mutant's tests are ended: a loop that no longer ends is noticed too."""

# Equations of the report, the module and the functions that are theirs, and the tests that should notice.
EQUATIONS = [
    ("1, 3, 5", "motion", ["motion_model", "motion_model_arc", "integrate"], ["test_motion"]),
    ("2", "metrics", ["slam_cost", "predicted_ranges"], ["test_metrics"]),
    ("4", "texture", ["project_floor"], ["test_texture"]),
    ("6, 8, 9", "correlation", ["map_correlation"], ["test_correlation"]),
    ("7", "sensors", ["scan_points", "scan_points_3d", "LidarModel"], ["test_sensors", "test_limits"]),
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
    ("core", "sensors", None, ["test_sensors", "test_limits"]),
    ("core", "motion", None, ["test_motion"]),
    ("core", "grid", None, ["test_grid"]),
    ("core", "particles", None, ["test_particles"]),
    ("core", "correlation", None, ["test_correlation"]),
    ("core", "matching", None, ["test_matching"]),
    ("core", "refinement", None, ["test_refinement"]),
    ("core", "metrics", None, ["test_metrics"]),
    ("core", "floor", None, ["test_floor"]),
    ("core", "lattice", None, ["test_correlation"]),
    ("core", "boxes", None, ["test_correlation"]),
    ("core", "tilt", None, ["test_tilt"]),
    ("core", "events", None, ["test_events"]),
    ("core", "slam", None, ["test_slam"]),
    ("core", "per_particle", None, ["test_per_particle"]),
    ("core", "runs", None, ["test_slam"]),
]
# What a module's own tests let through may be caught by those of the modules that use it.
USERS = ["test_slam", "test_refinement", "test_per_particle", "test_numerical_edge", "test_recording"]
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
    if isinstance(node, ast.Tuple) and len(node.elts) == 2 and len(set(map(ast.unparse, node.elts))) == 2:
        yield lambda n: n.elts.reverse()  # indices, coordinates, results the wrong way round
    if isinstance(node, ast.Call) and len(node.args) == 2 and not node.keywords and not _commutes(node):
        yield lambda n: n.args.reverse()


def _name(node: ast.Call) -> str:
    return ast.unparse(node.func).split(".")[-1]


def _commutes(node: ast.Call) -> bool:
    return _name(node) in ("min", "max", "minimum", "maximum", "isclose", "hypot")


def looked_at(tree: ast.Module, names: list[str] | None) -> Iterator[ast.AST]:
    """The nodes that may be spoilt: code of the named functions and classes (None: all), no messages, no docstrings."""
    for top in tree.body:
        if isinstance(top, ast.FunctionDef | ast.ClassDef) and (names is None or top.name in names):
            yield from _code(top)


def _code(node: ast.AST) -> Iterator[ast.AST]:
    """A node and all below it, in order; what an error says and what a type is called are no code.

    Nor are the ranges of settings: where a generous one ends is no result, and that each has one is a test of its own.
    """
    if isinstance(node, ast.Raise) or (isinstance(node, ast.Call) and _name(node) == "check_numbers"):
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


def places(module: str, names: list[str] | None) -> list[tuple[int, int]]:
    """Every mutant of a module, as the number of its node and the number of the way to spoil it."""
    tree = ast.parse((ROOT / "pfslam" / f"{module}.py").read_text(encoding="utf-8"))
    ways = [len(list(changes(node))) for node in looked_at(tree, names)]
    return [(at, way) for at, count in enumerate(ways) for way in range(count)]


def mutant(module: str, names: list[str] | None, at: int, way: int) -> tuple[int, str, str]:
    """One mutant of a module as (line, what was changed, source)."""
    tree = ast.parse((ROOT / "pfslam" / f"{module}.py").read_text(encoding="utf-8"))
    node = list(looked_at(tree, names))[at]
    before, line = ast.unparse(node), node.lineno
    list(changes(node))[way](node)
    return line, f"{before} -> {ast.unparse(node)}", ast.unparse(tree)


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
    import resource

    import pytest

    resource.setrlimit(resource.RLIMIT_CPU, (LIMIT, LIMIT))
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
    process.join()
    return process.exitcode != 0


def caught(module: str, source: str, tests: list[str]) -> bool:
    """Whether the module's own tests notice, or those of the modules that use it."""
    return noticed(module, source, tests) or noticed(module, source, USERS)


def spread(count: int, of: int) -> set[int]:
    """``count`` numbers below ``of``, evenly spread: the same ones every time."""
    return {k * of // count for k in range(count)} if count < of else set(range(of))


def judge(work: list, sample: int | None) -> list[tuple[str, str, int, int, int]]:
    """For each entry: equation, functions, mutants there are, those that were tried, those that were caught."""
    rows, before = [], 0
    made = [places(module, names) for _, module, names, _ in work]
    chosen = spread(sample or sys.maxsize, sum(map(len, made)))
    for (equation, module, names, tests), every in zip(work, made, strict=True):
        tried = [mutant(module, names, *place) for k, place in enumerate(every, before) if k in chosen]
        before += len(every)
        source = (ROOT / "pfslam" / f"{module}.py").read_text(encoding="utf-8")
        if noticed(module, source, tests):
            raise SystemExit(f"{module}: {', '.join(tests)} fail without any change")
        begun, missed = time.perf_counter(), 0
        with ThreadPoolExecutor(WORKERS) as pool:
            found = pool.map(lambda spoilt: caught(module, spoilt[2], tests), tried)  # noqa: B023
            for (line, what, _), seen in zip(tried, found, strict=True):
                if not seen and not nothing_changes(source.splitlines()[line - 1], what):
                    missed += 1
                    print(f"survived {module}.py:{line}: {what}", flush=True)
        rows.append((equation, " ".join(names or [module]), len(every), len(tried), len(tried) - missed))
        spent = time.perf_counter() - begun
        print(
            f"Eq. {equation}, {module}: {len(tried) - missed} of {len(tried)} noticed, {spent:.0f} s",
            flush=True,
        )
    return rows


# Changes that no test can notice, because no result changes: what is on the line, the change or its end, and why.
SAME = [
    ("array([lidar.position_b[:2]])", "2 -> 3", "two of three coordinates are used, whatever is handed over"),
    ("walking, at_once", "64 -> 65", "how many samples are looked at in one go"),
    ("walking, at_once", "64 -> -64", "the same: all in one go"),
    ("odometry, poses = dead", "reversed", "a difference of two motions, either way round"),
    ("for i in (0, 1))", "1 -> -1", "of two things, the second is the last"),
    ("len(nodes) // 2, 2:]", "2 -> 3", "how poses are parted, not what they score"),
    ("in chunks(len(counts)", "reversed", "how many at a time; the sums are exact in any order"),
    ("keys[:, :-1]", "-1 -> +1", "a cell twice instead of once with twice the weight"),
    ("gain = _gain(best / full_score", "best / full_score -> best * full_score", "the count needs no mean"),
    ("information, beams =", "", "replaced in the first round, of which there always is one"),
    ("reshape(3, -1)", "1 -> 2", "any negative number stands for the rest"),
    ("reshape(len(part), -1)", "1 -> 2", "the same"),
    ("reshape(len(who), len(counts), -1)", "1 -> 2", "the same"),
    ("cells = len(np.unique(", "", "what a box is thought to cost parts the poses and changes no score"),
    ("axis = int(np.argmax(extent", "", "where a box is cut, not what its poses score"),
    ("step = max(CACHE // size", "", "how many at a time; the sums are exact in any order"),
    ("parts = min(-(-len(order)", "", "how many at a time"),
    ("ptp(nodes, axis=0) + 1", "1 -> 2", "numbers further apart are different too"),
    ("thin = max(len(x) // 3000", "3000 -> -3000", "all points vote instead of a few thousand of them"),
    ('("bresenham", "polygon")', "reversed", "one of two, in any order"),
    ("extent = np.ptp(nodes", "", "what a box is thought to cost parts the poses and changes no score"),
    ("COST_PER_", "", "the same"),
    ("1e-9 * np.eye(3)", "1e-09 -> -1e-09", "so small that it only keeps the equations solvable, either way"),
    ("1e-9 * np.eye(3)", "- 1e-09 * np.eye(3)", "the same"),
    (
        "between(relative, between(",
        "estimate.at(t2)), relative)",
        "an error and its inverse are equally long",
    ),
    ("poses, true_poses = estimate.poses[known]", "reversed", "the same"),
    ("for n in (1, 2))", "2 -> 3", "what is computed again from further away is the same"),
    ("safe - 1e-6", "1e-06 -> 1.000001", "more are looked at than can win"),
    ("n = np.where(enough, n, 1.0)", "1.0 -> -1.0", "what stands there is not used"),
    ("np.median(elongation[found])", "1.0 -> -1.0", "the same"),
    ("np.hypot(0.5", "np.hypot(-0.5", "a length has no sign"),
    ("np.hypot(*(", "2 -> 3", "a third argument of hypot only says where the result goes"),
    ("directions[:, 0]", "reversed", "of two perpendicular axes, mirrored, rows and columns are the same"),
    ("if volume_is_cheaper(nodes, reach, cells) else 0", "0 -> 1", "the greater of it and a larger number"),
    ("max(box[:2]) > MAX_SIDE", "2 -> 3", "where a box is cut, not what its poses score"),
    ("if gaps.max() > 2 * reach[axis]", "", "the same"),
    ("points_l = np.stack(", "-1 -> +1", "the last of two axes"),
    ("for low, high in ((", "reversed", "which of two faults is named first"),
]


def nothing_changes(text: str, what: str) -> bool:
    """Whether a change on a line is one of ``SAME``; "reversed" is two things in the other order."""
    before, after = what.split(" -> ", 1)
    kind = "reversed" if before != after and sorted(before) == sorted(after) and "," in before else ""
    return any(part in text and (what.endswith(change) or change == kind) for part, change, _ in SAME)


def only(name: str | None, work: list) -> list:
    """The entries that name a function or module, for this name alone."""
    return [
        (equation, module, [name] if name and names else names, tests)
        for equation, module, names, tests in work
        if name is None or name in (names or [module])
    ]


def write(out: Path, rows: list, core: bool) -> None:
    """The table: by equation, or by module with how many of its mutants were tried."""
    if core:
        lines = [f"{module},{made},{tried},{seen},{seen}" for _, module, made, tried, seen in rows]
        head = (
            "module,mutants,tried,noticed,at_first"  # the last: before the survivors got tests of their own
        )
    else:
        lines = [f'"{equation}",{names},{tried},{seen}' for equation, names, _, tried, seen in rows]
        head = "equation,functions,mutants,noticed"
    out.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")


def main() -> int:
    """Make all mutants, print the survivors, write the table."""
    parser = argparse.ArgumentParser(description="Mutation testing of the equations.")
    parser.add_argument("--only", metavar="NAME", help="one function, or with --core one module")
    parser.add_argument("--core", action="store_true", help="whole core modules instead of the equations")
    parser.add_argument("--sample", type=int, metavar="N", help="N mutants, evenly spread, instead of all")
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    import cv2
    import hypothesis  # noqa: F401
    import numpy
    import pytest  # noqa: F401
    import scipy.stats  # noqa: F401

    cv2.setNumThreads(1)
    print("NumPy", numpy.__version__)
    rows = judge(only(arguments.only, CORE if arguments.core else EQUATIONS), arguments.sample)
    if arguments.out is not None:
        write(arguments.out, rows, arguments.core)
    tried, seen = sum(row[3] for row in rows), sum(row[4] for row in rows)
    error = 100 * (seen / tried * (1 - seen / tried) / tried) ** 0.5
    print(
        f"{seen} of {tried} noticed, {100 * seen / tried:.1f} % (standard error of a sample: {error:.1f} %)"
    )
    parts = [("all", tried, seen)] if arguments.sample else [(row[0], row[3], row[4]) for row in rows]
    missed = [name for name, some, found in parts if found < 0.95 * some]
    print("below 95 %: " + ", ".join(missed) if missed else "at least 95 % everywhere")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
