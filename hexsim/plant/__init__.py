"""MuJoCo carries the masses, native callbacks carry the oil. The same code serves one leg and six."""

from hexsim.plant.plant import Plant

__all__ = ["Plant"]
