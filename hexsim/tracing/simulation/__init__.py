"""The closed loop simulated for fits, one leg or six."""
