"""What of `hexsim run` asks for many runs: several compensators side by side, or a grid of values."""

from __future__ import annotations

from pathlib import Path

from hexsim.cli import options
from hexsim.errors import HexsimError

ALL = "all"


def are_several(compensators: str) -> bool:
    """Whether more than one compensator is named."""
    return "," in compensators or compensators == ALL


def is_grid(settings: list[str] | None) -> bool:
    """Whether a value of `--set` is several with commas, and not one list or text of TOML."""
    return any(
        "," in value and options.parse_value(value) == value for value in options.parse_changes(settings).values()
    )


def refuse(of_one_run: dict[str, object], many: str) -> None:
    """Raise HexsimError where an option that only one run has is given. of_one_run: its name, and whether it is given."""
    if given := [name for name, value in of_one_run.items() if value]:
        raise HexsimError(
            f"{', '.join(given)}: of one run, and {many} are asked for; leave it out, or run them one by one"
        )


def default_table(scenario: str) -> Path:
    """runs/<time>-sweep-<scenario>.parquet"""
    from hexsim.files.run_folder import default_folder

    return Path(f"{default_folder(f'sweep-{Path(scenario).stem}')}.parquet")
