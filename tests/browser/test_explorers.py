"""Every explorer of every page: sliders by key and by pointer, play, and good neighbours."""

import pytest

pytestmark = pytest.mark.browser

# A picture by the length and the end of its data, which is enough to tell two of them apart, and its description.
PICTURE = """figure => {
  const i = figure.querySelector('img');
  return [i.src.length + ' ' + i.src.slice(-120), i.alt];
}"""


@pytest.fixture
def explorers(visit, site, explorer_page):
    """The explorers of one page."""
    assert explorer_page != "no page", "no page of the book has an explorer"
    seen = visit(explorer_page)
    yield seen.page.locator("figure.pfslam-explorer").all()
    assert seen.complaints == []
    assert seen.strangers == []


def picture(explorer):
    return explorer.evaluate(PICTURE)


def shown(slider):
    """What the page writes beside a slider."""
    return slider.evaluate("s => document.querySelector(`output[for='${s.id}']`).textContent")


def at(slider) -> int:
    """The stop at which a slider stands."""
    return int(slider.get_attribute("data-stop"))


def last(control) -> int:
    """The last stop of a slider, or of a choice between words."""
    return control.evaluate("c => c.list ? c.list.options.length : c.querySelectorAll('input').length") - 1


def move_to(slider, position: int) -> None:
    """Move a slider by keys alone."""
    slider.focus()
    slider.press("Home")
    for _ in range(position):
        slider.press("ArrowRight")


def sweep(slider, explorer) -> list:
    """The pictures from one end of a slider to the other, by arrow keys."""
    move_to(slider, 0)
    pictures = [picture(explorer)]
    for _ in range(last(slider)):
        slider.press("ArrowRight")
        pictures.append(picture(explorer))
    return pictures


def test_every_slider_changes_the_picture_by_key(explorers):
    for explorer in explorers:
        name, before = explorer.locator("figcaption").text_content(), picture(explorer)
        for slider in explorer.locator("input[type=range]").all():
            start = at(slider)
            pictures = sweep(slider, explorer)
            sources, alts = {source for source, _ in pictures}, {alt for _, alt in pictures}
            assert len(sources) > 1, f"{name}: {slider.get_attribute('id')} moves, the picture does not"
            assert len(alts) > 1, f"{name}: the picture changes, its description does not"
            move_to(slider, start)
            assert picture(explorer) == before, f"{name}: not the same picture after a round trip"


def test_every_slider_changes_the_picture_by_pointer(explorers):
    for explorer in explorers:
        for slider in explorer.locator("input[type=range]").all():
            slider.scroll_into_view_if_needed()
            box = slider.bounding_box()
            middle = box["y"] + box["height"] / 2
            start, seen = at(slider), []
            for part in (0.01, 0.5, 0.99):
                slider.page.mouse.click(box["x"] + part * box["width"], middle)
                seen.append((at(slider), shown(slider), picture(explorer)[0]))
            assert seen[0][0] == 0
            assert seen[-1][0] == last(slider)
            assert seen[0][1] != seen[-1][1]
            assert len({source for _, _, source in seen}) > 1
            assert box["height"] >= 40, "too low for a thumb"
            move_to(slider, start)


def test_every_choice_changes_the_picture(explorers):
    for explorer in explorers:
        for choice in explorer.locator("fieldset").all():
            # A choice may matter only later: how particles are resampled is not seen before the first look.
            sliders = {slider: at(slider) for slider in explorer.locator("input[type=range]").all()}
            for slider in sliders:
                slider.press("End")
            radios, seen = choice.locator("input[type=radio]").all(), []
            before = picture(explorer)
            start = next(k for k, radio in enumerate(radios) if radio.is_checked())
            for radio in radios:
                radio.check()
                seen.append(picture(explorer))
            assert len({source for source, _ in seen}) > 1
            assert len({alt for _, alt in seen}) > 1
            assert all(label.bounding_box()["height"] >= 40 for label in choice.locator("label").all())
            radios[start].check()
            assert picture(explorer) == before
            for slider, start in sliders.items():
                move_to(slider, start)


def test_sliders_work_from_the_file(visit, site, explorer_page):
    seen = visit(explorer_page, "file")
    for explorer in seen.page.locator("figure.pfslam-explorer").all():
        for slider in explorer.locator("input[type=range]").all():
            start = at(slider)
            pictures = []
            for key in ("Home", "End"):
                slider.press(key)
                pictures.append(picture(explorer)[0])
            assert pictures[0] != pictures[1]
            move_to(slider, start)
    assert seen.complaints == []


def test_a_moved_explorer_leaves_its_neighbours_alone(explorers):
    for explorer in explorers:
        before = [picture(other) for other in explorers if other is not explorer]
        for slider in explorer.locator("input[type=range]").all():
            slider.focus()
            slider.press("End")
        assert [picture(other) for other in explorers if other is not explorer] == before


def test_pictures_are_real(explorers):
    for explorer in explorers:
        image = explorer.locator("img")
        assert image.evaluate("i => i.decode().then(() => i.naturalWidth)") >= 300
        assert image.get_attribute("alt").strip()


def test_play_starts_stops_and_ends(explorers):
    for explorer in explorers:
        button = explorer.locator("button")
        if button.count() == 0:
            continue
        data = explorer.evaluate(
            "f => JSON.parse(f.querySelector('script[type=\"application/json\"]').textContent)"
        )
        player = explorer.locator("input[type=range], fieldset").nth(data["play"])
        go_to(player, 0)
        assert button.text_content() == "Play"
        button.click()
        assert button.text_content() == "Pause"
        wait_for_stop(player, 1)
        button.click()
        assert button.text_content() == "Play"
        halted = at(player)
        player.page.wait_for_timeout(2 * data["pause"])
        assert at(player) == halted, "it plays on after Pause"
        go_to(player, last(player) - 1)
        button.click()
        wait_for_stop(player, last(player))
        button.page.wait_for_timeout(2 * data["pause"])
        assert button.text_content() == "Play", "it does not stop at the end"


def go_to(control, stop: int) -> None:
    """Move a slider by keys, or choose a word."""
    if control.evaluate("c => c.matches('fieldset')"):
        control.locator("label").nth(stop).click()
    else:
        move_to(control, stop)


def wait_for_stop(control, stop: int) -> None:
    reached = "([c, stop]) => Number(c.dataset.stop) >= stop"
    control.page.wait_for_function(reached, arg=[control.element_handle(), stop])


def test_the_first_explorer_is_ready_soon(visit, site, explorer_page):
    """Its script runs while the page is parsed. One second is the aim; other tests share the machine."""
    page = visit(explorer_page).page
    ready = page.evaluate("performance.getEntriesByType('navigation')[0].domInteractive")
    print(f"{explorer_page}: ready after {ready:.0f} ms")
    assert ready < 5000


def test_with_reduced_motion_nothing_runs_by_itself(visit, site, explorer_page):
    page = visit(explorer_page, reduced_motion="reduce").page
    for button in page.locator("figure.pfslam-explorer button").all():
        assert button.text_content() == "Next"
        button.click()
        assert button.text_content() == "Next"
