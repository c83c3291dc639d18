"""The house rules: who may import whom, what stays out of the package, how long a file may be."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "pfslam"

# Each module imports only from those above it. A package (simulator, teaching) is one entry.
ORDER = [
    *(
        "errors",
        "limits",
        "interrupts",
        "poses",
        "sensors",
        "recording",
        "disturb",
        "motion",
        "grid",
        "particles",
    ),
    *("lattice", "boxes", "correlation"),
    *(
        "tilt",
        "config",
        "matching",
        "refinement",
        "events",
        "slam",
        "per_particle",
        "runs",
        "calibration",
        "checkup",
        "consistency",
    ),
    *(
        "floor",
        "texture_config",
        "floor_views",
        "texture",
        "metrics",
        "metrics_cloud",
        "metrics_texture",
    ),
    *("files", "images", "formats", "carmen_lines", "carmen", "course_writer", "course_format"),
    *(
        "simulator",
        "streams",
        "cache",
        "datasets",
        "study",
        "bench",
        "teaching",
        "summary",
        "commands",
        "__main__",
    ),
]
MODULES = sorted(PACKAGE.rglob("*.py"))
PLOTTING = {"matplotlib", "ipywidgets", "IPython", "PIL"}


def part(path):
    """The entry of ``ORDER`` that a file belongs to; the package's own __init__ belongs to none."""
    first = path.relative_to(PACKAGE).parts[0]
    return None if first == "__init__.py" else first.removesuffix(".py")


def imported(path):
    """Every module that a file imports, at its top or inside a function, as (dotted name, line)."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                yield ".".join(["pfslam", *path.relative_to(PACKAGE).parts[: -node.level]]), node.lineno
            elif node.module == "pfslam":
                yield from ((f"pfslam.{alias.name}", node.lineno) for alias in node.names)
            else:
                yield node.module, node.lineno


each_module = pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))


def test_every_module_has_its_place_in_the_order():
    assert {part(path) for path in MODULES} - {None} <= set(ORDER)


@each_module
def test_module_imports_only_from_those_above_it(path):
    if part(path) is None:
        return  # the package's own __init__ gathers what users call
    above = ORDER[: ORDER.index(part(path))]
    for name, line in imported(path):
        if name.startswith("pfslam."):
            used = name.split(".")[1]
            assert used == part(path) or used in above, f"{path.name}:{line} imports {name} from below"


@each_module
def test_plotting_stays_in_teaching_and_scipy_out(path):
    for name, line in imported(path):
        top = name.split(".")[0]
        assert top != "scipy", f"{path.name}:{line}"
        assert part(path) == "teaching" or top not in PLOTTING, f"{path.name}:{line} imports {name}"


GLOBAL_RANDOM = re.compile(
    r"np\.random\.(?!Generator\b|default_rng\b|SeedSequence\b|PCG64\b|Philox\b)\w+"
    r"|^import random|from random "
)


@each_module
def test_no_global_random_state_no_clock_in_results_and_no_pickles(path):
    source = path.read_text(encoding="utf-8")
    assert not GLOBAL_RANDOM.search(source)
    assert not re.search(r"allow_pickle\s*=\s*True|import pickle|np\.load\((?!.*allow_pickle=False)", source)
    assert not re.search(r"default_rng\(\s*\)", source), "a generator needs a seed"


@each_module
def test_files_are_short_enough_to_read(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 260


@each_module
def test_functions_are_short_enough_to_read(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef):
            assert node.end_lineno - node.lineno < 60, f"{path.name}: {node.name}"


@each_module
def test_public_names_say_what_they_are(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert ast.get_docstring(tree), f"{path.name} has no docstring"
    if part(path) in ("commands", "__main__"):
        return  # what the commands do is in their help
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith(("_", "main")):
            assert ast.get_docstring(node), f"{path.name}: {node.name} has no docstring"


def test_importing_the_package_brings_neither_plots_nor_scipy_nor_joblib():
    heavy = ["matplotlib", "scipy", "joblib", "IPython", "ipywidgets", "pandas"]
    code = f"import sys, pfslam; print(*[m for m in {heavy} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=PACKAGE.parent
    )
    assert done.stdout.split() == []
