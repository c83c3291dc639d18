"""Which parts of a chapter a Story has, decided on small doctrees that are written by hand."""

import sys
from pathlib import Path

from docutils import nodes
from docutils.utils import new_document

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "book" / "_ext"))

import two_ways


def cell(*tags, shows="", prints=""):
    """A code cell of the doctree with its output."""
    output = nodes.container("", classes=["cell_output"])
    if shows:
        output += nodes.raw("", f'<img class="{shows}">', format="html")
    if prints:
        output += nodes.literal_block("", prints)
    code = nodes.container("", nodes.literal_block("", "x = 1"), classes=["cell_input"])
    parts = [code, output] if output.children else [code]
    return nodes.container("", *parts, classes=["cell", *(f"tag_{tag}" for tag in tags)])


def chapter(*parts, title="Weights"):
    """A doctree with one section."""
    tree = new_document("chapter")
    tree += nodes.section("", nodes.title("", title), *parts)
    return tree


def marked(*parts, title="Weights"):
    """The same with its classes."""
    tree = chapter(*parts, title=title)
    app = type("App", (), {"env": type("Env", (), {"docname": "notebooks/03_x"})})
    two_ways.mark(app, tree)
    return tree


def left_out(part):
    return "pfslam-workshop" in part["classes"]


def words(text, bold=""):
    found = nodes.paragraph(
        "", "", nodes.Text("")
    )  # MyST begins a paragraph of bold words with an empty text
    if bold:
        found += nodes.strong("", bold)
    found += nodes.Text(text)
    return found


def test_tags_of_cells_become_marks_at_their_place():
    source = {"cell_type": "markdown", "source": ["Words.\n", "\n", "### A proof\n", "\n", "More."]}
    both = {**source, "metadata": {"tags": ["aside"]}}
    assert two_ways.marked(both) == "Words.\n\n% aside\n\n### A proof\n\nMore."
    assert two_ways.marked({**source, "metadata": {}}) == "".join(source["source"])
    only = two_ways.marked({**source, "metadata": {"tags": ["workshop"]}})
    assert only.split("\n\n")[0] == "% two-ways begin"
    assert only.split("\n\n")[-1] == "% two-ways end"


def test_marks_fold_the_next_section_and_leave_out_what_is_between():
    tree, stays, goes = new_document("chapter"), words("stays"), words("goes")
    proof, rest = (nodes.section("", nodes.title("", title)) for title in ("A proof", "The rest"))
    whole = nodes.section("", nodes.title("", "Weights"), stays)
    whole += [nodes.comment("", "two-ways begin"), goes, nodes.comment("", "two-ways end"), words("last")]
    whole += [nodes.comment("", "aside"), proof, rest]
    tree += whole
    two_ways.follow_marks(tree)
    assert [section["classes"] for section in (whole, proof, rest)] == [[], ["pfslam-aside"], []]
    assert [left_out(part) for part in whole.findall(nodes.paragraph)] == [False, True, False]
    assert not list(tree.findall(nodes.comment))


def test_pictures_stay_without_code_and_what_code_prints_goes():
    picture, table, printed = cell(shows="pfslam-picture", prints="1 2"), cell(), cell(prints="0.5")
    table += nodes.table()
    kept, never = cell("story", prints="0.5"), cell("hide-cell", shows="pfslam-picture")
    tree = marked(words("Here."), picture, table, printed, kept, never)
    assert [left_out(part) for part in two_ways.cells(tree)] == [False, False, True, False, True]
    assert ["pfslam-result" in part["classes"] for part in (picture, table, kept)] == [True, True, False]
    assert left_out(list(picture.findall(nodes.literal_block))[1])


def test_what_the_text_makes_one_expect_stays():
    announced, other, answer = cell(prints="0.5"), cell(prints="0.7"), cell(prints="0.9")
    marked(words("It is:"), announced, other, words(" how many?", bold="Predict first:"), cell(), answer)
    assert [left_out(part) for part in (announced, other, answer)] == [False, True, False]


def test_a_question_goes_with_its_folded_answer_but_not_from_the_exercises():
    for title, gone in (("Weights", True), ("Test yourself", False)):
        before, question = words("Before."), words(" Which?", bold="1.")
        answer = nodes.admonition("", nodes.title("", "Answer"), classes=["dropdown"])
        tree = marked(before, question, answer, title=title)
        assert [left_out(part) for part in (before, question, answer)] == [False, gone, gone]
        assert ("pfslam-aside" in tree[0]["classes"]) != gone
