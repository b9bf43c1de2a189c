"""The machine in other people's tools: as an FMU or a plugin of MuJoCo, native code that needs no compiler."""

from hexsim.export.fmu import export_fmu
from hexsim.export.plugin import export_plugin

__all__ = ["export_fmu", "export_plugin"]
