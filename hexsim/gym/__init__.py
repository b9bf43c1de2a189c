"""The machine as a learning task: environments of Gymnasium, one machine or many.

env = gymnasium.make("hexsim.gym:Hexsim-v0", machine="bench")
env = hexsim.gym.HexsimVectorEnv(256, Task(machine=load_machine("bench")), threads=2)
"""

try:
    import gymnasium
except ImportError:
    from hexsim.errors import HexsimError

    raise HexsimError("hexsim.gym needs Gymnasium: pip install 'hexsim[gym]'") from None

from hexsim.gym.environment import HexsimEnv
from hexsim.gym.task import Task
from hexsim.gym.vector import HexsimVectorEnv

__all__ = ["HexsimEnv", "HexsimVectorEnv", "Task"]

gymnasium.register("Hexsim-v0", entry_point="hexsim.gym:HexsimEnv")
