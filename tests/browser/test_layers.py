"""A word lights what it names in the laboratory, and what is pointed at there lights the words."""

import pytest
from headless import violations

pytestmark = [pytest.mark.browser, pytest.mark.xdist_group("layers")]

FIVE, DRIVE = "notebooks/05_particle_filter_slam.html", ".pfslam-lab[data-lab=drive]"
LIT = "() => [...document.querySelectorAll('.pfslam-lit')].map(word => word.dataset.layer)"
# How many pixels of the plan have the colour of the end points of beams, and how many that of the particles.
INKS = f"""() => {{
  const sheet = document.querySelector('{DRIVE}').lab.stage.sheets[0], {{width, height}} = sheet.canvas;
  const {{data}} = sheet.context.getImageData(0, 0, width, height), counts = [0, 0];
  const inks = [[0xb5, 0x36, 0x7a], [0x56, 0xb4, 0xe9]];
  for (let at = 0; at < data.length; at += 4) {{
    inks.forEach((ink, k) => {{ counts[k] += ink.every((value, c) => Math.abs(data[at + c] - value) < 4); }});
  }}
  return counts;
}}"""


@pytest.fixture
def drive(visit):
    def go(**options):
        seen = visit(FIVE, width=1440, height=900, reduced_motion="reduce", **options)
        assert seen.complaints + seen.strangers == []
        seen.page.locator(DRIVE).scroll_into_view_if_needed()
        seen.page.wait_for_function(f"() => document.querySelector('{DRIVE}').lab.state.ready")
        return seen.page

    return go


def inks(page) -> list[int]:
    """Pixels of end points and of particles, after the next frame."""
    page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return page.evaluate(INKS)


def test_a_word_of_the_text_lights_the_particles_and_all_their_words(drive):
    page = drive()
    ends, dots = inks(page)
    assert min(ends, dots) > 0
    page.locator(".pfslam-questions > p [data-layer=particles]").hover()
    assert set(page.evaluate(LIT)) == {"particles"}
    assert len(page.evaluate(LIT)) >= 3  # below the picture, in the question and in the answer
    assert inks(page) == [0, dots]
    page.get_by_role("heading", name="Drive it yourself").hover()
    assert page.evaluate(LIT) == []
    assert inks(page) == [ends, dots]


def test_what_is_pointed_at_in_the_laboratory_lights_the_words(drive):
    page = drive()
    ends, dots = inks(page)
    page.locator(f"{DRIVE} span[data-layer=hits]").hover()
    assert page.locator(".pfslam-questions [data-layer=hits].pfslam-lit").count() == 1
    found = inks(page)
    assert (found[0] >= ends, found[1]) == (True, 0)  # one may come to light from under a particle
    page.locator(f"{DRIVE} canvas[data-layer=n-eff]").hover()
    assert page.locator("p > [data-layer=n-eff].pfslam-lit").count() >= 1
    assert inks(page) == [ends, dots]  # the strip is a picture of its own


# A pixel of the plan in the colour of end points, with more of them round it than anywhere, on the screen.
THICKEST = f"""() => {{
  const {{canvas, context}} = document.querySelector('{DRIVE}').lab.stage.sheets[0];
  const {{width, height}} = canvas, box = canvas.getBoundingClientRect(), side = 6, ink = [0xb5, 0x36, 0x7a];
  const {{data}} = context.getImageData(0, 0, width, height);
  const is = (x, y) => ink.every((value, c) => Math.abs(data[4 * (y * width + x) + c] - value) < 4);
  let best = [0, 0, 0];
  for (let y = side; y < height - side; y += 2) for (let x = side; x < width - side; x += 2) {{
    let count = 0;
    for (let j = -3; j <= 3; j++) for (let i = -3; i <= 3; i++) count += is(x + i, y + j);
    if (count > best[0]) best = [count, x, y];
  }}
  return [box.left + (best[1] * box.width) / width, box.top + (best[2] * box.height) / height];
}}"""


def test_a_pointer_on_the_picture_lights_the_words_for_what_it_is_on(drive):
    page = drive()
    before = inks(page)
    page.mouse.move(*page.evaluate(THICKEST))
    assert set(page.evaluate(LIT)) == {"hits"}
    assert inks(page) == before, "the picture can be used meanwhile"
    page.get_by_role("heading", name="Drive it yourself").hover()
    assert page.evaluate(LIT) == []


def test_keys_light_and_hold_until_escape(drive):
    page = drive()
    word = page.locator(".pfslam-questions > p [data-layer=particles]")
    word.focus()
    page.keyboard.press("Enter")
    assert word.get_attribute("aria-pressed") == "true"
    page.keyboard.press("Tab")
    page.get_by_role("heading", name="Drive it yourself").hover()
    assert set(page.evaluate(LIT)) == {"particles"}
    page.keyboard.press("Escape")
    assert (page.evaluate(LIT), word.get_attribute("aria-pressed")) == ([], "false")
    legend = page.locator(f"{DRIVE} span[data-layer=wall]")
    looks = page.evaluate(f"document.querySelector('{DRIVE}').lab.state.ticks")
    legend.focus()
    page.keyboard.press("Space")  # which is also the laboratory's key for Start
    assert set(page.evaluate(LIT)) == {"wall"}
    assert page.evaluate(f"document.querySelector('{DRIVE}').lab.state.ticks") == looks


def test_a_finger_lights_and_puts_out(drive):
    page = drive(has_touch=True)
    word = page.locator(".pfslam-questions > p [data-layer=particles]")
    word.tap()
    assert set(page.evaluate(LIT)) == {"particles"}
    word.tap()
    assert page.evaluate(LIT) == []


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_it_is_for_everybody(drive, theme):
    page = drive()
    page.evaluate("theme => { document.documentElement.dataset.theme = theme; }", theme)
    page.locator(".pfslam-questions > p [data-layer=particles]").hover()
    assert violations(page, include=[[".pfslam-beside"]]) == []


LABS = [
    ("02_occupancy_grid", "beam"),
    ("02_occupancy_grid", "grow"),
    ("03_prediction_only", "cloud"),
    ("04_map_correlation", "slide"),
    ("05_particle_filter_slam", "maps"),
    ("05_particle_filter_slam", "drive"),
    ("10_lost_and_found", "lost"),
]


@pytest.mark.parametrize(("chapter", "name"), LABS, ids=[name for _, name in LABS])
def test_each_word_of_the_text_lights_its_laboratory(visit, chapter, name):
    seen = visit(f"notebooks/{chapter}.html", width=1280, height=800, reduced_motion="reduce")
    page, lab = seen.page, f".pfslam-lab[data-lab={name}]"
    page.locator(lab).scroll_into_view_if_needed()
    page.wait_for_function(f"() => document.querySelector('{lab}').lab?.state.ready ?? true")
    of_it = page.evaluate_handle(
        """lab => {
          const near = lab.closest('.pfslam-beside') ?? lab.closest('section');
          const words = near.querySelectorAll('p [data-layer], li [data-layer]');
          return [...words].filter(word => !word.closest('.pfslam-lab'));
        }""",
        page.query_selector(lab),
    )
    words = [word.as_element() for word in of_it.get_properties().values()]
    assert words
    dark = "lab => { lab.lab.stage.draw?.(); return lab.querySelector('canvas').toDataURL(); }"
    still = page.eval_on_selector(lab, dark)
    for word in words:
        layer = word.get_attribute("data-layer")
        word.evaluate(
            "word => word.dispatchEvent(new PointerEvent('pointerover', {bubbles: true}))"
        )  # some are folded
        assert set(page.evaluate(LIT)) == {layer}
        assert page.eval_on_selector(lab, "lab => lab.lab.stage.lit") == layer
    page.evaluate("document.body.dispatchEvent(new PointerEvent('pointerover', {bubbles: true}))")
    page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    assert page.eval_on_selector(lab, dark) == still


def test_twenty_thousand_guesses_are_lit_by_their_word(visit):
    page = visit("notebooks/10_lost_and_found.html", width=1280, height=800, reduced_motion="reduce").page
    lab = ".pfslam-lab[data-lab=lost]"
    page.locator(lab).scroll_into_view_if_needed()
    page.wait_for_function(f"() => document.querySelector('{lab}').lab?.state.ready")
    page.locator(f"{lab} span[data-layer=particles]").hover()
    page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    assert page.evaluate(INKS.replace(DRIVE, lab))[1] > 10_000
