"""One inference for every machine: residual = model(theta) + discrepancy + sensor noise.

The room knows no equations. A machine gives it a `Problem` (contract.py): stretches of motion, numbers with priors, and the residual with
its derivatives. `likelihood` fits it with the spectrum of what is left, `held_out` predicts motion that a fit has not seen, `verdict`
judges a candidate against the model without it.
"""
