"""How a check ends as a program: 0 where it agrees, 1 where it does not, 2 with a message where it could not be made."""

import subprocess
import sys


def end_with(main):
    """Ends the program with what `main` answers."""
    try:
        sys.exit(main())
    except (OSError, ValueError, KeyError, subprocess.SubprocessError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
