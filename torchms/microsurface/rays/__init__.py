"""What carries light from facet to facet: the frame that rays are traced in, and two independent tracers."""
