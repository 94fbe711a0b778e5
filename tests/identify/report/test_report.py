"""The report as a reader gets it: self-contained, harmless, readable on a telephone and on a desk."""

import json
import os
import re
import shutil
from base64 import b64decode
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from measured import poses_over_jig, positions_at, table_2, touches_at

from identify.estimation.calibrate import calibrate
from identify.estimation.verification import verify
from identify.model.cell import Cell
from identify.model.io.calibration_file import Finding, Term
from identify.model.jig import Jig
from identify.report.findings import chosen, findings
from identify.report.report import report
from identify.uncertainty.posterior import zone_promise
from identify.uncertainty.zone_map import zone_map

HOSTILE = "<script>document.title='owned'</script><!--"


@pytest.fixture(scope="module")
def measured(arc_welder):
    rng = np.random.default_rng(8)
    return touches_at(arc_welder, table_2(arc_welder), poses_over_jig(arc_welder, 80, rng), rng)


@pytest.fixture(scope="module")
def calibration(arc_welder, measured):
    return calibrate(arc_welder, measured, errors="cell")


@pytest.fixture(scope="module")
def html(calibration, measured, arc_welder):
    rng = np.random.default_rng(9)
    unseen = positions_at(arc_welder, table_2(arc_welder), poses_over_jig(arc_welder, 50, rng), rng)
    return report(calibration, [measured], verify(calibration, unseen))


def test_the_page_is_one_file_below_a_megabyte_that_fetches_nothing(html):
    assert len(html.encode()) < 1_000_000
    own = re.sub(r"<script>.*?</script>", "", html, flags=re.S)
    assert not re.search(r"""(src|href)\s*=|url\(|@import""", own)
    assert "default-src 'none'" in html


def test_every_chart_has_titles_and_units(html):
    figures = re.findall(r"<figure.*?</figure>", html, flags=re.S)

    assert len(figures) == 9  # three slices and their scale, residuals twice, singular values, correlations, ladder
    assert all("<figcaption>" in f and "aria-label" in f for f in figures)
    assert "residual, mm" in html
    assert "expected tip error (RMS), mm" in html


def test_a_calibration_without_a_promise_gets_that_of_its_zone(calibration, measured):
    page = report(replace(calibration, promise=None), [measured])

    expected = zone_promise(calibration)
    assert f"within {expected.p95_mm:.2f} mm at 95 % of the poses" in page


def test_promised_and_delivered_stand_in_one_line(calibration, measured):
    promised = replace(calibration, promise={"rms_mm": 0.05, "p95_mm": 0.123})

    page = report(promised, [measured])

    assert "within 0.12 mm at 95 % of the poses, for 95 of 100 robots like this" in page
    assert "Not verified yet" in page


def test_where_the_fit_had_no_data_stands_below_the_verdict(calibration, measured):
    narrow = replace(calibration, spans=calibration.spans | {"z mm": (1e3, 2e3)})

    said = "Of the weld zone, beyond the data of the fit: z"

    assert said in report(narrow, [measured])
    assert said not in report(calibration, [measured])


def test_a_face_that_stands_elsewhere_is_named_with_its_interval(calibration, measured):
    k = next(i for i, value in enumerate(calibration.shared) if value.name == "face.top-high")
    faces = list(calibration.shared)
    faces[k] = replace(faces[k], value=0.5)

    page = report(replace(calibration, shared=tuple(faces)), [measured])

    assert re.search(r"face top-high \[mm\]</td>.*?\+0\.500</td>.*?stands elsewhere than the jig file says", page)
    assert page.count("stands elsewhere") == 1


def test_hostile_names_appear_only_escaped(calibration, measured, arc_welder):
    robot = replace(arc_welder.robot, name=HOSTILE)
    cell = Cell(robot, Jig(HOSTILE, arc_welder.jig.faces), arc_welder.base, arc_welder.tool, zone=arc_welder.zone)
    names = tuple(HOSTILE + name for name in measured.ids)
    touches = replace(measured, ids=names, face=(HOSTILE,) * len(names))
    residuals = dict(zip(names, calibration.residuals.values(), strict=True))

    page = report(replace(calibration, cell=cell, residuals=residuals, outliers={names[0]: 5.0}), [touches])

    assert HOSTILE not in page
    assert "document.title='owned'</script>" not in page


def test_the_scene_holds_the_touches_where_the_true_kinematics_puts_them(html, arc_welder, measured):
    data = json.loads(re.search(r'id="scene">(.*?)</script>', html, flags=re.S).group(1))

    assert [t["id"] for t in data["touches"]] == list(measured.ids)
    tip = arc_welder.kinematics.tip(measured.q, arc_welder.theta)[0]
    np.testing.assert_allclose([t["nominal"][-1] for t in data["touches"]], tip, atol=0.051)


def test_the_map_of_the_zone_is_the_covariance_carried_to_the_tip(calibration):
    zone = zone_map(calibration)

    assert 0.01 < np.nanmedian(zone.error) < 0.2
    assert np.isnan(zone.error).mean() < 0.3
    doubled = zone_map(replace(calibration, covariance=4 * calibration.covariance))
    np.testing.assert_allclose(doubled.error, 2 * zone.error, rtol=1e-9)


@pytest.fixture(scope="module")
def browser():
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not (chromium and driver):
        assert not os.environ.get("CI"), "chromium and chromedriver must be installed in CI"
        pytest.skip("chromium or chromedriver is not installed")
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    quiet = [
        "disable-quic",
        "no-first-run",
        "disable-background-networking",
        "disable-component-update",
        "disable-sync",
    ]
    for flag in ["headless", "no-sandbox", "use-angle=swiftshader", "enable-unsafe-swiftshader", *quiet]:
        options.add_argument(f"--{flag}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    window = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    yield window
    window.quit()


@contextmanager
def emulated(browser, **media):
    """A screen that prefers dark colours, or paper."""
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
    try:
        yield
    finally:
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})


def opened(browser, text, folder, width):
    path = folder / "report.html"
    path.write_text(text)
    browser.set_window_size(width, 900)
    browser.get_log("browser")
    browser.get(path.as_uri())
    return [entry for entry in browser.get_log("browser") if entry["level"] in ("SEVERE", "WARNING")]


def canvas_colours(browser):
    """How many different colours the 3-D view shows."""
    return browser.execute_script(
        "const c = document.querySelector('#view canvas'), d = document.createElement('canvas');"
        "d.width = 200; d.height = 150; const x = d.getContext('2d'); x.drawImage(c, 0, 0, 200, 150);"
        "const p = x.getImageData(0, 0, 200, 150).data, s = new Set();"
        "for (let i = 0; i < p.length; i += 4) s.add(p[i] << 16 | p[i + 1] << 8 | p[i + 2]); return s.size;"
    )


@pytest.mark.parametrize("width", [360, 1400])
def test_the_page_opens_without_errors_and_fits_the_window(width, browser, html, tmp_path):
    errors = opened(browser, html, tmp_path, width)

    assert [e for e in errors if "WebGL" not in e["message"] and "GPU" not in e["message"]] == []
    wide = browser.execute_script("return [document.documentElement.scrollWidth, window.innerWidth]")
    assert wide[0] <= wide[1] + 1
    assert canvas_colours(browser) > 20


def test_a_dark_screen_gets_a_dark_page_and_a_dark_view(browser, html, tmp_path):
    features = [{"name": "prefers-color-scheme", "value": "dark"}]
    with emulated(browser, features=features):
        opened(browser, html, tmp_path, 1400)
        paper, ink = browser.execute_script(
            "const s = getComputedStyle(document.body); return [s.backgroundColor, s.color];"
        )
        corner = browser.execute_script(
            "const c = document.querySelector('#view canvas'), d = document.createElement('canvas');"
            "d.width = d.height = 1; const x = d.getContext('2d'); x.drawImage(c, 0, 0, 1, 1, 0, 0, 1, 1);"
            "return [...x.getImageData(0, 0, 1, 1).data].slice(0, 3);"
        )

    dark, light = (sum(map(int, re.findall(r"\d+", text))) for text in (paper, ink))
    assert dark < 150 < 600 < light
    assert sum(corner) < 200


def test_every_cell_of_a_table_names_its_column_on_a_telephone(browser, html, tmp_path):
    opened(browser, html, tmp_path, 360)

    cut = browser.execute_script(
        "return [...document.querySelectorAll('.wide')].filter(e => e.scrollWidth > e.clientWidth + 1).length"
    )
    heads = browser.execute_script(
        "return [...document.querySelectorAll('td:nth-child(2)')].map(e => getComputedStyle(e, '::before').content)"
    )
    assert cut == 0
    assert '"n"' in heads


def test_the_report_prints_on_three_pages(browser, html, tmp_path):
    opened(browser, html, tmp_path, 1400)

    printed = b64decode(browser.execute_cdp_cmd("Page.printToPDF", {"paperWidth": 8.27, "paperHeight": 11.69})["data"])

    assert len(re.findall(rb"/Type\s*/Page\b", printed)) <= 3


PAPER = [(718, 1047), (740, 980)]  # [px] of A4 and letter within their margins


@pytest.mark.parametrize("paper", PAPER, ids=["A4", "letter"])
@pytest.mark.parametrize("page", ["report", "plan"])
def test_on_paper_nothing_is_cut_and_nothing_asks_for_a_mouse(paper, page, browser, html, plan_html, tmp_path):
    wide, high = paper
    opened(browser, html if page == "report" else plan_html, tmp_path, 1400)
    screen = {"width": wide, "height": high, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})

    try:
        beyond = browser.execute_script(
            "const wide = e => e.clientWidth && e.scrollWidth > e.clientWidth + 1;"
            "return [...document.querySelectorAll('.wide, figure, svg, table, p')].filter("
            "e => wide(e) || e.getBoundingClientRect().right > innerWidth + 1).map(e => e.outerHTML)"
        )
        tall = browser.execute_script(
            "return [...document.querySelectorAll('figure, .maps, #view')].map(e => e.getBoundingClientRect().height)"
        )
        text = browser.execute_script("return document.body.innerText")
    finally:
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})

    assert beyond == []
    assert max(tall) < 0.6 * high
    assert "arrow keys" not in text
    assert not re.search(r"^(back|next)$", text, flags=re.M)


def test_the_whole_scene_is_in_the_frame_whatever_its_shape(browser, html, tmp_path):
    for width in (360, 1400):
        opened(browser, html, tmp_path, width)

        edge = browser.execute_script(
            "const c = document.querySelector('#view canvas'), d = document.createElement('canvas');"
            "d.width = c.width; d.height = c.height; const x = d.getContext('2d'); x.drawImage(c, 0, 0);"
            "const dark = (...at) => [...x.getImageData(...at).data].filter((p, i) => i % 4 == 0 && p < 120).length;"
            "return dark(0, 0, c.width, 3) + dark(0, c.height - 3, c.width, 3)"
            " + dark(0, 0, 3, c.height) + dark(c.width - 3, 0, 3, c.height);"
        )

        assert edge == 0, f"{width} px: robot, jig or zone reach beyond the frame"


def test_the_view_steps_and_orbits(browser, html, tmp_path):
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.by import By

    opened(browser, html, tmp_path, 1400)
    view = browser.find_element(By.ID, "view")
    first, before = browser.find_element(By.ID, "caption").text, view.get_attribute("data-camera")

    browser.find_element(By.ID, "next").click()
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", view)
    ActionChains(browser).move_to_element(view).click_and_hold().move_by_offset(120, 40).release().perform()

    assert view.get_attribute("data-step") == "1"
    assert browser.find_element(By.ID, "caption").text != first
    assert view.get_attribute("data-camera") != before


def test_the_keyboard_turns_the_view_and_steps_through_the_touches(browser, html, tmp_path):
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    opened(browser, html, tmp_path, 1400)
    view = browser.find_element(By.ID, "view")
    cameras = [view.get_attribute("data-camera")]
    for key in (Keys.ARROW_LEFT, Keys.ARROW_UP, "+"):
        view.send_keys(key)
        cameras.append(view.get_attribute("data-camera"))
    view.send_keys(Keys.PAGE_DOWN)

    distance = [np.linalg.norm(np.array(camera.split(","), dtype=float)) for camera in cameras]
    assert len(set(cameras)) == 4
    assert distance[3] < distance[2]
    assert view.get_attribute("data-step") == "1"
    assert "(2 of 80)" in browser.find_element(By.CSS_SELECTOR, "#view canvas").get_attribute("aria-label")


def test_a_hostile_cell_is_harmless_in_the_browser(browser, calibration, measured, arc_welder, tmp_path):
    robot = replace(arc_welder.robot, name=HOSTILE)
    cell = Cell(robot, arc_welder.jig, arc_welder.base, arc_welder.tool, zone=arc_welder.zone)
    touches = replace(measured, face=(HOSTILE,) * len(measured))

    opened(browser, report(replace(calibration, cell=cell), [touches]), tmp_path, 1400)

    assert browser.title != "owned"
    assert HOSTILE in browser.execute_script("return document.body.innerText")


def test_joint_errors_and_findings_stand_in_the_page(calibration, measured):
    told = replace(
        calibration,
        choice=(Term("compliance", 0.08, 0.17, 0.006, True),),
        findings=(Finding("drift", "the tip moves by 1 mm"),),
    )

    page = report(told, [measured])

    assert chosen(told) in page
    assert findings(told) in page


def test_the_page_of_a_plan_steps_through_its_touches_and_a_hostile_name_is_harmless(browser, plan_html, tmp_path):
    from selenium.webdriver.common.by import By

    errors = opened(browser, plan_html, tmp_path, 1400)
    first = browser.find_element(By.ID, "caption").text
    browser.find_element(By.ID, "next").click()

    assert [e for e in errors if "WebGL" not in e["message"] and "GPU" not in e["message"]] == []
    assert browser.find_element(By.ID, "caption").text != first
    assert canvas_colours(browser) > 20
    assert browser.title != "owned"
    assert HOSTILE in browser.execute_script("return document.body.innerText")
