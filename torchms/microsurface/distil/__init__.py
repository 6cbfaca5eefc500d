"""From simulated light to lobes: what a ray-traced surface does beyond Smith's theory, learned from single paths."""
