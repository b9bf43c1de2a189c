"""What a server reports while it runs."""

from __future__ import annotations

from dataclasses import dataclass, field


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
    latency_ms: dict[str, float] = field(default_factory=dict)  # packet to felt acceleration, by axis; at the end
    messages: list[tuple[float, int, str]] = field(default_factory=list)

    def note_lag(self, lag_s: float) -> None:
        self.behind_s = max(lag_s, 0.0)
        self.worst_behind_s = max(self.worst_behind_s, lag_s)

    def line(self) -> str:
        """One line of a running server."""
        errors = f", errors: {', '.join(self.errors)}" if self.errors else ""
        behind = f"{1e3 * self.behind_s:.1f} ms behind" if self.behind_s > 0 else "on time"
        return (
            f"{self.time_s:8.1f} s  {self.state:<9} {behind}, margin {self.margin:.1f}, "
            f"packets {self.packets.get('received', 0)}{errors}"
        )
