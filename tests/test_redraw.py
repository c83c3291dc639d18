"""The table of redraw times: every widget that a notebook shows, every stop drawn as a move draws it."""

import nbformat
import numpy as np
import redraw

from pfslam.teaching.show.widgets import Explorer, Slider


def test_every_stop_is_drawn_as_a_move_draws_it():
    drawn, described = [], []

    def draw(level):
        drawn.append(level)
        return np.full((8, 12, 3), level, np.uint8)

    def alt(level):
        described.append(level)
        return f"A grey sheet, {level}"

    subject = Explorer(draw, [Slider("level", [10, 20, 30], start=1)], alt=alt, title="Grey")
    ms = redraw.move_ms(subject)
    assert ms.shape == (3,)
    assert (ms >= 0).all()
    assert drawn == described == [20, 10, 20, 30]


CELL = """import numpy as np
from pfslam.teaching.show.widgets import Explorer, Slider
draw = lambda level: np.full((8, 12, 3), level, np.uint8)
Explorer(draw, [Slider("level", range({0}))], alt="A sheet", title="Sheet of {0}")"""


def test_a_notebook_gives_one_line_for_each_widget_it_shows(tmp_path, capsys):
    cells = [nbformat.v4.new_code_cell(source) for source in (CELL.format(2), "1 + 1", CELL.format(5))]
    nbformat.write(nbformat.v4.new_notebook(cells=cells), tmp_path / "sheets.ipynb")
    redraw.main([str(tmp_path / "sheets.ipynb")])
    head, *lines = capsys.readouterr().out.splitlines()
    assert head.endswith("sheets")
    assert [line.split()[:4] for line in lines if line] == [["Sheet", "of", n, n] for n in ("2", "5")]
