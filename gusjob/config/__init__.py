"""The machine profile: the machine as records, read from gusjob.toml."""
