"""What a command ends with: errors that its user can mend are one line on stderr."""

import sys
from collections.abc import Callable


def exit_code(program: str, run: Callable[[], int | None], interrupted: str) -> int:
    """That of `run` (None is 0); 2 for an error of its arguments or files, 130 when it was interrupted, and a line about it."""
    try:
        return run() or 0
    except (ValueError, TypeError, OSError, ImportError) as error:
        print(f"{program}: error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"{program}: interrupted; {interrupted}", file=sys.stderr)
        return 130
