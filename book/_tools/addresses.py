"""Where the project is at home, where its site is published, and where a chapter of it runs.

The settings of the book (`_config.yml`) say so. What they leave open is told by GitHub or GitLab to whatever builds
there, so that a fork has the right addresses without a change. Elsewhere nothing is known, and nothing is shown.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from urllib.parse import quote

COLAB, BINDER = "Open in Colab", "Binder"
COLAB_BRANCH = "colab"
"""The branch with the copies that Colab opens: it takes a notebook from GitHub only (.github/workflows/ci.yml)."""


@dataclass(frozen=True)
class Addresses:
    """Addresses, each empty if it is not known: the repository with its host's kind and branch, and the site."""

    repository: str = ""
    provider: str = ""
    branch: str = "main"
    site: str = ""
    binder: str = ""
    colab: str = ""

    def runs(self, page: str) -> dict[str, str]:
        """Links, by their words, that run a chapter such as ``notebooks/00_robot_and_data``."""
        host, _, path = self.repository.removeprefix("https://").partition("/")
        found = {}
        if self.colab and host == "github.com" and self.site:
            found[COLAB] = f"{self.colab}/github/{path}/blob/{COLAB_BRANCH}/{page}.ipynb"
        if self.binder and self.repository:
            known = {"github.com": f"gh/{path}", "gitlab.com": f"gl/{quote(path, safe='')}"}
            place = known.get(host, f"git/{quote(self.repository, safe='')}")
            found[BINDER] = f"{self.binder}/v2/{place}/{quote(self.branch)}?urlpath=lab/tree/{page}.ipynb"
        return found


def addresses(settings: Mapping, environment: Mapping[str, str]) -> Addresses:
    """The addresses that the settings of the book name, and else the host on which this runs."""
    repository, launch = settings.get("repository") or {}, settings.get("launch_buttons") or {}
    told = from_github(environment) if "GITHUB_REPOSITORY" in environment else from_gitlab(environment)
    named = (repository.get("url") or "").rstrip("/")
    if named:
        provider = "github" if "github" in named else "gitlab"  # an icon, and the word for an issue
        home = {"repository": named, "provider": provider, "branch": repository.get("branch", "main")}
        told = {**told, **home}
    if site := (settings.get("html") or {}).get("baseurl"):
        told = {**told, "site": site.rstrip("/")}
    services = {
        name: (launch.get(key) or "").rstrip("/")
        for name, key in (("binder", "binderhub_url"), ("colab", "colab_url"))
    }
    return Addresses(**told, **services)


def from_github(environment: Mapping[str, str]) -> dict[str, str]:
    """What GitHub tells a workflow; the address of the site is the one that it gives without a domain of one's own."""
    server, project = (
        environment.get("GITHUB_SERVER_URL", "https://github.com"),
        environment["GITHUB_REPOSITORY"],
    )
    owner, _, name = project.partition("/")
    site = ""
    if server == "https://github.com":
        root = f"https://{owner.lower()}.github.io"
        site = root if name.lower() == f"{owner.lower()}.github.io" else f"{root}/{name}"
    branch = environment.get("GITHUB_REF_NAME", "main")
    return {"repository": f"{server}/{project}", "provider": "github", "branch": branch, "site": site}


def from_gitlab(environment: Mapping[str, str]) -> dict[str, str]:
    """What GitLab tells a pipeline, and nothing elsewhere."""
    if "CI_PROJECT_URL" not in environment:
        return {}
    return {
        "repository": environment["CI_PROJECT_URL"],
        "provider": "gitlab",
        "branch": environment.get("CI_COMMIT_REF_NAME", "main"),
        "site": environment.get("CI_PAGES_URL", "").rstrip("/"),
    }
