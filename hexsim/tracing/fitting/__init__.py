"""Parameters, fits, screening and selection of effects."""
