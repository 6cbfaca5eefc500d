"""Directions, guarded arithmetic and special functions: what every formula stands on."""
