"""The page of `hexsim live --web`, opened in a real browser."""

import threading
from urllib.parse import urlsplit

import pytest

from hexsim import HexsimError, load_scenario
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.simulation import simulate

pytest.importorskip("mjviser", reason="the page needs the extra: pip install 'hexsim[web]'")
from hexsim import web
from hexsim.web import browser

MOTION = load_scenario("heave", frequency_Hz=1.0)
NOISE = 0.02  # seeds of the sensors' noise and 2 periods for 8: the peaks of bench and hexapod differ by up to 0.6 %


def peak_of_run(**changes):
    bench = changed(load_machine("bench"), changes)
    return simulate(bench, MOTION).summary["axes"]["leg"]["peak_band_m_s2"]


@pytest.fixture(scope="module")
def peaks():
    """Peaks that a run says of the bench as declared, and with an overlap of 20 um; by then all is compiled."""
    return peak_of_run(), peak_of_run(**{"valve.overlap_m": 20e-6})


@pytest.fixture
def page(peaks):
    """A bench on its page, in a browser without a window; skipped where there is no browser."""
    served = web.Page(web.Session(load_machine("bench"), MOTION), "bench", "heave", port=8765)
    running = threading.Thread(target=served.run)
    running.start()
    try:
        with browser.opened(served.address) as shown:
            yield shown
    except HexsimError as error:
        pytest.skip(f"the page cannot be opened: {error}")
    finally:
        served.close()
        running.join(timeout=30.0)


@pytest.mark.slow  # a browser; what a widget takes is in test_gate.py, figures in flight in test_live.py
def test_a_slider_changes_the_peak_to_what_a_run_says_and_nothing_leaves_the_computer(page, peaks):
    """Overlap 5 to 20 um in 15 steps of the slider: the large digits say before and after what `hexsim run` says of these
    machines, the command line on the page is that run's, and everything that the browser asks for is on loopback."""
    declared, wide = peaks
    assert wide > 1.1 * declared  # far beyond the noise
    assert browser.wait_for_figures(page) == pytest.approx(declared, rel=NOISE)
    browser.move_slider(page, "Overlap [µm]", 15)
    assert browser.wait_for_figures(page, "--set valve.overlap_m=2e-05") == pytest.approx(wide, rel=NOISE)
    hosts = {urlsplit(address.removeprefix("blob:")).hostname for address in page.asked_for}
    assert hosts == {"127.0.0.1"}


@pytest.mark.slow
def test_a_phone_in_the_dark_sees_the_machine_and_its_bump(page):
    """390 x 844 px, a browser that asks for dark: dark ground, the figures without a touch, and half the height for the machine."""
    page.emulate_media(color_scheme="dark")
    page.set_viewport_size({"width": 390, "height": 844})
    page.reload()
    peak = page.locator("#hexsim-peak")
    peak.wait_for(state="visible")
    page.wait_for_timeout(1000.0)  # the sheet unfolds
    assert page.evaluate("document.documentElement.dataset.mantineColorScheme") == "dark"
    place = peak.bounding_box()
    assert 0.5 * 844 < place["y"] < 844 - place["height"]
    view = page.locator("canvas").first.bounding_box()
    assert view["height"] >= 0.5 * 844 and view["y"] + view["height"] <= place["y"]
