"""A picture of a page, by a headless Chromium: `python -m studies.screenshot demo/report.html report.png`."""

import shutil
import sys
from pathlib import Path

SIZE = 1200, 760  # [px]
FLAGS = ("headless", "no-sandbox", "hide-scrollbars", "use-angle=swiftshader", "enable-unsafe-swiftshader")


def screenshot(page: Path, picture: Path, part: str = "#view") -> None:
    """Write a PNG of one part of a page, a CSS selector; raises RuntimeError if Chromium is not installed."""
    from selenium import webdriver
    from selenium.webdriver.common.by import By

    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not (chromium and driver):
        raise RuntimeError("chromium and chromedriver are not installed; apt-get install chromium chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for flag in (*FLAGS, f"window-size={SIZE[0]},{SIZE[1]}"):
        options.add_argument(f"--{flag}")
    window = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    try:
        window.get(page.resolve().as_uri())
        picture.write_bytes(window.find_element(By.CSS_SELECTOR, part).screenshot_as_png)
    finally:
        window.quit()


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1].startswith("-"):
        sys.exit(__doc__)
    screenshot(Path(sys.argv[1]), Path(sys.argv[2]))
