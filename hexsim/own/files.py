"""Which file of a folder declares a machine of one's own: asked before anything of such a machine is loaded."""

from __future__ import annotations

from pathlib import Path

FILES = ("model.toml", "balances.toml")


def model_file(folder: Path) -> Path | None:
    """The file that declares a machine of one's own, or None."""
    return next((folder / name for name in FILES if (folder / name).is_file()), None)
