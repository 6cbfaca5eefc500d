"""Explicit microsurfaces: tiles of heights, where they come from, and as meshes and files."""
