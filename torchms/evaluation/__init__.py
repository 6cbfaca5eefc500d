"""How kernels run: what they are given, in which blocks, on which numbers."""
