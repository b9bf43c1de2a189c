"""The machine in other people's tools: as an FMU, native code that needs neither Python nor a compiler."""

from hexsim.export.fmu import export_fmu

__all__ = ["export_fmu"]
