"""Chapters in JupyterLab: no pop-ups, run from a fresh kernel to the last cell, read right, move at once.

The copies for students are read where the extension that knows MyST is switched off.
"""

import re
from contextlib import contextmanager

import pytest

pytestmark = pytest.mark.lab

MINUTE = 60_000
PANEL = "window.jupyterapp.shell.currentWidget"
IDLE = "() => window.jupyterapp?.shell.currentWidget?.sessionContext?.kernelDisplayStatus === 'idle'"
STATE = f"""() => {{
  const panel = {PANEL}, cells = panel.content.widgets;
  const code = cells.filter(c => c.model.type === 'code' && c.model.sharedModel.getSource().trim());
  const outputs = code.flatMap(c => c.model.outputs.toJSON());
  return {{
    waiting: code.filter(c => c.model.executionCount === null || c.model.executionState === 'running').length,
    cells: code.length,
    errors: outputs.filter(o => o.output_type === 'error').map(o => o.ename + ': ' + o.evalue),
    kernel: panel.sessionContext.kernelDisplayStatus,
  }};
}}"""
DONE = (
    f"() => {{ const s = ({STATE})(); return s.errors.length || (s.kernel === 'idle' && s.waiting === 0); }}"
)
ALL_RENDERED = f"""() => {PANEL}.content.widgets.every(
  c => c.model.type !== 'markdown' || c.node.querySelector('.jp-MarkdownOutput')?.textContent)"""
# Each sentence has the numbers that it asked the kernel for.
ALL_NUMBERS = f"""() => {PANEL}.content.widgets.every(c =>
  c.model.type !== 'markdown' || c.model.sharedModel.getSource().split('{{eval}}`').length - 1
    === (c.model.getMetadata('user_expressions') ?? []).length)"""
# What the reader sees of each cell: its text without formulas, what stands folded in it, whether the cell is folded.
PROSE = f"""() => {PANEL}.content.widgets.map(cell => {{
  const meta = cell.model.sharedModel.getMetadata(), copy = cell.node.cloneNode(true);
  copy.querySelectorAll('.jp-Editor, .katex, mjx-container, svg, math').forEach(e => e.remove());
  return {{
    type: cell.model.type, tags: meta.tags ?? [], source: cell.model.sharedModel.getSource(),
    text: cell.model.type === 'markdown' ? copy.textContent : '',
    open: [...cell.node.querySelectorAll('details:not(.pfslam-more)')].map(d => d.open),
    numbers: (meta.user_expressions ?? []).map(e => e.result?.data?.['text/plain'] ?? 'no number'),
    folded: cell.inputHidden, silent: cell.outputHidden ?? false,
  }};
}})"""
# Markup that nothing has rendered, and the errors of a kernel that could not answer.
RAW = re.compile(r"\{(?:eval|eq|cite|doc|ref|numref|term|glue)[^}]*\}|\beq-\d|:::|\(eq-|\[\]\(|\w+Error:")
# What the kernel says to an expression.
ASKED = f"""async expression => {{
  const kernel = {PANEL}.sessionContext.session.kernel;
  const reply = await kernel.requestExecute({{code: '', user_expressions: {{it: expression}}}}).done;
  return reply.content.user_expressions.it.data['text/plain'];
}}"""
# Moves the first slider of each live widget six times: the kernel's processor time for a move, and whether the picture
# changed. Times on a shared machine are no test, so only a move that hangs fails.
MOVES = f"""async () => {{
  const seconds = async () => Number(await ({ASKED})('__import__("time").process_time()')), all = {{}};
  for (const box of document.querySelectorAll('.jp-Notebook .widget-vbox:has(.noUi-handle)')) {{
    const handle = box.querySelector('.noUi-handle'), picture = () => box.querySelector('img').src;
    const begin = await seconds();
    let shown = true;
    box.scrollIntoView();
    for (let k = 0; k < 6; k++) {{
      const value = Number(handle.getAttribute('aria-valuenow')), end = Number(handle.getAttribute('aria-valuemax'));
      const key = value < end ? 'ArrowRight' : 'ArrowLeft', before = picture(), start = performance.now();
      handle.dispatchEvent(new KeyboardEvent('keydown', {{key: key, bubbles: true}}));
      while (picture() === before && performance.now() - start < 10000) await new Promise(done => setTimeout(done, 2));
      shown = shown && picture() !== before;
    }}
    all[box.querySelector('b').textContent] = {{shown, work: Math.round(1000 * (await seconds() - begin) / 6)}};
  }}
  return all;
}}"""
HANGS = 3_000  # ms of processor time
# Of each canvas in sight of a laboratory: how much of it is black, how much is one of the theme's colours, and of how
# many colours it is.
PIXELS = """figure => {
  const style = getComputedStyle(figure), rgb = name => {
    const [r, g, b] = style.getPropertyValue('--lab-' + name).trim().match(/\\w\\w/g).map(x => parseInt(x, 16));
    return (r << 16) | (g << 8) | b;
  };
  const theme = ['paper', 'free', 'sheet', 'wall', 'ink', 'estimate', 'particles', 'highlight'].map(rgb);
  // A cell that is almost surely free has almost the colour of what is free.
  const near = c => c >= 0 && theme.some(t => [16, 8, 0].every(k => Math.abs((c >> k & 255) - (t >> k & 255)) <= 3));
  return [...figure.querySelectorAll('canvas')].filter(c => c.offsetHeight && c.width).map(canvas => {
    const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data, counts = new Map();
    for (let i = 0; i < data.length; i += 4) {
      const colour = data[i + 3] ? (data[i] << 16) | (data[i + 1] << 8) | data[i + 2] : -1;
      counts.set(colour, (counts.get(colour) ?? 0) + 1);
    }
    const share = chosen => [...counts].reduce((sum, [c, n]) => sum + (chosen(c) ? n : 0), 0) / (data.length / 4);
    return {black: share(c => c === 0), ofTheme: share(near), colours: counts.size};
  });
}"""


@pytest.fixture
def open_chapter(chromium):
    """Open a notebook of a server; at the end its kernel is shut down, and nothing was asked for elsewhere."""

    @contextmanager
    def go(address: str, path: str, ready: str):
        context = chromium.new_context(viewport={"width": 1400, "height": 1000})
        page, strangers = context.new_page(), []
        own = (address, address.replace("http", "ws"), "data:", "blob:")
        page.on("request", lambda r: r.url.startswith(own) or strangers.append(r.url))
        page.goto(f"{address}{path}", wait_until="load")
        page.wait_for_function(ready, timeout=MINUTE)
        yield page
        assert strangers == []
        page.evaluate(f"() => {PANEL}.sessionContext.shutdown()")
        context.close()

    return go


def pop_ups(page) -> list[str]:
    return page.locator(".jp-Dialog, .Toastify__toast, .jp-toast").all_text_contents()


def assert_it_reads_right(cells: list[dict]) -> None:
    """No markup is left to see, what should be folded is, and every number stands in its sentence."""
    for cell in cells:
        assert not RAW.search(cell["text"]), RAW.search(cell["text"])
        asked = cell["source"].count(":class: dropdown") + cell["source"].count("<details>")
        assert cell["open"] == asked * [False], cell["source"]
        folded = bool({"hide-cell", "hide-input", "remove-input"} & set(cell["tags"]))
        assert cell["type"] != "code" or cell["folded"] == folded, cell["source"]
        assert all(number.strip("'\"") in cell["text"] for number in cell["numbers"]), cell["source"]
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


def test_a_chapter_runs_and_its_widgets_redraw_in_time(lab, open_chapter, chapter):
    with open_chapter(lab, f"lab/tree/{chapter}?reset", IDLE) as page:
        assert pop_ups(page) == []
        solutions = [cell for cell in page.evaluate(PROSE) if "hide-cell" in cell["tags"]]
        assert all(cell["folded"] and cell["silent"] for cell in solutions)
        page.evaluate("() => { window.jupyterapp.commands.execute('notebook:restart-run-all'); }")
        page.locator(".jp-Dialog button.jp-mod-warn").click()
        page.wait_for_function(DONE, timeout=10 * MINUTE, polling=250)
        state = page.evaluate(STATE)
        assert (state["errors"], state["cells"] > 5, pop_ups(page)) == ([], True, [])
        page.wait_for_function(ALL_NUMBERS, timeout=MINUTE)
        assert_it_reads_right(numbers_in_their_sentences(page))
        moves = page.evaluate(MOVES)
        print(chapter, moves)
        assert moves or page.locator(".widget-toggle-buttons, figure.pfslam-lab").count(), "no live widget"
        for name, move in moves.items():
            assert move["shown"], f"{name}: the slider moves, the picture does not"
            assert move["work"] < HANGS, f"{name}: {move}"


def test_a_students_copy_reads_right_without_the_extension(bare_lab, open_chapter, chapter):
    rendered = "() => document.querySelector('.jp-Notebook .jp-MarkdownCell .jp-MarkdownOutput')"
    with open_chapter(bare_lab, f"lab/tree/{chapter}?reset", rendered) as page:
        assert page.locator(".jp-Notebook .myst").count() == 0, "the extension is on"
        page.wait_for_function(ALL_RENDERED, timeout=MINUTE)
        cells = page.evaluate(PROSE)
        assert_it_reads_right(cells)
        assert "0.25" in "".join(cell["text"] for cell in cells)


def test_a_laboratory_runs_with_the_readers_functions(readers_lab, open_chapter):
    with open_chapter(readers_lab, "lab/tree/00_mine.ipynb?reset", IDLE) as page:
        page.evaluate("() => { window.jupyterapp.commands.execute('notebook:run-all-cells'); }")
        both = "() => document.querySelectorAll('figure.pfslam-live').length === 2"
        page.wait_for_function(both, timeout=MINUTE)
        mine, forgotten = page.locator("figure.pfslam-lab").all()
        plan = mine.locator(".pfslam-plan")
        plan.press("Space")
        resampled = "() => document.querySelector('figure.pfslam-lab').lab.state.resamplings > 2"
        page.wait_for_function(resampled, timeout=MINUTE)
        for key in "ta":  # in JupyterLab's own keys "a" would add a cell
            plan.press(key)
        assert page.locator(".jp-Notebook .jp-CodeCell").count() == 2
        calls = page.evaluate(ASKED, "sorted(set(calls)), len(calls)")
        assert calls.startswith("(['resample', 'update'], ")
        forgotten.scroll_into_view_if_needed()
        forgotten.get_by_role("button", name="Start", exact=True).click()
        told = forgotten.get_by_text("NameError: name 'weight' is not defined")
        told.wait_for(state="attached", timeout=MINUTE)


@pytest.mark.nightly
@pytest.mark.parametrize("theme", ["JupyterLab Light", "JupyterLab Dark"])
def test_no_laboratory_is_black_however_often_all_cells_run(laboratories, open_chapter, theme):
    address, number = laboratories
    change = "theme => window.jupyterapp.commands.execute('apputils:change-theme', {theme})"
    with open_chapter(address, "lab/tree/00_laboratories.ipynb?reset", IDLE) as page:
        page.evaluate(change, theme)
        for run in range(10):
            page.evaluate("() => { window.jupyterapp.commands.execute('notebook:restart-run-all'); }")
            page.locator(".jp-Dialog button.jp-mod-warn").click()
            page.wait_for_function(DONE, timeout=10 * MINUTE, polling=250)
            assert page.evaluate(STATE)["errors"] == []
            for k in range(number):
                figure = page.locator("figure.pfslam-live").nth(k)
                figure.scroll_into_view_if_needed()
                page.wait_for_timeout(300)
                seen = figure.evaluate(PIXELS)
                print(run, k, seen)
                assert seen, "no canvas"
                # A chart in which nothing is drawn yet is the paper of the theme, and nothing else.
                painted = [canvas["colours"] > 2 or canvas["ofTheme"] > 0.9 for canvas in seen]
                assert all(painted), (run, k, seen)
                assert all(canvas["black"] < 0.05 for canvas in seen), (run, k, seen)
                assert max(canvas["colours"] for canvas in seen) > 2, (run, k, seen)
                assert max(canvas["ofTheme"] for canvas in seen) > 0.6, (run, k, seen)


@pytest.mark.nightly
def test_it_opens_on_the_first_chapter(lab, open_chapter):
    # JupyterLab brings back what was open last before it goes where the address says.
    first = "() => window.jupyterapp?.shell.currentWidget?.context?.path.startsWith('00_')"
    with open_chapter(lab, "", first):
        pass
