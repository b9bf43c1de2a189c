"""Files written whole or not at all: text, JSON, TOML, logs, run folders."""
