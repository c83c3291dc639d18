"""The page on how a teacher changes an exercise, taken at its word in a copy of the project."""

import doctest
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from copies import CHECK, EXERCISE, SOLUTION, exercises, expressions, source, write_copies

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "book" / "change_an_exercise.md").read_text(encoding="utf-8")
CHAPTER = "notebooks/01_dead_reckoning.ipynb"
CHECKS = "book/pfslam_book/exercises/ch01.py"


def blocks(language: str) -> list[str]:
    """What the page prints in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


(TEXT,) = blocks("markdown")
ANSWER, PART = blocks("python")
(TRIED,) = blocks("pycon")


def printed(command: str) -> list[str]:
    """The words of the one line of the page that begins with these."""
    lines = [line for block in blocks("sh") for line in block.splitlines()]
    (found,) = [shlex.split(line) for line in lines if line.startswith(command)]
    return found


@pytest.fixture(scope="module")
def changed(tmp_path_factory) -> Path:
    """A copy of the project in which somebody has done what the page says."""
    copy = tmp_path_factory.mktemp("changed")
    for name in ("book", "notebooks", "pfslam", "tests"):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__", "api"))
    shutil.copyfile(ROOT / "pyproject.toml", copy / "pyproject.toml")
    notebook = json.loads((copy / CHAPTER).read_text(encoding="utf-8"))
    (asked,) = [cell for cell in notebook["cells"] if "**Exercise 1.**" in source(cell)]
    asked["source"] = re.sub(r"\*\*Exercise 1\.\*\*.*", lambda _: TEXT.strip(), source(asked))
    exercises(notebook, SOLUTION)["1"]["source"] = ANSWER.strip()
    (copy / CHAPTER).write_text(json.dumps(notebook), encoding="utf-8")
    checks = (copy / CHECKS).read_text(encoding="utf-8")
    before, _, after = re.split(r"(^# ---- 1.*?)(?=^# ---- 2)", checks, flags=re.MULTILINE | re.DOTALL)
    (copy / CHECKS).write_text(before + PART + "\n" + after, encoding="utf-8")
    return copy


def run(folder: Path, *command) -> str:
    """What Python prints in the copy of the project, with the modules of that copy."""
    paths = [folder, folder / "book", folder / "book" / "_tools"]
    done = subprocess.run(
        [sys.executable, *map(str, command)],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(map(str, paths)), "PFSLAM_WIDGETS": "text"},
        capture_output=True,
        encoding="utf-8",
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow
def test_the_tests_pass_that_the_page_names(changed):
    _, *options = printed(".venv/bin/python")
    said = run(changed, *options, "-p", "no:cacheprovider", "-v")
    right = r"test_the_stub_is_unanswered_and_the_solution_right\[01-1\] PASSED"
    assert re.search(right, said)
    assert (
        len(re.findall(r"test_every_mistake_gets_its_own_words\[.*PASSED", said))
        == PART.count("lambda c, m") - 2
    )


@pytest.mark.slow
def test_the_check_says_what_the_page_says(changed):
    examples = doctest.DocTestParser().get_examples(TRIED)
    lines = [example.source for example in examples]
    asked = "".join(f"print({line.strip()})\n" if "check" in line else line for line in lines)
    assert run(changed, "-c", asked) == "".join(example.want for example in examples)


def test_copies_have_the_new_text_and_only_those_for_teachers_the_solution(changed):
    path = changed / CHAPTER
    numbers = ["1"] * len(expressions(json.loads(path.read_text(encoding="utf-8"))))
    write_copies(changed / "_build", [path], [numbers])
    for kind in ("student", "solutions"):
        copy = json.loads((changed / "_build" / kind / path.name).read_text(encoding="utf-8"))
        words = "\n".join(map(source, copy["cells"]))
        assert TEXT.strip() in words
        assert ("def distance_ahead_solution" in words) == (kind == "solutions")
        assert [exercises(copy, tag)["1"] for tag in (EXERCISE, CHECK)]


def test_checks_with_tests_of_their_own_are_found_as_the_page_says():
    """The name of a check is spelt here in two parts, so that this file does not count."""
    command, flag, name, _ = printed("grep")
    assert (command, flag) == ("grep", "-l")

    def files(name: str) -> list[str]:
        tests = (ROOT / "tests").glob("*.py")
        return sorted(path.name for path in tests if name in path.read_text(encoding="utf-8"))

    assert files(name) == []
    assert [f"tests/{file}" for file in files("check_" + "predict")] == ["tests/test_teaching_ch03.py"]
    assert "names `tests/test_teaching_ch03.py`" in PAGE


def test_the_exercise_within_a_check_has_the_name_that_the_page_says():
    from pfslam_book.exercises import ch03
    from pfslam_book.show.exercise import Exercise

    (inner,) = re.findall(r'`-k "(\w+) or 03-2"`', PAGE)
    assert isinstance(getattr(ch03, inner), Exercise)
    assert f"verdict = {inner}(" in (ROOT / "book/pfslam_book/exercises/ch03.py").read_text(encoding="utf-8")


def test_one_command_makes_copies_solutions_and_wheel():
    """The target that the page names waits for that which writes both kinds of copies."""
    rules = dict(
        re.findall(r"^([\w.-]+): *(.*)", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    )
    _, target = printed("make wheel")
    assert "copies" in rules[target].partition("##")[0].split()
    assert "##" in rules[target], "make help names it"
