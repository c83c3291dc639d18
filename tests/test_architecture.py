"""The house rules: who may import whom, what stays out of the package, how long a function may be."""

import ast
import re
import subprocess
import sys
import tokenize
from graphlib import TopologicalSorter
from io import StringIO
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "pfslam"
BOOK = ROOT / "book" / "pfslam_book"

# Each module imports only from those above it. A wing (a folder) is one entry; within it there is no circle either.
ORDER = [
    "errors",
    "settings",
    "poses",
    "sensors",
    "recording",
    "motion",
    "events",
    "grid",
    "particles",
    "search",
    "correlation",
    "map",
    "methods",
    "run",
    "slam",
    "texture",
    "io",
    "simulator",
    "io.datasets",
    "refined",
    "beyond",
    "evaluation",
    "study",
    "cli",
    "__main__",
]
WINGS = ("refined", "beyond", "evaluation", "study", "cli")
MODULES = sorted(PACKAGE.rglob("*.py"))
BOOK_MODULES = sorted(BOOK.rglob("*.py"))
ROS_MODULES = sorted((ROOT / "pfslam_ros").rglob("*.py"))
PLOTTING = {"matplotlib", "ipywidgets", "IPython", "PIL", "pfslam_book"}


def label(path):
    return str(path.relative_to(ROOT))


def place(name):
    """Where in ``ORDER`` a dotted name below ``pfslam`` stands: at its longest prefix that is an entry."""
    parts = name.split(".")
    prefixes = [".".join(parts[:n]) for n in range(len(parts), 0, -1)]
    return next((ORDER.index(prefix) for prefix in prefixes if prefix in ORDER), None)


def module_name(path):
    """The dotted name of a file below ``pfslam``; a wing's own __init__ has the wing's."""
    return ".".join(path.relative_to(PACKAGE).with_suffix("").parts).removesuffix(".__init__")


def imported(path):
    """Every module that a file imports, at its top or inside a function, as (dotted name, line)."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                folder = [*path.relative_to(ROOT).parts[: -node.level]]
                yield ".".join([*folder, node.module or ""]).rstrip("."), node.lineno
            elif node.module == "pfslam":
                yield from ((f"pfslam.{alias.name}", node.lineno) for alias in node.names)
            else:
                yield node.module, node.lineno


def test_every_module_has_its_place_in_the_order():
    assert [m for m in map(module_name, MODULES) if place(m) is None and m != "__init__"] == []


def test_a_module_imports_only_from_those_above_it():
    wrong = []
    for path in MODULES:
        if (own := place(module_name(path))) is None:
            continue  # the package's own __init__ gathers what users call
        wrong += [
            f"{label(path)}:{line} imports {name} from below"
            for name, line in imported(path)
            if name.startswith("pfslam.") and (place(name.removeprefix("pfslam.")) or 0) > own
        ]
    assert not wrong


def file_of(name):
    """The file of a module of the package."""
    path = ROOT.joinpath(*name.split("."))
    return next((p for p in (path.with_suffix(".py"), path / "__init__.py") if p.is_file()), None)


def test_no_circle_of_imports():
    arrows = {path: {file_of(name) for name, _ in imported(path)} - {None, path} for path in MODULES}
    assert list(TopologicalSorter(arrows).static_order())  # raises CycleError


def test_no_chapter_imports_another_chapters_helpers():
    wrong = []
    for path in BOOK_MODULES:
        own = re.search(r"ch\d\d", label(path))  # show/ serves them all
        for name, line in imported(path):
            chapter = re.match(r"pfslam_book\.(?:exercises\.)?(ch\d\d)", name)
            if chapter and (own is None or chapter[1] != own[0]):
                wrong.append(f"{label(path)}:{line} imports {name}")
    assert not wrong


def test_the_book_imports_the_package_and_never_the_reverse():
    wrong = [
        f"{label(path)}:{line} imports {name}"
        for path in MODULES
        for name, line in imported(path)
        if name.split(".")[0] in PLOTTING and path.parent.name != "cli"
    ]
    assert not wrong


GLOBAL_RANDOM = re.compile(
    r"np\.random\.(?!Generator\b|default_rng\b|SeedSequence\b|PCG64\b|Philox\b)\w+"
    r"|^import random|from random "
)
PICKLES = re.compile(r"allow_pickle\s*=\s*True|import pickle|np\.load\((?!.*allow_pickle=False)")
NO_SEED = re.compile(r"default_rng\(\s*\)")


def test_no_global_random_state_no_generator_without_seed_and_no_pickles():
    rules = (GLOBAL_RANDOM, PICKLES, NO_SEED)
    sources = {label(path): path.read_text(encoding="utf-8") for path in MODULES + BOOK_MODULES + ROS_MODULES}
    assert not [(name, rule.pattern) for name, s in sources.items() for rule in rules if rule.search(s)]


def test_no_module_looks_outside_the_package():
    """``parents[2]`` of a file in a wing is the checkout, or whatever lies around an installed package."""
    wrong = []
    for path in MODULES:
        deepest = len(path.relative_to(PACKAGE).parts) - 1
        for number in re.findall(
            r"__file__\)(?:\.resolve\(\))?\.parents\[(\d+)\]", path.read_text(encoding="utf-8")
        ):
            if int(number) > deepest:
                wrong.append(f"{label(path)}: parents[{number}]")
    assert not wrong


def lines_of_code(path):
    """How many lines of a file hold code: no blank ones, no documentation, no comments."""
    source = path.read_text(encoding="utf-8")
    tokens = tokenize.generate_tokens(StringIO(source).readline)
    tokens = [t for t in tokens if t.string.strip() and t.type != tokenize.COMMENT]
    code = {line for token in tokens for line in range(token.start[0], token.end[0] + 1)}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(getattr(node.value, "value", None), str):
            code -= set(range(node.lineno, node.end_lineno + 1))
    return len(code)


@pytest.mark.parametrize(
    ("pattern", "most"),
    [
        ("**/*.py", 10024),
        ("*.py", 1500),
        ("beyond/loops/*.py", 265),
        ("io/bags.py", 338),
        ("io/topics.py", 184),
    ],
)
def test_what_is_to_be_read_stays_small(pattern, most):
    assert sum(map(lines_of_code, PACKAGE.glob(pattern))) <= most


def test_the_node_stays_small():
    assert sum(map(lines_of_code, ROS_MODULES)) <= 640


def test_helpers_of_the_book_stay_small():
    assert sum(map(lines_of_code, BOOK.rglob("*.py"))) <= 6249
    for exercises in (BOOK / "exercises").glob("ch*.py"):
        places = BOOK.glob(f"{exercises.stem}*")
        own = [file for place in places for file in (place.rglob("*.py") if place.is_dir() else [place])]
        most = 700 if exercises.stem == "ch08" else 450  # 08 has the table of faults
        assert sum(map(lines_of_code, [exercises, *own])) <= most, exercises.stem


def test_functions_are_short_enough_to_read():
    """``slam_step`` too, which is the algorithm of the report."""
    functions = [
        (f"{label(path)}: {node.name}", node.end_lineno - node.lineno + 1)
        for path in MODULES + ROS_MODULES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef)
    ]
    assert "pfslam/slam.py: slam_step" in dict(functions)
    assert [name for name, length in functions if length > 40] == []


def test_public_names_say_what_they_are():
    silent = []
    for path in MODULES + ROS_MODULES:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        nodes = [node for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)]
        public = [node for node in nodes if not node.name.startswith(("_", "main"))]
        if path.name not in ("commands.py", "__main__.py"):  # what the commands do is in their help
            silent += [f"{label(path)}: {node.name}" for node in public if not ast.get_docstring(node)]
    assert not silent


HELP = "runpy.run_module('pfslam', run_name='__main__')"
HEAVY = "numpy cv2 tqdm matplotlib scipy joblib IPython ipywidgets pandas"
RARE = "rosbags scipy joblib matplotlib pfslam.simulator pfslam.study"


@pytest.mark.parametrize(
    ("does", "left_out"),
    [(HELP, HEAVY), ("import pfslam.io.datasets, pfslam.cli.commands", RARE)],
    ids=["pfslam --help", "most commands"],
)
def test_what_starts_brings_nothing_that_it_does_not_need(does, left_out):
    code = f"""import contextlib, runpy, sys
sys.argv = ["pfslam", "--help"]
with contextlib.suppress(SystemExit):
    {does}
print(*[name for name in {left_out.split()} if name in sys.modules])"""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=PACKAGE.parent)
    assert ("usage: pfslam" in done.stdout) == (does == HELP)
    assert done.stdout.splitlines()[-1] == ""
