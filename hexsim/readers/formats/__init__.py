"""Formats of logs: one file each, found by name; each defines READER. See `hexsim.readers.reader`."""
