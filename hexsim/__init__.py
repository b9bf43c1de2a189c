"""hexsim: hydraulic six-DOF motion systems in MuJoCo, adaptive compensation, and tracing of measured residuals."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("hexsim")
except PackageNotFoundError:  # a source tree that was not installed
    __version__ = "0+unknown"
