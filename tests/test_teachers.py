"""The open questions and their solutions: whole, kept apart, and their numbers found in another way."""

import importlib
import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from pencil import NUMBERS
from solutions import HERE, solutions

from pfslam.sensors import RobotModel
from pfslam.texture import to_world

ROOT = Path(__file__).resolve().parents[1]
CHAPTERS = sorted((ROOT / "notebooks").glob("*.ipynb"))
QUESTIONS = (ROOT / "book" / "questions.md").read_text(encoding="utf-8")
MEASURED = json.loads((HERE / "designs.json").read_text(encoding="utf-8"))


def parts(text: str, heading: str) -> dict[str, str]:
    """What stands below each heading of a chapter, by its two digits."""
    pieces = re.split(rf"^## {heading}(\d\d).*\n", text, flags=re.MULTILINE)[1:]
    return dict(zip(pieces[::2], pieces[1::2], strict=True))


def test_every_chapter_has_its_three_questions_a_solution_of_each_and_a_link():
    asked, answered = parts(QUESTIONS, "Chapter "), parts(solutions(), "")
    assert [*asked] == [*answered] == [path.stem[:2] for path in CHAPTERS]
    for text in asked.values():
        assert re.findall(r"^\*\*(Pencil|Design|Project)\b", text, re.MULTILINE) == [
            "Pencil",
            "Design",
            "Project",
        ]
    for text in answered.values():
        assert re.findall(r"^\*\*(\w+)\.\*\*", text, re.MULTILINE) == ["Pencil", "Design", "Project"]
    headings = re.findall(r"^## (Chapter .*)$", QUESTIONS, re.MULTILINE)
    for path, heading in zip(CHAPTERS, headings, strict=True):
        anchor = re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-")
        assert f"../book/questions.md#{anchor})" in path.read_text(encoding="utf-8")


def test_no_number_of_a_solution_is_without_its_place_and_no_place_without_its_number():
    words = (HERE / "solutions.md").read_text(encoding="utf-8")
    used = {(part, name) for part, name in re.findall(r"\{(\w+)\[(\w+)\]", words)}
    assert {part for part, _ in used} == set(NUMBERS) | set(MEASURED)
    designs = (HERE / "designs.py").read_text(encoding="utf-8")
    assert set(MEASURED) == set(re.findall(r"^def (d\d\d)\(", designs, re.MULTILINE))
    unused = {(part, name) for part, numbers in NUMBERS.items() for name in numbers} - used
    assert unused == set()


def test_they_are_not_in_the_site_nor_in_the_wheel():
    """The wheel's list of files is held by test_wheel, the copies are made of the notebooks alone."""
    settings = yaml.safe_load((ROOT / "_config.yml").read_text(encoding="utf-8"))
    assert settings["only_build_toc_files"]
    assert "teachers" in settings["exclude_patterns"]
    assert "teachers/" not in (ROOT / "_toc.yml").read_text(encoding="utf-8")
    for page in [*(ROOT / "book").glob("*.md"), *CHAPTERS]:
        assert "{include} ../teachers" not in page.read_text(encoding="utf-8")
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    written = [line.split()[-1] for line in makefile.splitlines() if "teachers/" in line]
    assert written == ["_build/solutions", "_build/exam", "_build/grade"]


# ---- the pencil's numbers, found in another way


def test_00_rounded_totals_are_off_by_less_than_a_count():
    totals = np.floor(np.arange(4800) * 0.97 * 0.025 / 0.0022 + 0.3)
    worst = np.abs(np.diff(totals) * 0.0022 / (0.97 * 0.025) - 1).max() * 100
    assert worst < NUMBERS["p00"]["percent"] < 1.1 * worst
    assert np.diff(totals).mean() == pytest.approx(NUMBERS["p00"]["counts"], rel=1e-4)
    assert NUMBERS["p00"]["window"] == pytest.approx(0.22 / 0.97)


def test_01_the_square_walked_corner_by_corner():
    x = y = heading = 0.0
    for _ in range(4):
        x, y = x + 10 * np.cos(heading), y + 10 * np.sin(heading)
        heading += np.deg2rad(90 / 1.03)
    assert np.hypot(x, y) == pytest.approx(NUMBERS["p01"]["gap"])
    assert 360 - np.rad2deg(heading) == pytest.approx(NUMBERS["p01"]["heading_deg"])
    assert np.deg2rad(NUMBERS["p01"]["heading_deg"]) / NUMBERS["p01"]["lap"] == pytest.approx(
        NUMBERS["p01"]["bias"]
    )


def long_run(clamp: int, steps: int = 400) -> float:
    """The share above zero of a clamped walk, by its table of moves taken many times."""
    n = 2 * clamp + 1
    moves = np.zeros((n, n))
    for k in range(n):
        moves[k, min(k + 1, n - 1)] += 0.6
        moves[k, max(k - 1, 0)] += 0.4
    return np.linalg.matrix_power(moves, steps)[0, clamp + 1 :].sum()


def test_02_the_clamped_walk():
    found = NUMBERS["p02"]
    assert long_run(2) == pytest.approx(found["two"], abs=1e-6)
    assert long_run(found["clamp"], 9000) == pytest.approx(found["at_clamp"], abs=1e-6)
    assert long_run(found["clamp"] - 1, 9000) < 0.99
    share = found["break_even_gentle"]
    assert share * 1 == pytest.approx((1 - share) * 0.1)


def test_03_particles_spread_sideways():
    rng, heading, side = np.random.default_rng(0), np.zeros(20_000), np.zeros(20_000)
    for _ in range(1000):
        side += 0.01 * 0.97 * heading
        heading += 0.01 * np.sqrt(0.02) * rng.standard_normal(len(heading))
    assert side.std() == pytest.approx(NUMBERS["p03"]["side"], rel=0.02)
    assert np.rad2deg(heading.std()) == pytest.approx(NUMBERS["p03"]["heading_deg"], rel=0.02)
    assert np.corrcoef(side, heading)[0, 1] == pytest.approx(NUMBERS["p03"]["correlation"], abs=0.01)
    left = side - np.polyval(np.polyfit(heading, side, 1), heading)
    assert left.std() == pytest.approx(NUMBERS["p03"]["given"], rel=0.03)


def test_04_beams_counted_in_the_cells_of_a_wall():
    angles = np.deg2rad(np.arange(0, 90, 0.25))
    x = np.tan(angles)  # where they meet a wall one metre aside
    gaps = np.diff(x)
    far = x[:-1][gaps > 0.05][0]
    assert far == pytest.approx(NUMBERS["p04"]["far"], abs=0.06)
    assert 100 * np.mean(x > far) == pytest.approx(NUMBERS["p04"]["beyond_percent"], abs=0.5)
    assert np.sum(x < 0.05) == pytest.approx(NUMBERS["p04"]["beside"], abs=1)
    assert np.log(NUMBERS["p04"]["ratio"]) == pytest.approx(54 * NUMBERS["p04"]["changed"] / 1081)


def test_05_lines_of_descent():
    rng, times, survived = np.random.default_rng(0), [], []
    for _ in range(300):
        line, time = np.arange(100), 0
        while len(set(line)) > 1:
            line = line[rng.integers(100, size=100)]
            time += 1
            survived += [len(set(line))] if time == 1 else []
        times.append(time)
    assert np.mean(survived) == pytest.approx(NUMBERS["p05"]["survive_percent"], abs=1)
    assert np.mean(times) == pytest.approx(NUMBERS["p05"]["one_left"], rel=0.1)


def test_06_rows_by_the_package_s_camera():
    camera, v = RobotModel().camera, np.arange(60.0, 480.0, 0.25)
    rays = np.column_stack([np.zeros_like(v), (v - camera.centre_v) / camera.focal_v, np.ones_like(v)])
    lens, ends = (to_world(points, np.zeros(3), camera) for points in (0 * rays, rays))
    x = lens[:, 0] + lens[:, 2] / (lens[:, 2] - ends[:, 2]) * (ends[:, 0] - lens[:, 0])
    near, far = NUMBERS["p06"]["one_row"] + camera.position_b[0] + np.array([-0.025, 0.025])
    row = np.interp([-far, -near], -x, v)
    assert row[1] - row[0] == pytest.approx(1, abs=0.02)


def test_07_coins_thrown():
    rng, found = np.random.default_rng(0), NUMBERS["p07"]
    fair = rng.binomial(20, 0.5, 200_000)
    assert np.mean((fair >= found["needed"]) | (fair <= 20 - found["needed"])) == pytest.approx(
        found["level"], abs=2e-3
    )
    assert 100 * np.mean(rng.binomial(20, 0.7, 200_000) >= found["needed"]) == pytest.approx(
        found["found_percent"], abs=0.5
    )
    assert np.mean(rng.binomial(found["buildings"], 0.7, 200_000) >= 32) == pytest.approx(0.83, abs=0.02)


def test_08_three_stretches_many_times():
    rng = np.random.default_rng(0)
    r = 0.002 * rng.standard_normal((3, 100_000))
    bias = -r[0] / 5
    scale = (r[1] + 4 * bias) / 6
    delay = (0.75 * scale - bias - r[2]) / 1.5
    found = NUMBERS["p08"]
    assert bias.std() == pytest.approx(found["bias"], rel=0.02)
    assert scale.std() == pytest.approx(found["scale"], rel=0.02)
    assert 1000 * delay.std() == pytest.approx(found["delay_ms"], rel=0.02)


def test_09_beams_that_meet_the_end_wall():
    angles = np.deg2rad(np.arange(-45, 45, 0.25) + 0.125)
    found = NUMBERS["p09"]
    assert np.sum(np.abs(20 * np.tan(angles)) < 1) == pytest.approx(found["ahead"], abs=1)
    assert found["along_mm"] / found["across_mm"] == pytest.approx(np.sqrt(1000 / found["ahead"]))
    assert found["along_honest_mm"] == pytest.approx(10 / np.sqrt(found["ahead"] * 0.054))


def test_10_poses_thrown_until_one_is_near():
    rng, found = np.random.default_rng(0), NUMBERS["p10"]
    near = rng.binomial(found["n"], np.pi / 16 / 300 / 36, 100_000)
    assert np.mean(near == 0) == pytest.approx(0.01, abs=0.002)
    assert near.mean() == pytest.approx(found["expected"], rel=0.01)
    assert found["half"] == pytest.approx(8 * found["n"], rel=1e-3)


def test_11_the_variance_after_many_looks():
    p = 1.0
    for _ in range(500):
        before = p + 1e-4
        p = before - before**2 / (before + 25e-4)
    found = NUMBERS["p11"]
    assert 100 * np.sqrt(p) == pytest.approx(found["sigma_cm"])
    assert (1 - found["gain"]) ** found["looks"] < 0.01 < (1 - found["gain"]) ** (found["looks"] - 1)


def test_12_the_chain_solved():
    n, s = 95, 0.02

    def worst(*ties: int) -> float:
        H = np.zeros((n + 1, n + 1))
        for i, j, w in [(k, k + 1, 1 / s**2) for k in range(n)] + [(0, k, 1e12) for k in ties]:
            H[np.ix_([i, j], [i, j])] += w * np.array([[1, -1], [-1, 1]])
        return 100 * np.sqrt(np.diag(np.linalg.inv(H[1:, 1:])).max())

    found = NUMBERS["p12"]
    assert worst() == pytest.approx(found["before_cm"], rel=1e-3)
    assert worst(n) == pytest.approx(found["middle_cm"], rel=1e-3)
    assert min(worst(n, k) for k in range(40, 56)) == pytest.approx(found["both_cm"], rel=0.01)


def test_13_a_wall_moved_by_each_fault():
    found, turn = NUMBERS["p13"], lambda a: np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    wall = np.array([10.0, 0.0])
    angles = (
        1.5 * found["clock_ms"] / 1000,
        np.deg2rad(found["yaw_deg"]),
        found["scale_percent"] / 100 * np.pi / 2,
    )
    moved = [np.linalg.norm(turn(a) @ wall - wall) for a in angles]
    moved.append(np.linalg.norm((turn(np.pi / 2) - np.eye(2)) @ [found["lever_cm"] / 100, 0]))
    assert moved == pytest.approx([0.05] * 4, rel=1e-3)


# ---- what was measured


@pytest.mark.slow
@pytest.mark.parametrize("name", ["d03", "d12"])
def test_some_of_the_measurements_again(name):
    assert getattr(importlib.import_module("designs"), name)() == pytest.approx(MEASURED[name], rel=0.02)
