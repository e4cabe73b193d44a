"""The machine profile: the machine as frozen dataclasses, read from gusjob.toml."""
