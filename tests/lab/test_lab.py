"""Every chapter in JupyterLab: no pop-ups, runs from a fresh kernel to its last cell, reads right, moves at once.

The copies for students are read where the extension that knows MyST is switched off.
"""

import re

import pytest

pytestmark = pytest.mark.lab

MINUTE = 60_000
SHUT_DOWN = "() => window.jupyterapp.shell.currentWidget.sessionContext.shutdown()"
STATE = """() => {
  const app = window.jupyterapp, panel = app.shell.currentWidget, cells = panel.content.widgets;
  const code = cells.filter(c => c.model.type === 'code' && c.model.sharedModel.getSource().trim());
  const outputs = code.flatMap(c => c.model.outputs.toJSON());
  return {
    waiting: code.filter(c => c.model.executionCount === null || c.model.executionState === 'running').length,
    cells: code.length,
    errors: outputs.filter(o => o.output_type === 'error').map(o => o.ename + ': ' + o.evalue),
    kernel: panel.sessionContext.kernelDisplayStatus,
  };
}"""
DONE = (
    f"() => {{ const s = ({STATE})(); return s.errors.length || (s.kernel === 'idle' && s.waiting === 0); }}"
)
ALL_RENDERED = """() => window.jupyterapp.shell.currentWidget.content.widgets.every(
  c => c.model.type !== 'markdown' || c.node.querySelector('.jp-MarkdownOutput')?.textContent)"""
# Each sentence has the numbers that it asked the kernel for.
ALL_NUMBERS = """() => window.jupyterapp.shell.currentWidget.content.widgets.every(c =>
  c.model.type !== 'markdown' || c.model.sharedModel.getSource().split('{eval}`').length - 1
    === (c.model.getMetadata('user_expressions') ?? []).length)"""
# What the reader sees of each cell: its text without formulas, what stands folded in it, whether the cell is folded.
PROSE = """() => window.jupyterapp.shell.currentWidget.content.widgets.map(cell => {
  const meta = cell.model.sharedModel.getMetadata(), copy = cell.node.cloneNode(true);
  copy.querySelectorAll('.jp-Editor, .katex, mjx-container, svg, math').forEach(e => e.remove());
  return {
    type: cell.model.type, tags: meta.tags ?? [], source: cell.model.sharedModel.getSource(),
    text: cell.model.type === 'markdown' ? copy.textContent : '',
    open: [...cell.node.querySelectorAll('details')].map(d => d.open),
    numbers: (meta.user_expressions ?? []).map(e => e.result?.data?.['text/plain'] ?? 'no number'),
    folded: cell.inputHidden, silent: cell.outputHidden ?? false,
  };
})"""
# Markup that nothing has rendered, and the errors of a kernel that could not answer.
RAW = re.compile(r"\{(?:eval|eq|cite|doc|ref|numref|term|glue)[^}]*\}|\beq-\d|:::|\(eq-|\[\]\(|\w+Error:")
# Moves the first slider of each live widget: the kernel's processor time for a move and the time until the page shows
# the new picture, in ms. Both are printed; times on a shared machine are no test, so only a move that hangs fails.
MOVES = """async moves => {
  const kernel = window.jupyterapp.shell.currentWidget.sessionContext.session.kernel, all = {};
  const seconds = async () => {
    const asked = {t: '__import__("time").process_time()'};
    const reply = await kernel.requestExecute({code: '', user_expressions: asked}).done;
    return Number(reply.content.user_expressions.t.data['text/plain']);
  };
  for (const box of document.querySelectorAll('.jp-Notebook .widget-vbox:has(.noUi-handle)')) {
    const handle = box.querySelector('.noUi-handle'), picture = () => box.querySelector('img').src;
    const times = [], begin = await seconds();
    box.scrollIntoView();
    for (let k = 0; k < moves; k++) {
      const value = Number(handle.getAttribute('aria-valuenow')), end = Number(handle.getAttribute('aria-valuemax'));
      const key = value < end ? 'ArrowRight' : 'ArrowLeft', before = picture(), start = performance.now();
      handle.dispatchEvent(new KeyboardEvent('keydown', {key: key, bubbles: true}));
      while (picture() === before && performance.now() - start < 10000)
        await new Promise(done => setTimeout(done, 2));
      times.push(Math.round(performance.now() - start));
    }
    const work = Math.round(1000 * (await seconds() - begin) / moves);
    all[box.querySelector('b').textContent] = {work: work, shown: times};
  }
  return all;
}"""
# What the kernel says to an expression.
ASKED = """async expression => {
  const kernel = window.jupyterapp.shell.currentWidget.sessionContext.session.kernel;
  const reply = await kernel.requestExecute({code: '', user_expressions: {it: expression}}).done;
  return reply.content.user_expressions.it.data['text/plain'];
}"""
HANGS = 3_000  # ms of processor time


@pytest.fixture
def opened(lab, chromium, chapter):
    """One chapter, open in JupyterLab, and the requests that went elsewhere."""
    context = chromium.new_context(viewport={"width": 1400, "height": 1000})
    page, strangers = context.new_page(), []
    page.on(
        "request",
        lambda r: (
            r.url.startswith((lab, lab.replace("http", "ws"), "data:", "blob:")) or strangers.append(r.url)
        ),
    )
    page.goto(f"{lab}lab/tree/{chapter}?reset", wait_until="load")
    page.wait_for_selector(".jp-Notebook .jp-Cell", timeout=MINUTE)
    page.wait_for_function(
        "() => window.jupyterapp?.shell.currentWidget?.sessionContext?.kernelDisplayStatus === 'idle'",
        timeout=MINUTE,
    )
    yield page, strangers
    page.evaluate(SHUT_DOWN)
    context.close()


def pop_ups(page) -> list[str]:
    return page.locator(".jp-Dialog, .Toastify__toast, .jp-toast").all_text_contents()


def restart_and_run_all(page) -> dict:
    """What the menu entry does, its question answered with the button that says restart; the state at the end."""
    page.evaluate("() => { window.jupyterapp.commands.execute('notebook:restart-run-all'); }")
    page.locator(".jp-Dialog button.jp-mod-warn").click()
    page.wait_for_function(DONE, timeout=10 * MINUTE, polling=250)
    return page.evaluate(STATE)


def assert_it_reads_right(cells: list[dict]) -> None:
    """No markup is left to see, and what should be folded is."""
    for cell in cells:
        assert not RAW.search(cell["text"]), RAW.search(cell["text"])
        asked = cell["source"].count(":class: dropdown") + cell["source"].count("<details>")
        assert cell["open"] == asked * [False], cell["source"]
        folded = bool({"hide-cell", "hide-input", "remove-input"} & set(cell["tags"]))
        assert cell["type"] != "code" or cell["folded"] == folded, cell["source"]
    assert any(cell["open"] for cell in cells), "no answer was found"
    assert any(cell["folded"] for cell in cells), "no cell is folded"


def numbers_in_their_sentences(page) -> list[dict]:
    """The cells once every number stands in its sentence: the page is drawn a moment after the kernel has answered."""
    for _ in range(50):
        cells = page.evaluate(PROSE)
        if all(number.strip("'\"") in cell["text"] for cell in cells for number in cell["numbers"]):
            break
        page.wait_for_timeout(200)
    return cells


def test_chapter_runs_in_jupyterlab_and_its_widgets_redraw_in_time(opened, chapter):
    page, strangers = opened
    assert pop_ups(page) == []
    solutions = [cell for cell in page.evaluate(PROSE) if "hide-cell" in cell["tags"]]
    assert solutions
    assert all(cell["folded"] and cell["silent"] for cell in solutions)
    state = restart_and_run_all(page)
    assert state["errors"] == []
    assert state["cells"] > 5
    assert pop_ups(page) == []
    page.wait_for_function(ALL_NUMBERS, timeout=MINUTE)
    cells = numbers_in_their_sentences(page)
    assert_it_reads_right(cells)
    for cell in cells:
        for number in cell["numbers"]:
            assert number.strip("'\"") in cell["text"], cell["source"]
    moves = page.evaluate(MOVES, 6)
    print(chapter, moves)
    live = page.locator(".widget-toggle-buttons, figure.pfslam-lab").count()
    assert moves or live, "no live widget"
    for name, move in moves.items():
        assert max(move["shown"]) < 10_000, f"{name}: the slider moves, the picture does not"
        assert move["work"] < HANGS, f"{name}: {move}"
    assert strangers == []


def test_a_students_copy_reads_right_without_the_extension(bare_lab, chromium, chapter):
    context = chromium.new_context(viewport={"width": 1400, "height": 1000})
    page = context.new_page()
    page.goto(f"{bare_lab}lab/tree/{chapter}?reset", wait_until="load")
    page.wait_for_selector(".jp-Notebook .jp-MarkdownCell .jp-MarkdownOutput", timeout=MINUTE)
    assert page.locator(".jp-Notebook .myst").count() == 0, "the extension is on"
    page.wait_for_function(ALL_RENDERED, timeout=MINUTE)
    cells = page.evaluate(PROSE)
    assert_it_reads_right(cells)
    assert "0.25" in "".join(cell["text"] for cell in cells)
    page.evaluate(SHUT_DOWN)
    context.close()


def test_a_laboratory_runs_with_the_readers_functions(readers_lab, chromium):
    pytest.importorskip("anywidget")
    context = chromium.new_context(viewport={"width": 1400, "height": 1400})
    page, strangers = context.new_page(), []
    own = (readers_lab, readers_lab.replace("http", "ws"), "data:", "blob:")
    page.on("request", lambda r: r.url.startswith(own) or strangers.append(r.url))
    page.goto(f"{readers_lab}lab/tree/00_mine.ipynb?reset", wait_until="load")
    page.wait_for_function(
        "() => window.jupyterapp?.shell.currentWidget?.sessionContext?.kernelDisplayStatus === 'idle'",
        timeout=MINUTE,
    )
    page.evaluate("() => { window.jupyterapp.commands.execute('notebook:run-all-cells'); }")
    page.wait_for_function(
        "() => document.querySelectorAll('figure.pfslam-live').length === 2", timeout=MINUTE
    )
    mine, forgotten = page.locator("figure.pfslam-lab").all()
    plan = mine.locator(".pfslam-plan")
    plan.focus()
    page.keyboard.press("Space")
    page.wait_for_function(
        "() => document.querySelector('figure.pfslam-lab').lab.state.resamplings > 2", timeout=MINUTE
    )
    for key in "ta":  # in JupyterLab's own keys "a" would add a cell
        plan.press(key)
    assert page.locator(".jp-Notebook .jp-CodeCell").count() == 2
    calls = page.evaluate(ASKED, "sorted(set(calls)), len(calls)")
    assert calls.startswith("(['resample', 'update'], ")
    forgotten.scroll_into_view_if_needed()
    forgotten.get_by_role("button", name="Start", exact=True).click()
    forgotten.get_by_text("NameError: name 'weight' is not defined").wait_for(
        state="attached", timeout=MINUTE
    )
    assert strangers == []
    page.evaluate(SHUT_DOWN)
    context.close()


def test_it_opens_on_the_first_chapter(lab, chromium):
    context = chromium.new_context()
    page = context.new_page()
    page.goto(lab, wait_until="load")
    # JupyterLab brings back what was open last before it goes where the address says.
    page.wait_for_function(
        "() => window.jupyterapp?.shell.currentWidget?.context?.path.startsWith('00_')", timeout=MINUTE
    )
    page.evaluate(SHUT_DOWN)
    context.close()
