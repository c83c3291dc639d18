"""Addresses of repository and site: from the settings, else from the host that builds, else none."""

import json
from pathlib import Path

import pytest
import yaml
from addresses import addresses
from copies import colab_copy, expressions, source, student_copy
from plain import Place

import pfslam

ROOT = Path(__file__).resolve().parents[1]
SETTINGS = yaml.safe_load((ROOT / "_config.yml").read_text(encoding="utf-8"))
PAGE = "notebooks/00_robot_and_data"
COLAB, BINDER = "https://colab.research.google.com/github", "https://mybinder.org/v2"
GITHUB = {
    "GITHUB_SERVER_URL": "https://github.com",
    "GITHUB_REPOSITORY": "Ada/slam-course",
    "GITHUB_REF_NAME": "main",
}
GITLAB = {"CI_PROJECT_URL": "https://gitlab.com/robots/course/slam", "CI_COMMIT_REF_NAME": "2027/spring"}


def named(**sections) -> dict:
    """The settings of the book with some addresses filled in."""
    return SETTINGS | {name: SETTINGS[name] | filled for name, filled in sections.items()}


def test_where_no_address_is_known_there_is_none():
    known = addresses(SETTINGS, {"HOME": "/home/ada", "CI": "true"})
    assert (known.repository, known.site, known.runs(PAGE)) == ("", "", {})


def test_a_fork_on_github_has_its_own_addresses():
    known = addresses(SETTINGS, GITHUB)
    assert (known.repository, known.provider) == ("https://github.com/Ada/slam-course", "github")
    assert known.site == "https://ada.github.io/slam-course"
    assert known.runs(PAGE) == {
        "Open in Colab": f"{COLAB}/Ada/slam-course/blob/colab/{PAGE}.ipynb",
        "Binder": f"{BINDER}/gh/Ada/slam-course/main?urlpath=lab/tree/{PAGE}.ipynb",
    }


@pytest.mark.parametrize(
    ("changed", "site"),
    [
        ({"GITHUB_REPOSITORY": "Ada/ada.github.io"}, "https://ada.github.io"),
        ({"GITHUB_SERVER_URL": "https://github.university.example"}, ""),
    ],
)
def test_the_site_of_github_pages(changed, site):
    assert addresses(SETTINGS, GITHUB | changed).site == site


def test_colab_opens_nothing_that_is_not_on_github_com():
    elsewhere = addresses(SETTINGS, GITHUB | {"GITHUB_SERVER_URL": "https://github.university.example"})
    repository = "https%3A%2F%2Fgithub.university.example%2FAda%2Fslam-course"
    assert elsewhere.runs(PAGE) == {"Binder": f"{BINDER}/git/{repository}/main?urlpath=lab/tree/{PAGE}.ipynb"}


def test_gitlab_tells_repository_branch_and_site():
    known = addresses(SETTINGS, GITLAB | {"CI_PAGES_URL": "https://robots.gitlab.io/course/slam"})
    assert (known.provider, known.site) == ("gitlab", "https://robots.gitlab.io/course/slam")
    project = "robots%2Fcourse%2Fslam"
    assert known.runs(PAGE) == {"Binder": f"{BINDER}/gl/{project}/2027/spring?urlpath=lab/tree/{PAGE}.ipynb"}


def test_what_the_settings_say_comes_first():
    settings = named(
        repository={"url": "https://github.com/bea/book/", "branch": "stable"},
        html={"baseurl": "https://slam.example/"},
        launch_buttons={"binderhub_url": "https://binder.example/"},
    )
    known = addresses(settings, GITHUB)
    assert (known.repository, known.site) == ("https://github.com/bea/book", "https://slam.example")
    assert known.runs(PAGE) == {
        "Open in Colab": f"{COLAB}/bea/book/blob/colab/{PAGE}.ipynb",
        "Binder": f"https://binder.example/v2/gh/bea/book/stable?urlpath=lab/tree/{PAGE}.ipynb",
    }


def test_without_services_no_chapter_runs_elsewhere():
    services = dict.fromkeys(("binderhub_url", "colab_url"), "")
    assert addresses(named(launch_buttons=services), GITHUB).runs(PAGE) == {}


def test_only_colabs_copy_names_the_wheel_and_it_is_the_students():
    path, place = ROOT / f"{PAGE}.ipynb", Place(ROOT, site="https://slam.example")
    chapter = json.loads(path.read_text(encoding="utf-8"))
    numbers = ["1"] * len(expressions(chapter))
    install, *rest = colab_copy(chapter, numbers, place)["cells"]
    wheel = f"https://slam.example/pfslam-{pfslam.__version__}-py3-none-any.whl"
    assert f'%pip install -q anywidget "pfslam[plots,ros,study] @ {wheel}"' in source(install)
    assert rest == student_copy(chapter, numbers, place)["cells"]
    assert "slam.example" not in path.read_text(encoding="utf-8")
