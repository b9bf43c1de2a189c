"""The machine live while its valve's overlap grows: a picture of the page where there is a browser, else of its chart."""

from __future__ import annotations

import threading

from matplotlib.figure import Figure

from hexsim.errors import HexsimError
from hexsim.machine import Machine
from hexsim.machine.files import changed
from hexsim.recording import palette
from hexsim.recording.figure_style import PAPER, legend, png, styled
from hexsim.scenarios import Scenario
from hexsim.simulation.live import LiveMachine
from hexsim.simulation.recent_motion import MotionFigures, RecentMotion, motion_figures

WIDE_M = 20e-6  # overlap of a worn or cheap valve, four times the declared one


def before_and_after(
    machine: Machine,
    scenario: Scenario,
    *,
    settled_s: float = 3.0,  # before the figures count
    measured_s: float = 4.5,  # in which they are taken
) -> tuple[MotionFigures, MotionFigures]:
    """Figures of the running machine as declared, and after its overlap has become wide in flight."""
    recent = RecentMotion()
    live = LiveMachine(machine, scenario, observe=recent.note)
    found = []
    for one in (machine, changed(machine, {"valve.overlap_m": WIDE_M})):
        live.become(one)
        live.advance(settled_s)
        since = live.time_s
        live.advance(measured_s)
        log = recent.log(live, since)
        assert log is not None and live.motion.scenario is not None
        found.append(motion_figures(live.motion.scenario, live.kinematics.axes, log))
    return found[0], found[1]


def page_picture(machine: Machine, machine_name: str, scenario: Scenario) -> bytes:
    """The page with its slider moved, as PNG. Raises HexsimError where the extra or a browser is missing."""
    try:
        from hexsim.web import Page, Session
    except ModuleNotFoundError as error:
        raise HexsimError(f"the page needs {error.name}: pip install 'hexsim[web]'") from None
    from hexsim.web.browser import move_slider, opened, screenshot, wait_for_figures

    page = Page(Session(machine, scenario), machine_name, scenario.name)
    running = threading.Thread(target=page.run)
    running.start()
    try:
        with opened(page.address) as browser:
            wait_for_figures(browser)
            move_slider(browser, "Overlap [µm]", round((WIDE_M - (machine.valve.overlap_m or 0.0)) / 1e-6))
            wait_for_figures(browser, f"valve.overlap_m={WIDE_M:g}")
            return screenshot(browser)
    finally:
        page.close()
        running.join()


@styled
def chart(before: MotionFigures, after: MotionFigures) -> bytes:
    """The last reversals before and after, as the page draws them."""
    figure = Figure(figsize=(PAPER.width_in, 3.4), layout="constrained")
    for plot, end in zip(figure.subplots(1, 2, sharey=True), ("top", "bottom"), strict=True):
        plot.plot(before.curve_time_s, before.curves[end], color=palette.REFERENCE, lw=1.2, label="before")
        plot.plot(after.curve_time_s, after.curves[end], color=palette.RESPONSE, lw=1.4, label="after")
        plot.set(title=f"reversal at the {end}", xlabel="time from the reversal [s]")
        legend(plot)
    figure.axes[0].set_ylabel("deviation in 50 Hz [m/s²]")
    return png(figure)
