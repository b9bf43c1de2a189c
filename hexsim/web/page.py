"""The page itself: the machine in 3-D by viser and mjviser, sliders beside it, figures and the last reversals."""

from __future__ import annotations

import html
import math
from typing import Any

import numpy as np
from viser import uplot

import compensation
from hexsim.simulation.recent_motion import MotionFigures
from hexsim.smoothness import BANDWIDTH_Hz
from hexsim.web.knobs import knobs
from hexsim.web.knowledge import knowledge_table
from hexsim.web.machine_page import PANEL_PX, SLIDERS_PX, MachinePage
from hexsim.web.session import Asked, Session, Shown

TOP, BOTTOM = "#0072B2", "#D55E00"  # Okabe and Ito, told apart by colour-blind readers
TOP_BEFORE, BOTTOM_BEFORE = "#9cc9e3", "#f0bd97"
SMALLEST = {"m_s2": 0.05, "rad_s2": 0.05}  # end of the chart's axis where there is next to nothing
UNITS = {"m_s2": "m/s²", "rad_s2": "rad/s²"}
AXES = {"x": "surge", "y": "sway", "z": "heave", "leg": "along the leg"}


class Page(MachinePage):
    """The page of a machine that runs scenarios. machine_name, scenario_name: as `hexsim run` takes them."""

    def __init__(self, session: Session, machine_name: str, scenario_name: str, port: int = 8080) -> None:
        super().__init__(session, machine_name, session.live.model, port)
        self.session, self.machine_name, self.scenario_name = session, machine_name, scenario_name
        self.handles: dict[str, Any] = {}
        self._build_sliders()
        self._build_figures()

    def _build_sliders(self) -> None:
        gui, session = self.server.gui, self.session
        gui.main_panel.dock_right()
        gui.main_panel.set_width(SLIDERS_PX)
        asked = session.asked
        with gui.add_folder("Motion"):
            self.handles["motion"] = gui.add_dropdown("Scenario", session.motions, initial_value=asked.motion)
            self.handles["amplitude"] = gui.add_slider("Amplitude", 0.0, 1.0, 1.0, 0.0)
            self.handles["frequency"] = gui.add_slider("Frequency [Hz]", 0.1, 2.0, 0.05, 0.5)
        with gui.add_folder("Compensation"):
            names = list(dict.fromkeys(["none", asked.compensator, *compensation.built_in()]))
            self.handles["compensator"] = gui.add_dropdown("Compensator", names, initial_value=asked.compensator)
        with gui.add_folder("Machine"):
            for knob in knobs(session.declared):
                self.handles[knob.name] = gui.add_slider(
                    knob.label, knob.low, knob.high, knob.step, knob.declared, hint=knob.hint
                )
        self._fit_motion()
        for name, handle in self.handles.items():
            handle.on_update(self._moved_motion if name == "motion" else self._moved)
        with gui.add_folder("Run"):
            self.handles["pause"] = gui.add_checkbox("Pause", False)
            gui.add_button("Push with 100 kg for 1 s").on_click(lambda event: session.push())
            gui.add_button("Begin again").on_click(lambda event: session.begin_again())
            gui.add_button("Sliders as declared").on_click(lambda event: self._as_declared())
        self.handles["pause"].on_update(lambda event: setattr(session, "paused", self.handles["pause"].value))

    def _build_figures(self) -> None:
        panel = self.server.gui.add_panel()
        with panel.add_tab("What is felt"):
            self.digits = self.server.gui.add_html("")
            nothing = np.array([-0.2, 0.2])
            self.chart = self.server.gui.add_uplot(
                data=(nothing, *(np.zeros(2) for _ in range(4))),
                series=(
                    uplot.Series(label="time"),
                    uplot.Series(label="top, before", stroke=TOP_BEFORE, width=3, dash=(6, 4)),
                    uplot.Series(label="bottom, before", stroke=BOTTOM_BEFORE, width=3, dash=(6, 4)),
                    uplot.Series(label="top", stroke=TOP, width=2),
                    uplot.Series(label="bottom", stroke=BOTTOM, width=2),
                ),
                scales=scales(nothing, 1.0),
                axes=axes("m_s2"),
                legend=uplot.Legend(live=False),
                height=370,
                padding=(14, 24, 0, 0),  # room for the highest number
            )
            self.notes = self.server.gui.add_html("")
        with panel.add_tab("What is known"):
            self.known = self.server.gui.add_html("")
        self._frame: tuple[float, float, str] | None = None
        panel.dock_left()
        panel.set_width(PANEL_PX)
        panel.expand()  # on a phone, where it would be folded

    def _fit_motion(self) -> None:
        """Sliders of amplitude and frequency for the motion that is chosen, as its scenario says."""
        wave = self.session.waves.get(self.handles["motion"].value)
        amplitude, frequency = self.handles["amplitude"], self.handles["frequency"]
        amplitude.disabled = frequency.disabled = wave is None
        if wave is not None:
            amplitude.label = f"Amplitude [{wave.unit[1]}]"
            amplitude.max = max(wave.largest_amplitude(self.session.declared), wave.amplitude)
            amplitude.step = 1.0 if amplitude.max > 20.0 else 0.5
            amplitude.value = wave.amplitude
            frequency.value = wave.frequency_Hz

    def _moved_motion(self, event: Any) -> None:
        self._fit_motion()
        self._moved(event)

    def _moved(self, event: Any) -> None:
        """Ask for what the sliders say now."""
        wave = self.session.waves.get(self.handles["motion"].value)
        self.session.ask(
            Asked(
                knobs={knob.name: float(self.handles[knob.name].value) for knob in knobs(self.session.declared)},
                motion=self.handles["motion"].value,
                amplitude=float(self.handles["amplitude"].value) if wave else None,
                frequency_Hz=float(self.handles["frequency"].value) if wave else None,
                compensator=self.handles["compensator"].value,
            )
        )

    def _as_declared(self) -> None:
        for knob in knobs(self.session.declared):
            self.handles[knob.name].value = knob.declared
        self._moved(None)

    def _show(self, shown: Shown) -> None:
        figures, before = shown.figures, shown.before
        self.digits.content = digits(figures, before)
        self.notes.content = notes(shown, self.session.command(shown.asked, self.machine_name, self.scenario_name))
        self.known.content = knowledge_table(shown.known)
        latest = figures or before
        if latest is not None:
            with self.server.atomic():
                self._plot(latest, figures, before)

    def _plot(self, latest: MotionFigures, figures: MotionFigures | None, before: MotionFigures | None) -> None:
        time_s = latest.curve_time_s
        lines = [
            np.interp(time_s, given.curve_time_s, given.curves[end], left=np.nan, right=np.nan)
            if given is not None and end in given.curves and given.unit == latest.unit
            else np.full(len(time_s), np.nan)
            for given in (before, figures)
            for end in ("top", "bottom")
        ]
        largest = max(SMALLEST[latest.unit], *(float(np.nanmax(np.abs(line), initial=0.0)) for line in lines))
        self.chart.data = (time_s, *lines)
        frame = (float(time_s[-1]), round_up(largest), latest.unit)
        if frame != self._frame:  # the browser draws all anew
            self._frame = frame
            self.chart.scales, self.chart.axes = scales(time_s, frame[1]), axes(latest.unit)


def scales(time_s: np.ndarray, largest: float) -> dict[str, uplot.Scale]:
    """Axes of the chart."""
    return {
        "x": uplot.Scale(time=False, auto=False, range=(float(time_s[0]), float(time_s[-1]))),
        "y": uplot.Scale(auto=False, range=(-largest, largest)),
    }


def round_up(largest: float) -> float:
    """The next of 1, 1.5, 2, 3, 5, 7 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(largest))
    return power * next((step for step in (1.0, 1.5, 2.0, 3.0, 5.0, 7.0) if largest <= step * power), 10.0)


def axes(unit: str) -> tuple[uplot.Axis, ...]:
    """Captions of the chart."""
    return uplot.Axis(label="time from the reversal [s]"), uplot.Axis(label=f"deviation [{UNITS[unit]}]", size=62)


def digits(figures: MotionFigures | None, before: MotionFigures | None) -> str:
    """Peak and perception figure, large, with those of before."""

    def number(given: MotionFigures | None, what: str) -> str:
        return (
            "…"
            if given is None
            else f"{getattr(given, what):.2f}"
            if what == "peak"
            else f"{given.times_threshold:.1f}"
        )

    unit = UNITS[(figures or before).unit] if figures or before else "m/s²"  # type: ignore[union-attr]
    given = figures or before
    felt = f"Felt [times the threshold, {AXES.get(given.felt_axis, given.felt_axis)}]" if given else "Felt"
    blocks = [
        ("peak", f"Peak in {BANDWIDTH_Hz:.0f} Hz [{unit}]", "hexsim-peak"),
        ("times_threshold", felt, "hexsim-felt"),
    ]
    small, large = "font-size:13px;opacity:.75", "font-size:52px;font-weight:600;line-height:1.1"
    settled = str(figures is not None).lower()
    cells = "".join(
        f'<div style="flex:1"><div style="{small}">{html.escape(label)}</div>'
        f'<div id="{name}" data-settled="{settled}" style="{large}">{number(figures, what)}</div>'
        f'<div style="{small}">before the change: {number(before, what)}</div></div>'
        for what, label, name in blocks
    )
    return f'<div style="display:flex;gap:12px;padding:8px 12px">{cells}</div>'


def notes(shown: Shown, command: str) -> str:
    """What the chart shows, how it goes, and the command that runs the same."""
    if shown.error:
        state = f'<b style="color:{BOTTOM}">{html.escape(shown.error)}</b>'
    elif shown.figures is None:
        state = "settling: the figures need a whole period after a change"
    else:
        state = "figures of the last periods"
    warned = "".join(f"<p>{html.escape(text)}</p>" for text in shown.warnings)
    slow = "" if shown.speed > 0.9 else f", {100 * shown.speed:.0f} % of real time"
    return (
        '<div style="font-size:13px;padding:4px 12px;line-height:1.45">'
        f"<p>Acceleration less its fundamental (in a motion that is no sine: less the command), in "
        f"{BANDWIDTH_Hz:.0f} Hz, about the last reversal at either end. "
        "Dashed: before the last change. The bump in the middle is what people feel.</p>"
        f'<p id="hexsim-state">{shown.time_s:.1f} s{slow}; {state}</p>{warned}'
        f'<p style="opacity:.75;margin-bottom:2px">The same without the page:</p>'
        f'<code id="hexsim-command" style="font-size:12px;overflow-wrap:anywhere">{unbroken(command)}</code></div>'
    )


def unbroken(command: str) -> str:
    """A command line as HTML that breaks between its words."""
    return " ".join(f'<span style="display:inline-block">{html.escape(word)}</span>' for word in command.split(" "))
