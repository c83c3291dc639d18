"""The tools that test the tests: mutants that are what they say, samples that spread, tables that add up."""

import ast
import csv
from itertools import pairwise
from pathlib import Path

import coverage_table
import mutation
import pytest

TABLES = Path(__file__).resolve().parents[1] / "book" / "tables"


def table(name):
    with open(TABLES / f"{name}.csv", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def spoilt(expression):
    """Every way in which the top of an expression is spoilt, as source."""
    ways = len(list(mutation.changes(ast.parse(expression, mode="eval").body)))
    found = []
    for way in range(ways):
        node = ast.parse(expression, mode="eval").body
        list(mutation.changes(node))[way](node)
        found.append(ast.unparse(node))
    return found


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("a + b", ["a - b"]),
        ("a < b", ["a >= b"]),
        ("not a", ["+a"]),
        ("-a", ["+a"]),
        ("3", ["4", "-3"]),
        ("0", ["1"]),
        ("np.cos", ["np.sin"]),
        ("(a, b)", ["(b, a)"]),
        ("f(a, b)", ["f(b, a)"]),
        ("max(a, b)", []),  # the same either way round
        ("a", []),
        ("True", []),
        ("'text'", []),
    ],
)
def test_a_change_is_one_change(expression, expected):
    assert spoilt(expression) == expected


def test_a_mutant_differs_from_its_module_in_one_place_and_can_be_compiled():
    source = (mutation.ROOT / "pfslam" / "lattice.py").read_text(encoding="utf-8")
    plain = ast.unparse(ast.parse(source)).splitlines()
    places = mutation.places("lattice", None)
    for place in places:
        line, what, changed = mutation.mutant("lattice", None, *place)
        compile(changed, "lattice.py", "exec")
        assert sum(a != b for a, b in zip(plain, changed.splitlines(), strict=True)) == 1, what
        assert 1 <= line <= len(source.splitlines())
    assert len({mutation.mutant("lattice", None, *place)[2] for place in places}) == len(places)


def test_messages_annotations_and_docstrings_are_no_code():
    tree = ast.parse(
        'def f(a: int = 1) -> 2:\n    """3"""\n    if a > 4:\n        raise ValueError(5)\n    return 6'
    )
    numbers = [
        n.value for n in mutation.looked_at(tree, None) if isinstance(n, ast.Constant) and n.value != "3"
    ]
    assert numbers == [1, 4, 6]


@pytest.mark.parametrize(("count", "of"), [(1, 10), (3, 10), (9, 10), (300, 2204)])
def test_a_sample_is_spread_evenly(count, of):
    chosen = sorted(mutation.spread(count, of))
    assert len(chosen) == count
    assert set(chosen) <= set(range(of))
    steps = {b - a for a, b in pairwise(chosen)}
    assert steps <= {of // count, of // count + 1}


def test_a_sample_of_more_than_all_is_all():
    assert mutation.spread(20, 10) == mutation.spread(10, 10) == set(range(10))


def test_a_share_counts_lines_and_branches_together():
    counts = {"num_statements": 8, "num_branches": 2, "covered_lines": 7, "covered_branches": 1}
    assert coverage_table.row("m", counts) == ("m", 8, 2, 80.0)
    nothing = dict.fromkeys(counts, 0)
    assert coverage_table.row("empty", nothing)[-1] == 100.0


def test_a_module_below_its_floor_fails_and_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(coverage_table, "TABLE", tmp_path / "c.csv")
    good = {"num_statements": 98, "num_branches": 2, "covered_lines": 98, "covered_branches": 1}
    poor = good | {"covered_lines": 90}
    report = '{"files": {"pfslam/b.py": {"summary": %s}, "pfslam/a/c.py": {"summary": %s}}, "totals": %s}'
    for second, code in ((good, 0), (poor, 1)):
        (tmp_path / "core.json").write_text((report % (good, second, good)).replace("'", '"'))
        assert coverage_table.main(str(tmp_path / "core.json")) == code
    assert "too little: a/c" in capsys.readouterr().out
    assert (tmp_path / "c.csv").read_text() == (  # of the good one: the poor one is no table to keep
        "module,lines,branches,share\na/c,98,2,99.0\nb,98,2,99.0\nall,98,2,99.0\n"
    )


def test_the_stored_coverage_is_of_the_core_and_above_its_floors():
    rows = {row["module"]: float(row["share"]) for row in table("coverage")}
    package = mutation.ROOT / "pfslam"
    core = {
        path.relative_to(package).with_suffix("").as_posix()
        for path in package.rglob("*.py")
        if path.relative_to(package).parts[0] not in ("teaching", "bench")
    }
    assert rows.pop("all") >= coverage_table.ALL
    assert set(rows) <= core
    assert len(rows) > 0.9 * len(core)  # a new module is in it when it is made again
    assert min(rows.values()) >= coverage_table.EACH


@pytest.mark.parametrize(("name", "tried"), [("mutants", "mutants"), ("mutants_core", "tried")])
def test_the_stored_mutants_are_noticed(name, tried):
    rows = table(name)
    noticed, of = (sum(int(row[key]) for row in rows) for key in ("noticed", tried))
    assert 0.95 * of <= noticed <= of
