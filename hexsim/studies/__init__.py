"""Many runs: side by side, and sweeps."""
