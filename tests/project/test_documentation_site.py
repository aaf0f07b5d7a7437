"""The documentation site: pages in its navigation, links and anchors that lead somewhere, pictures drawn."""

import re
import urllib.parse
from pathlib import Path

import pytest
import yaml
from benchmarks.api_page import api_page
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.glob("*.md"))
PAPERS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "examples/README.md", *PAGES]
LINK = re.compile(r"(!?)\[[^\]]*\]\(([^)\s]+)\)")


class _Loader(yaml.SafeLoader):
    """Reads the one tag of mkdocs.yml as nothing."""


_Loader.add_multi_constructor("tag:yaml.org,2002:python/", lambda loader, suffix, node: None)


def prose(text):
    """Return a page without its code."""
    return re.sub(r"(?ms)^```.*?^```|`[^`\n]*`|^    .*?$", "", text)


def anchors(page):
    """Return what a page's headings can be linked by, on GitHub and on the site, and the stated ones."""
    text = re.sub(r"(?ms)^```.*?^```", "", page.read_text())
    made = set()
    for title in re.findall(r"(?m)^#+ (.*)$", text):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title).replace("`", "")
        made.add(re.sub(r"[^\w\- ]", "", plain.strip().lower()).replace(" ", "-"))
    return made | set(re.findall(r'<a id="([^"]+)"', text))


def listed(entry):
    """Yield the pages of a part of the navigation."""
    if isinstance(entry, str):
        yield entry
    else:
        for inner in entry.values() if isinstance(entry, dict) else entry:
            yield from listed(inner)


@pytest.fixture(scope="module")
def settings():
    return yaml.load((ROOT / "mkdocs.yml").read_text(), Loader=_Loader)  # noqa: S506 — our own, a SafeLoader


def test_every_page_stands_once_in_the_navigation(settings):
    assert sorted(listed(settings["nav"])) == [page.name for page in PAGES]


@pytest.mark.parametrize("page", PAPERS, ids=lambda page: page.name)
def test_every_link_and_anchor_leads_somewhere(page):
    for _, target in LINK.findall(prose(page.read_text())):
        name, _, anchor = target.partition("#")
        if name.startswith(("http://", "https://")):
            continue
        other = page.parent / urllib.parse.unquote(name) if name else page
        assert other.exists(), target
        if page.parent == DOCS:
            assert other.resolve().is_relative_to(DOCS), f"{target}: not on the site"
        if anchor and other.suffix == ".md":
            assert anchor in anchors(other), target


def test_every_picture_is_shown_made_by_a_command_and_drawn():
    shown = {target for page in PAPERS for is_image, target in LINK.findall(page.read_text()) if is_image}
    source = (ROOT / "benchmarks/doc_pictures.py").read_text()  # read, not imported: that takes seconds
    made = {f"images/doc/{name}.png" for name in re.findall(r'(?m)^    "([a-z-]+)": [\w"-]+,$', source)}
    assert len(made) > 15
    assert {target for target in shown if target.startswith("images/doc/")} == made
    assert {f"images/doc/{file.name}" for file in (DOCS / "images/doc").iterdir()} == made
    for name in made:
        with Image.open(DOCS / name) as picture:
            assert picture.width >= 400
            assert len(picture.getcolors(256)) > 8
        assert (DOCS / name).stat().st_size < 300_000


def test_the_page_of_public_names_is_that_of_the_docstrings():
    assert (DOCS / "api.md").read_text() == api_page(), "python -m benchmarks.api_page"


def test_the_site_asks_no_other_machine_for_anything(settings):
    assert settings["theme"]["font"] is False
    assert settings["use_directory_urls"] is False
    assert settings["strict"] is True
    for script in settings["extra"]["polyfills"]:
        assert (DOCS / script).is_file()
        assert (DOCS / script).with_name("LICENSE").is_file()


def test_a_broken_anchor_is_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# A title: `with` code, [and a link](x.md)\n```\n# no title\n```\n")
    assert anchors(page) == {"a-title-with-code-and-a-link"}
