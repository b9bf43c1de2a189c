"""What a late position transducer does to the pressures that belong to a position. delay.py finds how late it is.

All that is asked for holds for the position as it is measured. Pressure and oil are then early by as much.
"""

from __future__ import annotations

from ..arithmetic import push
from ..compiled import compiled


@compiled
def due_pressure_Pa(lateness, now_Pa, ahead_Pa):
    """The pressure demanded for now; now_Pa, ahead_Pa: for this tick as it was decided, and for the next ones."""
    late = lateness.late_s / lateness.tick_s
    whole = int(late)
    near, far = ahead_Pa[whole - 1] if whole else now_Pa, ahead_Pa[whole]
    return near + (late - whole) * (far - near)


@compiled
def pressure_then_Pa(lateness, pressure_Pa):
    """One tick: the pressure that belongs to the position measured now."""
    push(lateness.pressures_Pa, pressure_Pa)
    late = lateness.late_s / lateness.tick_s
    whole = int(late)
    near, far = lateness.pressures_Pa[whole], lateness.pressures_Pa[whole + 1]
    return near + (late - whole) * (far - near)
