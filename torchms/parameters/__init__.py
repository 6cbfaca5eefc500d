"""The numbers that describe a surface: how a module declares, checks and exchanges them."""
