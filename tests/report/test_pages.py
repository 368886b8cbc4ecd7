"""Pages in a real browser: figures drawn, zoomed, switched, saved; on dark screens and paper; nothing fetched."""

import os
import shutil
from pathlib import Path

import pytest

from optid.results.loading import RESULTS
from tests.results.examples import MAKERS

MOST = 1.5e6  # bytes of a page
KEPT = os.environ.get("OPTID_SCREENSHOTS")  # a folder to keep screenshots in
# The first's page in tests/test_cli_identify.py; that of a fleet without nights has no figure.
DRAWN_ELSEWHERE = {"IdentificationResult", "FitResult", "FleetResult"}
PAGES = [kind for kind in RESULTS if kind.__name__ not in DRAWN_ELSEWHERE]
# What a figure has on its canvas: paths with a length, and dots.
INK = """place => [...place.querySelectorAll('.js-line, .point, .js-fill')]
    .filter(mark => mark.getBoundingClientRect().width + mark.getBoundingClientRect().height > 0).length"""


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api")
    path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if path is None:
        pytest.skip("no Chromium on this machine")
    with playwright.sync_playwright() as started:
        opened = started.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield opened
        opened.close()


def opened(browser, place, **screen):
    """The page with its figures drawn, and everything that its console said or that it asked the network for."""
    page, heard = browser.new_page(viewport={"width": 1100, "height": 900}, **screen), []
    page.on("console", lambda message: heard.append(message.text))
    page.on("pageerror", lambda error: heard.append(str(error)))
    page.on(
        "request",
        lambda request: (
            None if request.url.startswith(("file:", "data:", "blob:")) else heard.append(request.url)
        ),
    )
    page.goto(place.as_uri())
    page.wait_for_selector("html[data-figures]", state="attached", timeout=120_000)
    assert page.evaluate("document.documentElement.dataset.figures") == "drawn", heard
    return page, heard


@pytest.mark.parametrize("kind", PAGES, ids=lambda kind: kind.__name__)
def test_a_page_stands_alone_and_draws_all_of_its_figures(kind, browser, tmp_path):
    place = MAKERS[kind]().save(tmp_path) / "report.html"
    assert place.stat().st_size <= MOST
    page, heard = opened(browser, place)
    figures = page.query_selector_all(".figure")
    assert figures and all(figure.evaluate(INK) for figure in figures)
    assert heard == []
    text = page.inner_text("body")
    assert " um" not in text and "−0 " not in text and "None" not in text and "nan" not in text.split()
    if KEPT:
        page.screenshot(path=Path(KEPT) / f"{kind.__name__}.png", full_page=True)
    page.close()


@pytest.fixture(scope="module")
def shown(browser, tmp_path_factory):
    from optid.results.diagnosis import DiagnosisResult

    place = MAKERS[DiagnosisResult]().save(tmp_path_factory.mktemp("shown")) / "report.html"
    page, _ = opened(browser, place, color_scheme="dark")
    yield page
    page.close()


def ranges(page):
    return page.evaluate(
        "(f => [f.layout.xaxis.range, f.layout.xaxis2.range, f.layout.yaxis.range])(document.querySelector('.figure'))"
    )


def test_a_figure_zooms_both_of_its_panels_and_back(shown):
    before = ranges(shown)
    box = shown.query_selector(".figure .nsewdrag").bounding_box()
    shown.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 0.3 * box["height"])
    shown.mouse.down()
    shown.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.7 * box["height"], steps=4)
    shown.mouse.up()
    shown.wait_for_function(f"document.querySelector('.figure').layout.xaxis.range[1] < {0.9 * before[0][1]}")
    across, below, _ = ranges(shown)
    assert across[1] - across[0] < 0.5 * (before[0][1] - before[0][0])
    assert below == across
    shown.mouse.dblclick(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    shown.wait_for_function(f"document.querySelector('.figure').layout.xaxis.range[1] > {0.9 * before[0][1]}")


def test_the_pointer_reads_values(shown):
    box = shown.query_selector(".figure .nsewdrag").bounding_box()
    for share in (0.4, 0.45, 0.5, 0.55):
        for height in (0.2, 0.4, 0.5, 0.6, 0.8):
            shown.mouse.move(box["x"] + share * box["width"], box["y"] + height * box["height"])
            shown.wait_for_timeout(60)
            if shown.query_selector(".figure .hoverlayer .hovertext"):
                return
    pytest.fail("no value under the pointer")


def test_a_trace_is_switched_by_its_name(shown):
    name = shown.query_selector(".figure .legendtoggle")
    name.click()
    shown.wait_for_function(
        "document.querySelector('.figure').data.some(trace => trace.visible === 'legendonly')"
    )


def test_a_figure_is_saved(shown):
    shown.hover(".figure")
    with shown.expect_download() as kept:
        shown.click(".figure .modebar-btn[data-title*='Download']")
    assert kept.value.suggested_filename == "position before and after.svg"
    assert "<svg" in Path(kept.value.path()).read_text(encoding="utf-8")


def test_a_dark_screen_has_light_ink(shown):
    assert shown.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(21, 24, 28)"
    inks = shown.evaluate("[...document.querySelector('.figure').data].map(trace => trace.line?.color)")
    assert "rgba(226,230,234,1)" in inks and "rgba(43,47,54,1)" not in inks


def test_a_page_prints(browser, shown, tmp_path):
    shown.pdf(path=tmp_path / "page.pdf")
    assert (tmp_path / "page.pdf").read_bytes()[:4] == b"%PDF"
    shown.emulate_media(media="print")
    assert shown.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
