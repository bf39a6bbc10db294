"""The site: every link of it leads somewhere, it needs no network, and the way to a guarded design is short."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote

import pytest
from conftest import ROOT
from layout import laid_out, whole_files
from links import Page, faults
from pages import chromium, needs_chromium, opened

from vctune.api.explaining import entries

TELEPHONE, DESK = {"width": 390, "height": 844}, {"width": 1280, "height": 900}
WIDE = ["index.html", "vctune/model/README.html", "vctune/document/README.html", "results/README.html",
        "explain/keys.html", "reference/functions.html"]  # fmt: skip
"""Pages with wide tables, formulas, figures and signatures."""
WALK = ["index.html", "docs/tutorials/log-to-firmware.html", "vctune/cli/README.html", "vctune/firmware/README.html"]
"""From the front page to a certified design, its check in CI and the exported controller."""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The built site."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run([sys.executable, ROOT / "docs/make.py", folder], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """The pages as Sphinx reads them."""
    folder = tmp_path_factory.mktemp("pages")
    laid_out(folder)
    return folder


def test_every_guide_and_every_name_that_is_explained_has_a_page(pages):
    for guide in (ROOT / "vctune").rglob("README.md"):
        assert (pages / guide.relative_to(ROOT)).exists()
    explained = "".join(path.read_text("utf-8") for path in (pages / "explain").glob("*.md"))
    assert explained.count("\n### `") == len(entries())


def test_the_table_of_contents_names_pages_that_are_there(pages):
    front = (pages / "index.md").read_text("utf-8")
    listed = [line for block in front.split("```{toctree}\n")[1:] for line in block.partition("```")[0].splitlines()]
    names = [line for line in listed if line and not line.startswith(":")]
    assert len(names) > 25 and all((pages / f"{name}.md").exists() for name in names)


def test_links_that_lead_nowhere_are_found(tmp_path):
    other = '<p id="there"></p>'
    (tmp_path / "other.html").write_text(other)
    links = ["other.html#there", "#here", "https://example.org/", "gone.html", "other.html#gone", "#gone"]
    written = "".join(f'<a href="{link}">' for link in links)
    (tmp_path / "page.html").write_text(f'<h1 id="here">{written}<script src="https://example.org/x.js"></script>')
    found = faults(tmp_path)
    assert len(found) == 4
    for fault in ("#gone leads", "gone.html leads", "other.html#gone leads", "loads https://example.org/x.js"):
        assert any(fault in line for line in found)


@pytest.mark.slow
def test_the_site_is_built_without_a_warning_and_its_links_lead_somewhere(site):
    assert len([*site.rglob("*.html")]) > 90
    whole_files(site)
    assert faults(site) == []


@pytest.mark.slow
def test_at_most_five_pages_lead_from_the_front_to_ci_and_firmware(site):
    assert len(WALK) <= 5
    for number, there in enumerate(WALK[1:], start=1):
        assert any(leads(site / page, site / there) for page in WALK[:number]), there
    told = [(site / page).read_text("utf-8") for page in WALK]
    assert "certified" in told[1] and "vctune check" in told[2] and "vctune_step" in told[3]


def leads(page: Path, target: Path) -> bool:
    links = Page(page.read_text("utf-8")).leads
    return any((page.parent / unquote(link.partition("#")[0])).resolve() == target.resolve() for link in links)


@pytest.mark.slow
@needs_chromium
def test_pages_fit_a_telephone_and_a_desk_in_light_and_dark_without_a_network(site):
    with chromium() as browser:
        for size in (TELEPHONE, DESK):
            grounds = set()
            for scheme in ("light", "dark"):
                for name in WIDE:
                    page = opened(browser, site / name, viewport=size, color_scheme=scheme, offline=True)
                    assert page.said == []
                    assert page.evaluate("document.documentElement.scrollWidth") <= size["width"], name
                grounds.add(page.evaluate("getComputedStyle(document.body).backgroundColor"))
            assert len(grounds) == 2


@pytest.mark.slow
@needs_chromium
def test_the_search_finds_a_code_from_a_file(site):
    with chromium() as browser:
        page = opened(browser, site / "search.html", offline=True)
        page.goto(f"{(site / 'search.html').as_uri()}?q=warn-band-edge")
        page.wait_for_selector("#search-results li")
        assert "codes" in page.inner_text("#search-results").lower()
