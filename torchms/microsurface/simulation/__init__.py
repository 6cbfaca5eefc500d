"""Light that bounces on an explicit microsurface, counted: materials, shards, and how their results add up."""
