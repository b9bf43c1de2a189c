"""Legs drawn from stated priors on a plant of their own, for `benchmarks/robustness_grid.py`.

| module | what |
|---|---|
| `plant` | equations of a leg and their integration; nothing of hexsim or compensation |
| `priors` | every number of a leg: unit, nominal value, both families of draws, reason |
| `legs` | a leg drawn from a seed, and what its data sheet says |
| `motions` | setpoints |
| `loop` | the 500 Hz position loop with a compensator |
| `figures` | what a run is judged by |
| `oracle` | what a perfect inverse with the true numbers leaves |
| `ride` | makes ride.csv, the strokes of a hexapod that follows an aircraft |
| `platform` | hexsim's hexapod with its numbers drawn |
"""
