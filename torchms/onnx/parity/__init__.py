"""Exported files held against eager: the grid of inputs, the bounds, the comparison and its table."""
