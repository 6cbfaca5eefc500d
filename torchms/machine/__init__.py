"""Machine code for functions of single elements: a function of tensors is recorded, written as C++, built, and called."""
