"""The questions for exams: whole, with answers that another calculation finds, and a key that stays out of the site."""

import math
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from exam import LEVELS, NUMBERS, QUESTIONS, draw, filled, main, paper

ROOT = Path(__file__).resolve().parents[1]
SEEDS = range(30)


def values(name: str, seed: int) -> dict:
    return NUMBERS[name](np.random.default_rng(seed))


def test_sixty_questions_half_of_them_with_numbers_some_of_each_level_in_each_chapter():
    chapters = [path.stem[:2] for path in sorted((ROOT / "notebooks").glob("*.ipynb"))]
    assert len(QUESTIONS) == 60
    assert {name for name, question in QUESTIONS.items() if question.get("numbers")} == set(NUMBERS)
    assert len(NUMBERS) == 30
    for chapter in chapters:
        own = [question for name, question in QUESTIONS.items() if name[:2] == chapter]
        assert {question["level"] for question in own} == set(LEVELS)
        assert min(len(question["full"]) for question in own) >= 2
    assert {name[:2] for name in QUESTIONS} == set(chapters)


@pytest.mark.parametrize("name", sorted(NUMBERS))
def test_every_seed_gives_sane_numbers_and_seeds_differ(name):
    texts = set()
    for seed in SEEDS:
        drawn = values(name, seed)
        assert all(math.isfinite(v) for v in drawn.values() if not isinstance(v, str))
        question = filled(name, np.random.default_rng(seed))
        assert "{" not in question["text"] + "".join(question["full"])
        texts.add(question["text"])
    assert len(texts) > 3
    fields = set(re.findall(r"\{(\w+)", " ".join([QUESTIONS[name]["text"], *QUESTIONS[name]["full"]])))
    assert fields == set(values(name, 0))


class Least:
    """Draws the first of every choice, so that answers can be worked out once with a pocket calculator."""

    def integers(self, low, high=None):
        return 0 if high is None else low


BY_HAND = {
    "00b": {"counts": 1500, "way": 3.3, "speed": 0.66, "each": 7.5},
    "00c": {"late": 20, "angle": 0.573, "moved": 0.03},
    "01c": {"half": 8.919, "end": 3.438},
    "02c": {"scans": 5, "seconds": 0.125},
    "03b": {"spread": 0.992, "wider": 1.403},
    "03c": {"all": 0.736842},
    "03e": {"left": 0.2, "right": 1.8, "n_eff": 60.98},
    "04b": {"by_count": 1.00714, "by_share": 1.2837, "by_beams": 32},
    "04c": {"leaves": 5.73, "cells": 0.8727},
    "05b": {"n_eff": 47.804878},
    "05e": {"draws": 0.8184, "comb": 0.8, "safe": 0.02},
    "06b": {"d": 400, "z": 0.4919, "change_mm": 0.715, "limit": 1.841},
    "06c": {"height_cm": 0.8727, "reach": 1.1459},
    "07b": {"p": 0.38770},
    "07c": {"needed": 160},
    "08c": {"shift": 2.0, "delay_ms": 10.0},
    "09b": {"nx": 1, "ny": 0, "third": 3, "change_mm": 52.36},
    "09c": {"across": 0.4495, "along": 4.472},
    "10b": {"n": 460_515},
    "10c": {"lost": 0.36603},
    "11b": {"gain": 0.6667, "mean": 1.4667, "var": 0.1667},
    "12c": {"middle": 2.828, "end": 4, "tied": 2},
    "13c": {"bent": 0.716, "length_cm": 1.25},
}


@pytest.mark.parametrize("name", BY_HAND)
def test_answers_by_hand(name):
    found = NUMBERS[name](Least())
    assert {key: found[key] for key in BY_HAND[name]} == pytest.approx(BY_HAND[name], rel=1e-3)


@pytest.mark.parametrize("seed", SEEDS)
def test_answers_found_in_another_way(seed):
    v = values("01b", seed)
    arc = v["v"] * (np.exp(1j * v["omega"]) - 1) / (1j * v["omega"])
    assert (v["x"], v["y"]) == pytest.approx((arc.real, arc.imag))
    v = values("02b", seed)
    level = 0
    for step in [1] * v["hits"] + [-1] * v["crossed"]:
        level = max(-2, min(2, level + step))
    assert v["p"] == pytest.approx(1 / (1 + math.exp(-level * math.log(4))))
    v = values("05c", seed)
    shares = [v[f"w{k}"] for k in range(4)]
    drawn = [next(k for k in range(4) if v["start"] + tooth / 4 < sum(shares[: k + 1])) for tooth in range(4)]
    assert v["ancestors"] == ", ".join(map(str, drawn))
    v = values("08b", seed)
    assert v["bias"] * v["time"] + v["scale"] / 100 * v["turn"] == pytest.approx(v["parted"])
    v = values("11c", seed)
    assert 1 / v["p"] == pytest.approx(1 / (v["p"] + v["q"]) + 1 / v["r"])
    v = values("12b", seed)
    assert v["n"] * v["each"] + v["left"] == pytest.approx(v["e"])
    assert v["each"] / v["s"] ** 2 == pytest.approx(v["left"] / v["c"] ** 2)
    v = values("13b", seed)
    assert (v["a"] + v["steps"]) % 2 ** v["bits"] == v["b"]


def test_a_paper_another_paper_and_its_key(tmp_path):
    main(["1", str(tmp_path)])
    text, key = ((tmp_path / f"{name}_1.md").read_text(encoding="utf-8") for name in ("paper", "key"))
    assert len(re.findall(r"^\*\*\d+\.\*\*", text, re.MULTILINE)) == 10
    assert Counter(question["level"] for _, question in draw(1)) == {"remember": 3, "apply": 4, "analyse": 3}
    assert key.count("A full answer has:") == 10
    assert "A full answer" not in text
    assert "way: 3400 times 0.0022 m = 7.48 m" in dict(draw(0))["00b"]["full"]
    assert text == paper(1, draw(1)) != paper(2, draw(2))
    assert {name[:2] for name, _ in draw(3, "07-13", 12)} <= {f"{n:02d}" for n in range(7, 14)}


def test_the_specimen_is_a_paper_and_no_page_has_a_key():
    specimen = (ROOT / "book" / "specimen_paper.md").read_text(encoding="utf-8")
    assert specimen == paper(0, draw(0))
    for page in (ROOT / "book").glob("*.md"):
        assert "A full answer has:" not in page.read_text(encoding="utf-8")
