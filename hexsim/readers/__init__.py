"""Readers of measured logs: text, Parquet, MAT and MDF to one clean log, with every loss stated."""

from hexsim.readers.files import log_files
from hexsim.readers.mapping import Mapping, load_mapping
from hexsim.readers.measured import read_log, read_stretches

__all__ = ["Mapping", "load_mapping", "log_files", "read_log", "read_stretches"]
