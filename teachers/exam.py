"""Write an exam paper and its key: `python teachers/exam.py SEED FOLDER`, or `make exam SEED=7`.

The seed chooses the questions and their numbers. A paper for the course has ten questions of chapters 00 to 06;
`--chapters` and `--questions` ask for others.
"""

import argparse
import tomllib
from collections.abc import Callable
from math import ceil, comb, cos, degrees, exp, floor, log, radians, sin, sqrt, tan
from pathlib import Path

import numpy as np

LEVELS = {"remember": 2, "apply": 4, "analyse": 6}
"""The points that a question of each level is worth."""
QUESTIONS = tomllib.loads(Path(__file__).with_name("exam.toml").read_text(encoding="utf-8"))
NUMBERS: dict[str, Callable] = {}
"""For each question with numbers the function that draws them and computes its answer."""
Rng = np.random.Generator


def numbers(make: Callable) -> Callable:
    """Register the function of the question whose name follows the q."""
    NUMBERS[make.__name__[1:]] = make
    return make


def among(rng: Rng, *values):
    """One of some values, as a plain number."""
    return values[int(rng.integers(len(values)))]


def binomial_tail(n: int, k: int) -> float:
    """The probability of ``k`` or more heads of ``n`` fair coins."""
    return sum(comb(n, i) for i in range(k, n + 1)) / 2**n


@numbers
def q00b(rng):
    seconds, counts = among(rng, 5, 10, 20), 50 * int(rng.integers(30, 90))
    way = counts * 0.0022
    return {
        "seconds": seconds,
        "counts": counts,
        "way": way,
        "speed": way / seconds,
        "each": counts / seconds / 40,
    }


@numbers
def q00c(rng):
    late, rate, far = among(rng, 20, 30, 50, 80), among(rng, 0.5, 1.0, 1.5), among(rng, 3, 4, 6, 8)
    angle = rate * late / 1000
    return {
        "late": late,
        "rate": rate,
        "range": far,
        "range_cm": among(rng, 5, 8, 10),
        "angle": degrees(angle),
        "moved": far * angle,
    }


@numbers
def q01b(rng):
    v, omega = among(rng, 0.5, 0.8, 1.0, 1.2), among(rng, 0.5, 0.8, 1.0, 1.5)
    x, y = v / omega * sin(omega), v / omega * (1 - cos(omega))
    return {"v": v, "omega": omega, "x": x, "y": y, "gap": sqrt((x - v) ** 2 + y**2)}


@numbers
def q01c(rng):
    bias, percent = among(rng, 0.001, 0.002, 0.004), among(rng, 1, 2, 3)
    seconds, turns = among(rng, 60, 120, 180), among(rng, 2, 3, 5)
    half = degrees(bias) * seconds / 2 + percent / 100 * 360 * turns
    return {
        "bias": bias,
        "percent": percent,
        "seconds": seconds,
        "turns": turns,
        "half": half,
        "end": degrees(bias) * seconds,
    }


@numbers
def q02b(rng):
    hits, crossed = int(rng.integers(2, 6)), int(rng.integers(1, 4))
    level, free = max(-2, min(hits, 2) - crossed), hits - crossed
    return {
        "hits": hits,
        "crossed": crossed,
        "level": level,
        "p": 4.0**level / (1 + 4.0**level),
        "free_level": free,
        "free_p": 4.0**free / (1 + 4.0**free),
    }


@numbers
def q02c(rng):
    clamp, part = among(rng, 2, 3, 5), among(rng, 2, 4, 10)
    scans = clamp * part + 1
    return {"clamp": clamp, "part": part, "scans": scans, "seconds": scans / 40}


@numbers
def q03b(rng):
    sigma, rate = among(rng, 0.02, 0.05, 0.1), among(rng, 40, 50, 100)
    seconds, fewer = among(rng, 30, 60, 120), among(rng, 2, 4, 10)
    spread = degrees(sigma * sqrt(seconds / rate))
    return {
        "sigma": sigma,
        "rate": rate,
        "seconds": seconds,
        "fewer": fewer,
        "spread": spread,
        "wider": spread * sqrt(fewer),
    }


@numbers
def q03c(rng):
    cells, doors = among(rng, 12, 15, 20), among(rng, 2, 3, 4)
    hit, false = among(rng, 0.7, 0.8, 0.9), among(rng, 0.05, 0.1, 0.2)
    each = hit / (doors * hit + (cells - doors) * false)
    return {"cells": cells, "doors": doors, "hit": hit, "false": false, "each": each, "all": doors * each}


@numbers
def q03e(rng):
    p = among(rng, 0.1, 0.2, 0.3, 0.7, 0.8)
    return {"p": p, "left": 2 * p, "right": 2 * (1 - p), "n_eff": 100 / (2 * (p**2 + (1 - p) ** 2))}


@numbers
def q04b(rng):
    a = int(rng.integers(700, 850))
    b, odds = a + int(rng.integers(5, 30)), among(rng, 2, 4, 8)
    return {
        "a": a,
        "b": b,
        "odds": odds,
        "by_count": b / a,
        "by_share": exp(54 * (b - a) / 1081),
        "by_beams": float(odds) ** (b - a),
    }


@numbers
def q04c(rng):
    turn, far = among(rng, 0.5, 1, 2, 3), among(rng, 5, 8, 12)
    angle = radians(turn)
    return {"degrees": turn, "range": far, "leaves": 0.05 / angle, "cells": far * angle / 0.05}


@numbers
def q05b(rng):
    n, w = among(rng, 50, 100, 200), among(rng, 0.05, 0.1, 0.2, 0.4)
    n_eff = 1 / (w**2 + (1 - w) ** 2 / (n - 1))
    yes = {True: "yes", False: "no"}
    return {"n": n, "w": w, "n_eff": n_eff, "half": yes[n_eff <= n / 2], "tenth": yes[n_eff <= n / 10]}


@numbers
def q05c(rng):
    cuts = np.sort(rng.choice(np.arange(2, 20), 3, replace=False))
    weights = np.diff([0, *cuts, 20]) / 20
    start = among(rng, 0.02, 0.08, 0.13, 0.18, 0.23)
    teeth = start + np.arange(4) / 4
    ancestors = np.searchsorted(np.cumsum(weights), teeth, side="right")
    named = {f"w{k}": float(w) for k, w in enumerate(weights)}
    return named | {
        "start": start,
        "ancestors": ", ".join(map(str, ancestors)),
        "copies": ", ".join(f"{4 * w:.1f}" for w in weights),
    }


@numbers
def q05e(rng):
    n = among(rng, 50, 100, 200)
    w = among(rng, 0.2, 0.5, 0.8) / n
    return {"n": n, "w": round(w, 5), "draws": (1 - w) ** n, "comb": 1 - n * w, "safe": 1 / n}


@numbers
def q06b(rng):
    d, step = 10 * int(rng.integers(40, 100)), among(rng, 1, 2, 5)
    z, next_z = (1.03 / (3.31 - 0.00304 * k) for k in (d, d + 1))
    return {
        "d": d,
        "step_cm": step,
        "z": z,
        "change_mm": 1000 * (next_z - z),
        "limit": sqrt(step / 100 * 1.03 / 0.00304),
    }


@numbers
def q06c(rng):
    error, x, tolerance = among(rng, 0.5, 1, 2), among(rng, 1, 2, 3), among(rng, 1, 2, 3)
    slope = tan(radians(error))
    return {
        "error": error,
        "x": x,
        "tolerance": tolerance,
        "height_cm": 100 * x * slope,
        "reach": tolerance / 100 / slope,
    }


@numbers
def q07b(rng):
    n = among(rng, 12, 16, 20, 25)
    k = ceil(n * among(rng, 0.65, 0.75, 0.85))
    p = min(1.0, 2 * binomial_tail(n, k))
    return {"k": k, "n": n, "p": p, "decided": "decided" if p <= 0.05 else "undecided"}


@numbers
def q07c(rng):
    n, wide, narrow = among(rng, 10, 12, 20), among(rng, 4, 6, 8), among(rng, 1, 2, 3)
    return {"n": n, "wide": wide, "narrow": narrow, "needed": ceil(n * (wide / narrow) ** 2)}


@numbers
def q08b(rng):
    rest, drift = among(rng, 5, 10, 20), among(rng, 0.2, 0.5, 1.0)
    turn, time = among(rng, 180, 360, 720), among(rng, 4, 8, 10)
    share = drift / rest * time
    parted = round(share + turn * among(rng, 0.01, 0.02, 0.03), 2)
    return {
        "rest": rest,
        "drift": drift,
        "turn": turn,
        "time": time,
        "parted": parted,
        "bias": drift / rest,
        "share": share,
        "scale": 100 * (parted - share) / turn,
    }


@numbers
def q08c(rng):
    far, shift, delay = among(rng, 4, 5, 8), among(rng, 2, 4, 6), among(rng, 0.01, 0.02, 0.04)
    w1, w2 = 0.5, among(rng, 1.0, 1.5)
    d1, d2 = (round(shift + 100 * far * w * delay, 1) for w in (w1, w2))
    slope = (d2 - d1) / (w2 - w1)
    return {
        "range": far,
        "w1": w1,
        "w2": w2,
        "d1": d1,
        "d2": d2,
        "delay_ms": 10 * slope / far,
        "shift": d1 - slope * w1,
    }


@numbers
def q09b(rng):
    angle, ax, ay = among(rng, 0, 30, 60, 90, 120), among(rng, 2, 4, 6), among(rng, -3, -1, 1, 3)
    nx, ny = cos(radians(angle)), sin(radians(angle))
    third = ny * ax - nx * ay
    return {
        "angle": angle,
        "ax": ax,
        "ay": ay,
        "nx": nx,
        "ny": ny,
        "third": third,
        "change_mm": 1000 * third * radians(1),
    }


@numbers
def q09c(rng):
    n, k, sigma = among(rng, 500, 800, 1000), among(rng, 5, 10, 20, 40), among(rng, 1, 2, 3)
    return {"n": n, "k": k, "sigma": sigma, "across": 10 * sigma / sqrt(n - k), "along": 10 * sigma / sqrt(k)}


@numbers
def q10b(rng):
    share, missed = among(rng, 1e-5, 2e-5, 5e-5, 1e-4), among(rng, 1, 2, 5)
    n = ceil(log(missed / 100) / log(1 - share))
    return {"share": f"{100 * share:g} %", "missed": missed, "n": n, "expected": n * share}


@numbers
def q10c(rng):
    n, k = among(rng, 100, 500, 1000), int(rng.integers(1, 6))
    return {"n": n, "k": k, "lost": (1 - k / n) ** n}


@numbers
def q11b(rng):
    m, P, R = among(rng, 2.0, 3.0, 5.0), among(rng, 0.5, 1.0, 2.0), among(rng, 0.25, 0.5, 1.0)
    z = m + among(rng, -0.8, -0.4, 0.4, 0.8)
    gain = P / (P + R)
    return {
        "m": m,
        "P": P,
        "z": round(z, 1),
        "R": R,
        "gain": gain,
        "mean": m + gain * (z - m),
        "var": (1 - gain) * P,
    }


@numbers
def q11c(rng):
    q, r = among(rng, 1, 2, 4), among(rng, 4, 9, 25)
    p = (-q + sqrt(q * q + 4 * q * r)) / 2
    return {"q": q, "r": r, "p": p, "left": (1 - p / r) ** 10}


@numbers
def q12b(rng):
    n, s, c, e = among(rng, 20, 50, 100), among(rng, 1, 2, 3), among(rng, 2, 5, 10), among(rng, 20, 40, 80)
    whole = n * s * s + c * c
    return {"n": n, "s": s, "c": c, "e": e, "each": e * s * s / whole, "left": e * c * c / whole}


@numbers
def q12c(rng):
    n, s = among(rng, 16, 36, 64, 100), among(rng, 1, 2, 3)
    return {"n": n, "s": s, "middle": s * sqrt(n / 2), "end": s * sqrt(n), "tied": s * sqrt(n) / 2}


@numbers
def q13b(rng):
    bits, ticks = among(rng, 8, 12, 16), among(rng, 455, 1000, 2000)
    full, step = 2**bits, int(rng.integers(20, 100))
    a = full - int(rng.integers(1, step))
    return {
        "bits": bits,
        "ticks": ticks,
        "a": a,
        "b": (a + step) % full,
        "wrap": full / ticks,
        "steps": step,
        "way_cm": 100 * step / ticks,
    }


@numbers
def q13c(rng):
    sweep, omega, v = among(rng, 25, 100, 167), among(rng, 0.5, 1.0, 1.5), among(rng, 0.5, 1.0)
    return {
        "sweep_ms": sweep,
        "omega": omega,
        "v": v,
        "bent": degrees(omega * sweep / 1000),
        "length_cm": 100 * v * sweep / 1000,
    }


def draw(seed: int, chapters: str = "00-06", questions: int = 10) -> list[tuple[str, dict]]:
    """Choose questions, three of ten of the level *remember* and three *analyse*, and fill in their numbers."""
    rng = np.random.default_rng(seed)
    first, last = chapters.split("-")
    names = [name for name in QUESTIONS if first <= name[:2] <= last]
    few = floor(0.3 * questions)
    wanted = {"remember": few, "apply": questions - 2 * few, "analyse": few}
    chosen = []
    for level, count in wanted.items():
        some = [name for name in names if QUESTIONS[name]["level"] == level]
        chosen += [some[k] for k in rng.permutation(len(some))[:count]]
    return [(name, filled(name, rng)) for name in sorted(chosen)]


def filled(name: str, rng: Rng) -> dict:
    """One question with its numbers: level, text, and what a full answer has."""
    question = QUESTIONS[name]
    values = NUMBERS[name](rng) if question.get("numbers") else {}
    full = [line.format(**values) for line in question["full"]]
    return {"level": question["level"], "text": question["text"].format(**values), "full": full}


def paper(seed: int, drawn: list[tuple[str, dict]], key: bool = False) -> str:
    """The paper in Markdown; with ``key`` what a full answer has stands below each question."""
    points = sum(LEVELS[question["level"]] for _, question in drawn)
    lines = [f"# Particle-filter SLAM: {'key to ' if key else ''}paper {seed}", "", f"{points} points.", ""]
    for number, (name, question) in enumerate(drawn, start=1):
        lines += [f"**{number}.** {question['text']} *({LEVELS[question['level']]} points)*", ""]
        if key:
            lines += [f"Chapter {name[:2]}, {question['level']}. A full answer has:", ""]
            lines += [f"- {line}" for line in question["full"]] + [""]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    """Write `paper_SEED.md` and `key_SEED.md`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seed", type=int)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--chapters", default="00-06", help="from and to, such as 07-13")
    parser.add_argument("--questions", type=int, default=10)
    options = parser.parse_args(arguments)
    drawn = draw(options.seed, options.chapters, options.questions)
    options.folder.mkdir(parents=True, exist_ok=True)
    for name, key in (("paper", False), ("key", True)):
        path = options.folder / f"{name}_{options.seed}.md"
        path.write_text(paper(options.seed, drawn, key), encoding="utf-8", newline="\n")
        print(path)


if __name__ == "__main__":
    main()
