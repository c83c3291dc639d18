"""Exercise 3 of chapter 08 asks for names and not for a function: its hints, and the robots that it is about."""

import pytest
from pfslam_book.ch08.mystery import HIDDEN, MysteryRobot, mystery
from pfslam_book.exercises.ch08 import check_diagnosis

import pfslam

pytestmark = pytest.mark.slow

HEALTHY = {"delay [s]": 0.0, "lever [m]": 0.01, "turn ratio": 1.0, "cut scans": 0.0, "metres lost": 0.0}


@pytest.mark.parametrize(
    ("fault", "number", "answer", "words"),
    [
        ("clock", {"delay [s]": 0.14}, {"A": "lever arm"}, "lever [m] is 0.01"),
        ("clock", {"delay [s]": 0.14}, {"A": "healthy"}, "delay [s] first. Here it is 0.14"),
        ("healthy", {}, {"A": "clock"}, "delay [s] is 0.00"),
        (
            "track",
            {"turn ratio": 1.91},
            {"A": "clock"},
            "bends every fit that comes after it: look at its turn",
        ),
        ("renumbered beams", {"cut scans": 1.0}, {"A": "lever arm"}, "look at its cut scans first"),
        ("clock", {}, {"A": "bad luck"}, "none of"),
        ("clock", {}, {"B": "clock"}, "dictionary"),
        ("clock", {}, "clock", "dictionary"),
    ],
)
def test_a_wrong_diagnosis_is_told_the_number_that_rules_it_out(fault, number, answer, words):
    verdict = check_diagnosis(answer, [MysteryRobot("A", fault, HEALTHY | number, None)])
    assert verdict.verdict == "wrong"
    assert words in verdict.message


def test_each_robot_shows_its_own_fault():
    """The number that the hints point to is the one that stands out."""
    robots = mystery(pfslam.load("hall"), seed=1)
    stands_out = {
        "healthy": lambda n: abs(n["delay [s]"]) < 0.03 and abs(n["lever [m]"]) < 0.05,
        "clock": lambda n: abs(n["delay [s]"]) > 0.05,
        "lever arm": lambda n: abs(n["lever [m]"]) > 0.12,
        "track": lambda n: n["turn ratio"] > 1.5,
        "renumbered beams": lambda n: n["cut scans"] > 0.9,
        "lost second": lambda n: n["metres lost"] > 0.4,
    }
    assert set(stands_out) == set(HIDDEN)
    assert len({r.fault for r in robots}) == len(robots) == 4
    for r in robots:
        assert stands_out[r.fault](r.numbers), (r.fault, r.numbers)
        raw = [f for f in ("track", "renumbered beams", "lost second") if stands_out[f](r.numbers)]
        assert raw in ([], [r.fault])
