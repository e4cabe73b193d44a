"""The virtual controller."""

from support.bench_fixtures import benches, gus

__all__ = ["benches", "gus"]
