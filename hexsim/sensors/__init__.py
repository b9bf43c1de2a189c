"""What transducers make of a signal."""
