"""The machine as declared, one class a table of `machine.toml`. SI units; the unit stands in the name of each key.

Sources of the defaults: report = DCT 2005.79 appendix A; assumed = stated with its reason in the machine's README.
Bounds run from a micro hydraulic stage to the largest test rigs: what lies outside is a slip of the pen or of the unit.
"""

from hexsim.declaration.actuator import Cylinder, Friction
from hexsim.declaration.controller import Controller
from hexsim.declaration.geometry import Geometry
from hexsim.declaration.host_limits import HostLimits
from hexsim.declaration.load import Load
from hexsim.declaration.machine import EffectTable, Identity, Machine
from hexsim.declaration.manifold import Manifold
from hexsim.declaration.power_unit import PowerUnit
from hexsim.declaration.section import Name, Section, between, section_of, values_of, zero_or
from hexsim.declaration.sensors import Sensors
from hexsim.declaration.supply import ATMOSPHERE_Pa, Oil, Supply
from hexsim.declaration.valve import Valve

__all__ = [
    "ATMOSPHERE_Pa",
    "Controller",
    "Cylinder",
    "EffectTable",
    "Friction",
    "Geometry",
    "HostLimits",
    "Identity",
    "Load",
    "Machine",
    "Manifold",
    "Name",
    "Oil",
    "PowerUnit",
    "Section",
    "Sensors",
    "Supply",
    "Valve",
    "between",
    "section_of",
    "values_of",
    "zero_or",
]
