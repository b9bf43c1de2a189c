"""A browser without a window, which opens the page: for its pictures, and to test it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from hexsim.errors import HexsimError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
DRAWS_WITHOUT_GPU = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")


@contextmanager
def opened(
    address: str,
    *,
    slowest_ms: float = 240_000.0,  # a computer that draws without a graphics card, and is busy
) -> Iterator[Any]:
    """A page of Playwright that shows `address`. Raises HexsimError where there is no Playwright or no browser."""
    try:
        from playwright.sync_api import sync_playwright
    except ModuleNotFoundError:
        raise HexsimError("no Playwright here: pip install playwright") from None
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        raise HexsimError(f"no browser on the PATH: install one of {', '.join(BROWSERS)}")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox", *DRAWS_WITHOUT_GPU])
        try:
            page: Any = browser.new_page(viewport={"width": 1500, "height": 900})
            page.set_default_timeout(slowest_ms)
            page.asked_for = []  # addresses of everything that it loads
            page.on("request", lambda request: page.asked_for.append(request.url))
            page.on("websocket", lambda socket: page.asked_for.append(socket.url))
            page.goto(address)
            yield page
        finally:
            browser.close()


def wait_for_figures(page: Any, command: str = "hexsim") -> float:
    """The peak on the page, once it belongs to the machine of which `command` is a part of the command line."""
    page.wait_for_function(
        "part => document.querySelector('#hexsim-peak')?.dataset.settled === 'true'"
        " && document.querySelector('#hexsim-command').innerText.includes(part)",
        arg=command,
    )
    return float(page.locator("#hexsim-peak").inner_text())


def move_slider(page: Any, label: str, steps: int) -> None:
    """Move a slider by the arrow keys, to the right or (steps < 0) to the left."""
    thumb = page.locator(f"//label[.='{label}']/following::div[@role='slider'][1]")
    for _ in range(abs(steps)):
        thumb.press("ArrowRight" if steps > 0 else "ArrowLeft")


def screenshot(page: Any) -> bytes:
    """What the browser shows, as PNG, without the viewer's notices."""
    for notice in page.locator(".mantine-Notification-closeButton").all():
        notice.click()
    page.wait_for_timeout(1000.0)  # they fade
    return page.screenshot()
