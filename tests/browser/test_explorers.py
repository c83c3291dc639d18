"""Every explorer of every page: sliders by key and by pointer, choices, play, and good neighbours."""

import pytest

pytestmark = pytest.mark.browser

# A picture by the length and the end of its data, which is enough to tell two of them apart, and its description.
PICTURE = """figure => {
  const i = figure.querySelector('img');
  return [i.src.length + ' ' + i.src.slice(-120), i.alt.trim()];
}"""


@pytest.fixture(params=["http", "file"])
def explorers(request, visit, explorer_page):
    """The explorers of one page, over the net and from its file."""
    seen = visit(explorer_page, request.param)
    yield seen.page.locator("figure.pfslam-explorer").all()
    assert seen.complaints + seen.strangers == []


def picture(explorer):
    return explorer.evaluate(PICTURE)


def at(control) -> int:
    """The stop at which a slider or a choice stands."""
    return int(control.get_attribute("data-stop"))


def last(control) -> int:
    """The last stop of a slider, or of a choice between words."""
    return control.evaluate("c => c.list ? c.list.options.length : c.querySelectorAll('input').length") - 1


def go_to(control, stop: int) -> None:
    """Move a slider by keys, or choose a word."""
    if control.evaluate("c => c.matches('fieldset')"):
        control.locator("label").nth(stop).click()
        return
    control.press("Home")
    for _ in range(stop):
        control.press("ArrowRight")


def sweep(slider, explorer) -> list:
    """The pictures from one end of a slider to the other, by arrow keys."""
    go_to(slider, 0)
    pictures = [picture(explorer)]
    for _ in range(last(slider)):
        slider.press("ArrowRight")
        pictures.append(picture(explorer))
    return pictures


def test_every_slider_changes_its_picture_and_no_other_by_key(explorers):
    for explorer in explorers:
        name, before = explorer.locator("figcaption").text_content(), picture(explorer)
        others = [picture(other) for other in explorers if other is not explorer]
        explorer.scroll_into_view_if_needed()  # its picture is fetched when it comes near
        assert explorer.locator("img").evaluate("i => i.decode().then(() => i.naturalWidth)") >= 300
        for slider in explorer.locator("input[type=range]").all():
            start = at(slider)
            sources, alts = map(set, zip(*sweep(slider, explorer), strict=True))
            assert len(sources) > 1, f"{name}: {slider.get_attribute('id')} moves, the picture does not"
            assert len(alts) > 1, f"{name}: the picture changes, its description does not"
            assert "" not in alts
            go_to(slider, start)
            assert picture(explorer) == before, f"{name}: not the same picture after a round trip"
        assert [picture(other) for other in explorers if other is not explorer] == others


def test_every_slider_changes_the_picture_by_pointer(explorers):
    for explorer in explorers:
        for slider in explorer.locator("input[type=range]").all():
            box, start, seen = slider.bounding_box(), at(slider), []
            for part in (0.01, 0.5, 0.99):
                slider.click(position={"x": part * box["width"], "y": box["height"] / 2})
                seen.append((at(slider), picture(explorer)[0]))
            assert (seen[0][0], seen[-1][0]) == (0, last(slider))
            assert len({source for _, source in seen}) > 1
            go_to(slider, start)


def test_every_choice_changes_the_picture(explorers):
    for explorer in explorers:
        sliders = {slider: at(slider) for slider in explorer.locator("input[type=range]").all()}
        for choice in explorer.locator("fieldset").all():
            # A choice may matter only later: how particles are resampled is not seen before the first look.
            for slider in sliders:
                slider.press("End")
            before, start, seen = picture(explorer), at(choice), []
            for stop in range(last(choice) + 1):
                go_to(choice, stop)
                seen.append(picture(explorer))
            sources, alts = map(set, zip(*seen, strict=True))
            assert len(sources) > 1
            assert len(alts) > 1
            go_to(choice, start)
            assert picture(explorer) == before
            for slider, stop in sliders.items():
                go_to(slider, stop)


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


def wait_for_stop(control, stop: int) -> None:
    reached = "([c, stop]) => Number(c.dataset.stop) >= stop"
    control.page.wait_for_function(reached, arg=[control.element_handle(), stop])


def test_with_reduced_motion_nothing_runs_by_itself(visit, explorer_page):
    page = visit(explorer_page, reduced_motion="reduce").page
    for button in page.locator("figure.pfslam-explorer button").all():
        button.click()
        assert button.text_content() == "Next"
