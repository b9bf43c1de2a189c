"""The declared machine: what a data sheet says, as frozen data, and the MuJoCo model made from it."""

from hexsim.declaration import Machine
from hexsim.machine.files import available_machines, load_machine, machine_from_dict, models_folder, save_machine

__all__ = ["Machine", "available_machines", "load_machine", "machine_from_dict", "models_folder", "save_machine"]
