"""Programs that write what the package ships, each by its own `python -m tools.<name>`; they need extras."""
