"""The page of `hexsim live --web --from`: the machine while a simulator flies, and what was flown against what is felt."""

from __future__ import annotations

import html
from typing import Any

import numpy as np
from viser import uplot

from hexsim.cueing.shaping import AXES, AxisShape
from hexsim.recording.quantity import DEG
from hexsim.web.flight import SHOWN_S, Flight, FlightShown
from hexsim.web.machine_page import PANEL_PX, SLIDERS_PX, MachinePage
from hexsim.web.page import BOTTOM, SMALLEST, TOP, round_up, scales

GREY = "#8a8a8a"
SPAN_S = np.array([-SHOWN_S, 0.0])  # of the chart
IS_TURN = {axis: axis in ("roll", "pitch", "yaw") for axis in AXES}
WIDEST = {False: 2.0, True: 20.0}  # of a dead band's slider, m/s2 or deg/s


class FlightPage(MachinePage):
    """The page of `flight`. command: what runs the same without the page."""

    def __init__(self, flight: Flight, machine_name: str, command: str, port: int = 8080) -> None:
        super().__init__(flight, machine_name, flight.model, port)
        self.flight, self.command = flight, command
        self.axis = AXES[2]
        self._build_sliders()
        self._build_figures()

    def _build_sliders(
        self,
        *,
        largest_gain: float = 3.0,  # of the sliders
        longest_ms: float = 500.0,  # of the sliders
    ) -> None:
        gui = self.server.gui
        gui.main_panel.dock_right()
        gui.main_panel.set_width(SLIDERS_PX)
        with gui.add_folder("Shown"):
            self.shown_axis = gui.add_dropdown("Axis", AXES, initial_value=self.axis)
            self.shown_axis.on_update(lambda event: setattr(self, "axis", self.shown_axis.value))
        self.gains: dict[str, Any] = {}
        self.lags: dict[str, Any] = {}
        self.bands: dict[str, Any] = {}
        with gui.add_folder("Gain"):
            for axis in AXES:
                self.gains[axis] = gui.add_slider(
                    f"Gain {axis}",
                    -largest_gain,
                    largest_gain,
                    0.05,
                    1.0,
                    hint="Times what the washout is given; below 0 the axis is turned about.",
                )
        with gui.add_folder("Smoothing", expand_by_default=False):
            for axis in AXES:
                self.lags[axis] = gui.add_slider(f"Smoothing {axis} [ms]", 0.0, longest_ms, 10.0, 0.0)
        with gui.add_folder("Dead band", expand_by_default=False):
            for axis in AXES:
                unit = "deg/s" if IS_TURN[axis] else "m/s²"
                step = 0.5 if IS_TURN[axis] else 0.05
                self.bands[axis] = gui.add_slider(f"Dead band {axis} [{unit}]", 0.0, WIDEST[IS_TURN[axis]], step, 0.0)
        for handles in (self.gains, self.lags, self.bands):
            for handle in handles.values():
                handle.on_update(lambda event: self._moved())
        with gui.add_folder("Run"):
            gui.add_button("Reset after a fault").on_click(lambda event: self.flight.reset())
            gui.add_button("Sliders as they began").on_click(lambda event: self._as_begun())

    def _moved(self) -> None:
        self.flight.ask({axis: self._shape(axis) for axis in AXES})

    def _shape(self, axis: str) -> AxisShape:
        unit = 1.0 / DEG if IS_TURN[axis] else 1.0
        return AxisShape(
            gain=float(self.gains[axis].value),
            smoothing_s=1e-3 * float(self.lags[axis].value),
            dead_band=unit * float(self.bands[axis].value),
        )

    def _as_begun(self) -> None:
        for handles, value in ((self.gains, 1.0), (self.lags, 0.0), (self.bands, 0.0)):
            for handle in handles.values():
                handle.value = value
        self._moved()

    def _build_figures(self) -> None:
        gui = self.server.gui
        panel = gui.add_panel()
        with panel.add_tab("Flown and felt"):
            self.digits = gui.add_html("")
            self.chart = gui.add_uplot(
                data=(SPAN_S, np.zeros(2), np.zeros(2), np.zeros(2)),
                series=(
                    uplot.Series(label="time"),
                    uplot.Series(label="flown", stroke=GREY, width=1),
                    uplot.Series(label="asked", stroke=BOTTOM, width=2, dash=(6, 4)),
                    uplot.Series(label="felt", stroke=TOP, width=2),
                ),
                scales=scales(SPAN_S, 1.0),
                axes=_axes("m/s²"),
                legend=uplot.Legend(live=False),
                height=340,
                padding=(14, 24, 0, 0),
            )
            self.notes = gui.add_html("")
        self._frame: tuple[float, str] | None = None
        panel.dock_left()
        panel.set_width(PANEL_PX)
        panel.expand()  # on a phone, where it would be folded

    def _show(self, shown: FlightShown) -> None:
        axis = self.axis if self.axis in AXES else AXES[2]
        k, unit = AXES.index(axis), DEG if IS_TURN[axis] else 1.0
        name = "deg/s" if IS_TURN[axis] else "m/s²"
        lines = [unit * rows[:, k] for rows in (shown.flown, shown.asked, shown.felt)]
        largest = max(SMALLEST["m_s2"], *(float(np.abs(line).max()) for line in lines))
        self.digits.content = digits(axis, name, lines)
        self.notes.content = notes(shown, self.command)
        with self.server.atomic():
            self.chart.data = (shown.time_s, *lines)
            frame = (round_up(largest), name)
            if frame != self._frame:
                self._frame = frame
                self.chart.scales, self.chart.axes = scales(SPAN_S, frame[0]), _axes(name)


def _axes(unit: str) -> tuple[uplot.Axis, ...]:
    return uplot.Axis(label="time [s], now on the right"), uplot.Axis(label=f"along the axis [{unit}]", size=62)


def digits(axis: str, unit: str, lines: list[np.ndarray]) -> str:
    """Largest values of the last seconds, and what felt differs from asked in the mean."""
    flown, asked, felt = lines
    rms = float(np.sqrt(np.mean((felt - asked) ** 2)))
    blocks = (
        (f"Flown, {axis} [{unit}]", np.abs(flown).max(), "hexsim-flown"),
        (f"Felt [{unit}]", np.abs(felt).max(), "hexsim-felt"),
        (f"Felt less asked, rms [{unit}]", rms, "hexsim-rms"),
    )
    small, large = "font-size:13px;opacity:.75", "font-size:36px;font-weight:600;line-height:1.1"
    cells = "".join(
        f'<div style="flex:1"><div style="{small}">{html.escape(label)}</div>'
        f'<div id="{name}" style="{large}">{value:.2f}</div></div>'
        for label, value, name in blocks
    )
    return f'<div style="display:flex;gap:12px;padding:8px 12px;align-items:end">{cells}</div>'


def notes(shown: FlightShown, command: str) -> str:
    """State, packets, the last messages, and the command without the page."""
    said = "".join(f"<li>{html.escape(text)}</li>" for text in shown.messages)
    late = f", {1e3 * shown.behind_s:.0f} ms behind" if shown.behind_s > 0.02 else ""
    error = f'<p><b style="color:{BOTTOM}">{html.escape(shown.error)}</b></p>' if shown.error else ""
    return (
        f'<div style="font-size:13px;padding:4px 12px;line-height:1.45">{error}'
        f'<p id="hexsim-state"><b>Machine:</b> {html.escape(shown.state)}{late}</p>'
        f'<p id="hexsim-packets"><b>Packets:</b> {html.escape(shown.packets)}</p>'
        "<p>Largest values of the last 10 s. <i>asked</i>: flown after dead band, smoothing, gain and the washout's scale. "
        "What lasts is felt by leaning, which comes at 3 deg/s at most.</p>"
        f'<ul style="margin:4px 0 8px 18px;padding:0">{said}</ul>'
        f'<p style="opacity:.75;margin-bottom:2px">The same without the page:</p>'
        f'<code id="hexsim-command" style="font-size:12px;overflow-wrap:anywhere">{html.escape(command)}</code></div>'
    )
