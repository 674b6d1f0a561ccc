"""The interactive page, in a real browser: it reacts, and shows the library's results."""

import json
import shutil
import webbrowser

import jax.numpy as jnp
import pytest
from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

import jaxcontact as jc
from jaxcontact.lab.cli import main
from jaxcontact.lab.explore import GRIDS, page

E, N, ALPHA = 0.37, 1.85, 2.35
MASS, STIFFNESS, SPEED = 0.03, 2.5e7, 1.7
SHOWN = 0.51  # half a unit of the last digit shown, and the possible effect of interpolation


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if chromium is None or driver is None:
        why = "there is no chromium, or no chromedriver (Debian: chromium-driver)"
        pytest.skip(why)  # `pip` cannot bring programs of the system; `.ci/run` installs them
    file = tmp_path_factory.mktemp("explore") / "explore.html"
    assert main(["explore", "--no-open", "--out", str(file), "--quiet"]) == 0
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for option in ("headless=new", "no-sandbox", "disable-dev-shm-usage", "window-size=1200,1000"):
        options.add_argument(f"--{option}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    opened = webdriver.Chrome(options, webdriver.ChromeService(driver))
    opened.get(file.as_uri())
    yield opened
    opened.quit()


def give(browser, **values):
    """Set inputs as a hand does, which sends an event for each."""
    for name, value in values.items():
        browser.execute_script(
            "const x = document.getElementById(arguments[0]); x.value = arguments[1];"
            "x.dispatchEvent(new Event('input'))",
            name,
            value,
        )


def rows(browser, table="rows"):
    """The cells of a table by law, as text."""
    return browser.execute_script(
        "return Object.fromEntries([...document.querySelectorAll(`#${arguments[0]} tr`)].map("
        "(row) => [row.dataset.law, [...row.cells].map((cell) => cell.innerText)]))",
        table,
    )


def pictures(browser):
    return browser.execute_script(
        "return [...document.querySelectorAll('canvas')].map((x) => x.toDataURL())"
    )


PREFIX = {"M": 1e6, "k": 1e3, "": 1.0, "m": 1e-3, "µ": 1e-6, "n": 1e-9}


def agrees(text, value):
    """Whether a number is what a text says, as 0.4877 or 10.83 kN, to its last digit."""
    number, _, unit = text.partition(" ")
    size = PREFIX[unit[:-1]]
    last = 10.0 ** -len(number.partition(".")[2])
    return abs(float(number) - float(value) / size) <= SHOWN * last


def of_e():
    """The laws of one parameter e with their contacts, and the law of the slider α."""
    laws = json.loads(GRIDS.read_text(encoding="utf-8"))["laws"]
    assert set(laws) == {
        name for name in jc.list_laws() if list(jc._laws.describe(name).parameters) == ["e"]
    }
    found = {"yours": (jc.Damped(alpha=ALPHA), jc.Contact(MASS, STIFFNESS, N))}
    for name, grid in laws.items():
        law = jc.get_law(name, e=E)
        # Laws of the family differ by α only, and share a program.
        if isinstance(law, jc.AbstractHuntCrossley):
            law = jc.Damped(alpha=law.damping_factor())
        found[name] = law, jc.Contact(MASS, STIFFNESS, grid["exponent"] or N)
    return found


def assert_shown(shown, laws):
    """Assert that a table shows the results of impacts by these laws."""
    assert set(shown) == set(laws)
    for name, (law, contact) in laws.items():
        hit = jc.impact(law, contact, SPEED)
        wanted = (hit.restitution, hit.max_force, hit.duration, hit.max_indentation)
        assert all(map(agrees, shown[name][1:], wanted)), (name, shown[name], wanted)


def test_the_values_shown_are_those_of_the_library(browser):
    give(browser, e=E, n=N, alpha=ALPHA, mass=MASS, stiffness=STIFFNESS, speed=SPEED)
    for box in browser.find_elements(By.CSS_SELECTOR, "#laws input:not(:checked)"):
        box.click()
    assert_shown(rows(browser), of_e())


YIELD, RATIO, ADHESION, STICKING = 0.15, 1.6, 0.7, 0.45
# Steps of the curve e(v), 0.02 of the scaled time: measured below 5e-5 for all sliders.
CURVE = 1e-4


def of_speed(sticking=STICKING):
    """The laws whose e depends on speed with the numbers of the sliders, and their contacts."""
    spheres = jc.Contact(MASS, STIFFNESS)
    spring = jc.Contact(MASS, STIFFNESS, 1.0)
    slope = (RATIO - 1) * (STIFFNESS / MASS) ** 0.5 / SPEED
    # The sticking speed goes as the power 5/6 of the pull-off force.
    pull_off = (sticking * SPEED / float(jc.JKR(pull_off=1.0).sticking_speed(spheres))) ** 1.2
    yields = YIELD * SPEED
    wet = jc.WetRestitution(e=E, critical_speed=sticking * SPEED)
    return {
        "thornton_plastic": (jc.ThorntonPlastic(yield_speed=yields), spheres),
        "viscoplastic": (jc.Viscoplastic(yields, c=ALPHA * STIFFNESS / SPEED), spheres),
        "walton_braun": (jc.WaltonBraun(ratio=1.0, slope=slope), spring),
        "luding": (jc.Luding(ratio=1.0, slope=slope, adhesion=ADHESION), spring),
        "jkr": (jc.JKR(pull_off=pull_off), spheres),
        "dmt": (jc.DMT(pull_off=pull_off), spheres),
        "wet_restitution": (wet, jc.Contact(MASS, STIFFNESS, N)),
    }


def test_laws_that_depend_on_speed_are_those_of_the_library(browser):
    give(browser, e=E, n=N, alpha=ALPHA, mass=MASS, stiffness=STIFFNESS, speed=SPEED)
    sliders = {"yield": YIELD, "ratio": RATIO, "adhesion": ADHESION, "sticking": STICKING}
    give(browser, **sliders)
    shown, times = rows(browser, "speed-rows"), [0.4, 1.0, 6.0]
    curves = browser.execute_script(
        "return Object.fromEntries(ofSpeed().map("
        "(law) => [law.name, arguments[0].map((s) => restitution(law, s))]))",
        times,
    )
    assert_shown(shown, of_speed())
    for name, (law, contact) in of_speed().items():
        e = jc.restitution(law, contact, SPEED * jnp.asarray(times))
        assert curves[name] == pytest.approx(e.tolist(), abs=CURVE), name
    # Bodies that stick.
    give(browser, sticking=1.1)
    shown = rows(browser, "speed-rows")
    hit = jc.impact(*of_speed(1.1)["jkr"], SPEED)
    assert shown["jkr"][1] == "0.0000 (sticks)" and shown["jkr"][3] == "–"
    assert agrees(shown["jkr"][2], hit.max_force) and agrees(shown["jkr"][4], hit.max_indentation)
    assert shown["wet_restitution"][1:] == ["0.0000 (sticks)", "–", "–", "–"]
    give(browser, sticking=STICKING)


@pytest.mark.parametrize(
    ("sliders", "table", "boxes"),
    [
        (("e", "n", "alpha"), "rows", "#laws input"),
        (("yield", "ratio", "adhesion", "sticking"), "speed-rows", "#speed-laws input"),
    ],
)
def test_it_moves(browser, sliders, table, boxes):
    for name in sliders:
        before, drawn = rows(browser, table), pictures(browser)
        browser.find_element(By.ID, name).send_keys(Keys.ARROW_RIGHT)
        assert rows(browser, table) != before
        assert pictures(browser) != drawn
    box = browser.find_element(By.CSS_SELECTOR, boxes)
    before = rows(browser, table)
    box.click()
    assert set(before) - set(rows(browser, table)) == {box.get_attribute("value")}


def test_bad_numbers_are_told(browser):
    give(browser, speed=-1)
    assert "closing speed must be a positive" in browser.find_element(By.ID, "fault").text
    give(browser, speed=SPEED)
    assert browser.find_element(By.ID, "fault").text == ""


def test_it_fits_a_phone(browser):
    size = {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    assert browser.execute_script("return document.documentElement.scrollWidth") <= 390
    widths = browser.execute_script(
        "return [...document.querySelectorAll('.u-wrap')].map((x) => x.clientWidth)"
    )
    assert len(widths) == 4 and all(250 < width <= 390 for width in widths)


def test_it_complains_of_nothing_and_asks_no_network(browser):
    assert browser.get_log("browser") == []
    assert browser.execute_script("return performance.getEntriesByType('resource').length") == 0


def test_the_command_opens_the_page(tmp_path, monkeypatch, capsys):
    asked = []
    monkeypatch.setattr(webbrowser, "open", lambda url: asked.append(url) or True)
    monkeypatch.setenv("JAXCONTACT_CACHE", str(tmp_path))
    assert main(["explore", "--quiet", "--no-cache"]) == 0
    file = tmp_path / "explore.html"
    assert file.read_text(encoding="utf-8") == page()
    assert asked == [file.as_uri()] and str(file) in capsys.readouterr().out
    monkeypatch.setenv("JAXCONTACT_CACHE", "")
    assert main(["explore"]) == 2
    assert "--out is needed" in capsys.readouterr().err
    assert len(page()) < 300e3
