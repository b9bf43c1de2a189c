"""What a server reports while it runs."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from hexsim.errors import shortened
from hexsim.simulation.vehicle_link import SILENT_S


@dataclass(kw_only=True)
class Status:
    """What `serve` reports once a second, and at its end."""

    time_s: float = 0.0
    state: str = ""
    errors: list[str] = field(default_factory=list)
    margin: float = 0.0  # simulated seconds a second of processor time
    behind_s: float = 0.0  # lag behind real time now
    worst_behind_s: float = 0.0
    skipped_s: float = 0.0  # real time that was not simulated
    packets: dict[str, int] = field(default_factory=dict)
    not_understood: dict[str, int] = field(default_factory=dict)  # how many packets, by reason
    of_packets: str = ""  # the same in a phrase, empty where all were understood
    refused_orders: dict[str, int] = field(default_factory=dict)  # by reason
    silent_s: float = 0.0  # since the last packet of a simulator (`serve --from`), infinite before the first one
    compensation: list[dict[str, Any]] = field(default_factory=list)  # `PositionLoop.engagement`
    latency_ms: dict[str, float] = field(default_factory=dict)  # packet to felt acceleration, by axis; at the end
    messages: list[tuple[float, int, str]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)  # of cavitation, the last ones; of `cavitated` in all
    cavitated: int = 0

    def note_lag(self, lag_s: float) -> None:
        self.behind_s = max(lag_s, 0.0)
        self.worst_behind_s = max(self.worst_behind_s, lag_s)

    def new_warnings(self, count: int) -> list[str]:
        """Those after the first `count` ones that are still kept."""
        new = min(self.cavitated - count, len(self.warnings))
        return self.warnings[len(self.warnings) - new :]

    def line(self) -> str:
        """One line of a running server."""
        behind = f"{1e3 * self.behind_s:.1f} ms behind" if self.behind_s > 0 else "on time"
        parts = [
            f"{self.time_s:8.1f} s  {self.state:<9} {behind}",
            f"margin {self.margin:.1f}",
            self.of_packets or f"packets {self.packets.get('received', 0)}",
        ]
        if SILENT_S < self.silent_s < math.inf:
            parts.append(f"waits for packets ({self.silent_s:.1f} s)")
        if self.refused_orders:
            count, last = sum(self.refused_orders.values()), list(self.refused_orders)[-1]
            parts.append(f"refused {count} orders: {shortened(last, 100)}")
        if self.errors:
            parts.append(f"errors: {', '.join(self.errors)}")
        return ", ".join(parts)
