"""Machines of one's own as models: declared in a file, simulated from recorded inputs, fitted in simulation."""
