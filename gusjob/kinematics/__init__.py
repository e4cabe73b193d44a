"""Pure functions on arrays: units, geometry, velocity profiles."""
