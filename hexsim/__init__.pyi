from hexsim.errors import HexsimError as HexsimError
from hexsim.face.given import Machine as Machine
from hexsim.face.given import available as available
from hexsim.face.given import load_machine as load_machine
from hexsim.face.given import load_scenario as load_scenario
from hexsim.face.linear import LinearModel as LinearModel
from hexsim.face.linear import linearize as linearize
from hexsim.face.measured import Identification as Identification
from hexsim.face.measured import Qualification as Qualification
from hexsim.face.measured import TraceResult as TraceResult
from hexsim.face.measured import identify as identify
from hexsim.face.measured import load_log as load_log
from hexsim.face.measured import qualify as qualify
from hexsim.face.measured import trace as trace
from hexsim.face.runs import Comparison as Comparison
from hexsim.face.runs import Run as Run
from hexsim.face.runs import compare as compare
from hexsim.face.runs import run as run
from hexsim.face.runs import sweep as sweep
from hexsim.face.show import Picture as Picture
from hexsim.scenarios import Scenario as Scenario

__version__: str
