"""What every page of a machine has: its server behind the gate, the machine in 3-D, and a loop that shows."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from io import StringIO
from typing import Any, Protocol

import numpy as np
from mjviser import ViserMujocoScene

from hexsim.web.gate import LOOPBACK, open_server

PANEL_PX, SLIDERS_PX = 430, 350  # width of the panel and of its sliders


class Simulated(Protocol):
    """What a page shows: a simulation in a thread of its own. on_frame is called there with who has MuJoCo's `data`."""

    def start(self, on_frame: Callable[[Any], None]) -> None: ...

    def stop(self) -> None: ...

    def shown(self) -> Any: ...

    def new_warnings(self) -> list[str]:
        """Since the last call; after `stop` those that were still open."""
        ...


class MachinePage:
    """Serves `session` on loopback until `close`. port: the first that is tried; `address` says which it became."""

    def __init__(self, session: Simulated, machine_name: str, model: Any, port: int) -> None:
        self._simulated = session
        self.server, self.gate = open_server(f"hexsim: {machine_name}", port)
        self.server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(0, 114, 178))
        self.scene = self._build_scene(model)
        self._closed = threading.Event()

    @property
    def address(self) -> str:
        """With the token in it: whoever has it can move the machine."""
        return f"http://{LOOPBACK}:{self.server.get_port()}/{self.gate.token}"

    def run(
        self,
        seconds: float | None = None,
        stop: threading.Event | None = None,
        warn: Callable[[list[str]], None] = lambda sentences: None,
        *,
        refresh_s: float = 0.3,  # between two updates of the figures
    ) -> None:
        """Simulate and show, for `seconds`, until `close`, or until `stop` is set. warn: called with new warnings of the machine."""
        self._simulated.start(self._draw)
        end = math.inf if seconds is None else time.monotonic() + seconds
        try:
            while not self._closed.is_set() and not (stop and stop.is_set()) and time.monotonic() < end:
                begun = time.monotonic()
                self._show(self._simulated.shown())
                warn(self._simulated.new_warnings())
                time.sleep(max(refresh_s, 2.0 * (time.monotonic() - begun)))  # a third of one core at most
        finally:
            self._simulated.stop()
            warn(self._simulated.new_warnings())
            with redirect_stdout(StringIO()):
                self.server.stop()

    def close(self) -> None:
        self._closed.set()

    def _show(self, shown: Any) -> None:
        raise NotImplementedError

    def _build_scene(self, model: Any) -> ViserMujocoScene:
        scene = ViserMujocoScene(self.server, model, num_envs=1)
        scene.camera_tracking_enabled = False
        self.server.scene.configure_environment_map(environment_intensity=0.35)  # the paints keep their colours
        size, centre = float(model.stat.extent), np.array(model.stat.center)
        camera = self.server.initial_camera
        camera.look_at, camera.fov = centre, np.radians(40.0)
        camera.position = centre + 3.1 * size * np.array([1.0, -1.0, 0.35]) / np.linalg.norm([1.0, -1.0, 0.35])
        return scene

    def _draw(self, simulated: Any) -> None:
        """The machine as it stands, in the thread that simulates."""
        self.scene.update_from_mjdata(simulated.data)
