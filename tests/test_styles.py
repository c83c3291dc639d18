"""The theme's style sheets, cut: what a page can show keeps its look."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def styles():
    sys.path.insert(0, str(ROOT / "book" / "_ext"))
    import styles

    yield styles
    sys.path.remove(str(ROOT / "book" / "_ext"))


@pytest.mark.parametrize(
    ("style", "kept"),
    [
        (".used{a:b}.idle{c:d}", ".used{a:b}"),
        (".used,.idle{a:b}", ".used{a:b}"),
        (".used .idle{a:b}", ""),
        ("p{a:b}[data-x]{c:d}", "p{a:b}[data-x]{c:d}"),
        (".used:not(.idle){a:b}", ".used:not(.idle){a:b}"),
        (":is(.idle,.used) p{a:b}", ":is(.idle,.used) p{a:b}"),
        ("@media print{.idle{a:b}}", ""),
        ("@media print{.idle{a:b}.used{c:d}}", "@media print{.used{c:d}}"),
        ("@font-face{src:url(x.woff)}", "@font-face{src:url(x.woff)}"),
        ("@keyframes turn{from{a:b}50.5%{a:c}to{a:d}}", "@keyframes turn{from{a:b}50.5%{a:c}to{a:d}}"),
        ("/*! a licence, of idle.org */.idle{a:b}/* none */p{c:d}", "/*! a licence, of idle.org */p{c:d}"),
    ],
)
def test_rules_for_classes_that_nobody_names_go(styles, style, kept):
    assert styles.cut_sheet(style, {"used"}) == kept


def test_a_class_that_only_a_script_names_is_known(styles, tmp_path):
    for name in styles.SHEETS:
        (tmp_path / "_static" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "_static" / name).write_text(".page{a:b}.script{a:b}.nobody{a:b}", encoding="utf-8")
    (tmp_path / "index.html").write_text('<p class="page">', encoding="utf-8")
    (tmp_path / "_static" / "open.js").write_text("e.classList.add('script')", encoding="utf-8")
    styles.cut_styles(tmp_path)
    assert (tmp_path / "_static" / styles.SHEETS[0]).read_text(encoding="utf-8") == ".page{a:b}.script{a:b}"
