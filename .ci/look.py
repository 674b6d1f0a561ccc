"""Opens every page of a built site in Chromium at two widths; fails on what would stop a reader.

That is an error in the console, a page wider than the window, a picture that is not there, a link
that leads nowhere, and anything fetched from elsewhere. `look.py SITE FOLDER` keeps pictures.
"""

import shutil
import sys
from pathlib import Path
from urllib.parse import unquote, urlsplit

from selenium import webdriver

WIDTHS = (1200, 390)
LOOK = """
const own = new URL('.', document.baseURI);
return {
  width: document.documentElement.scrollWidth,
  broken: [...document.images].filter((x) => !x.naturalWidth).map((x) => x.src),
  links: [...document.links].map((x) => x.href),
  ids: [...document.querySelectorAll('[id]')].map((x) => x.id),
  fetched: performance.getEntriesByType('resource').map((x) => x.name),
};
"""


def chromium():
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium")
    for option in ("headless=new", "no-sandbox", "disable-dev-shm-usage", "hide-scrollbars"):
        options.add_argument(f"--{option}")
    options.set_capability("goog:loggingPrefs", {"browser": "SEVERE"})
    return webdriver.Chrome(options, webdriver.ChromeService(shutil.which("chromedriver")))


def main(site: Path, keep: Path | None) -> int:
    pages = sorted(p for p in site.rglob("*.html") if p.name != "404.html")
    browser, wrong, links, ids = chromium(), [], {}, {}
    try:
        for width in WIDTHS:
            size = {"width": width, "height": 1000, "deviceScaleFactor": 1, "mobile": width < 500}
            browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
            for page in pages:
                name = str(page.relative_to(site))
                browser.get(page.as_uri())
                seen = browser.execute_script(LOOK)
                if seen["width"] > width:
                    wrong.append(f"{name}: {seen['width']} wide at {width}")
                wrong += [f"{name}: no picture {x}" for x in seen["broken"]]
                wrong += [f"{name}: fetches {x}" for x in seen["fetched"] if x.startswith("http")]
                wrong += [f"{name}: {x['message']}" for x in browser.get_log("browser")]
                links[page], ids[page] = seen["links"], set(seen["ids"])
                if keep is not None:
                    keep.mkdir(parents=True, exist_ok=True)
                    stem = name.removesuffix(".html").replace("/", "-")
                    browser.save_screenshot(str(keep / f"{stem}-{width}.png"))
    finally:
        browser.quit()
    for page, targets in links.items():
        for target in set(targets):
            parts = urlsplit(target)
            if parts.scheme != "file":
                continue
            file, anchor = Path(unquote(parts.path)), unquote(parts.fragment)
            if not file.is_file():
                wrong.append(f"{page.relative_to(site)}: leads nowhere: {target}")
            elif anchor and file in ids and anchor not in ids[file]:
                wrong.append(f"{page.relative_to(site)}: no place {anchor} in {file.name}")
    print(*sorted(set(wrong)), f"{len(pages)} pages, {len(set(wrong))} faults", sep="\n")
    return min(len(wrong), 1)


if __name__ == "__main__":
    site, *folder = map(Path, sys.argv[1:])
    sys.exit(main(site.resolve(), folder[0] if folder else None))
