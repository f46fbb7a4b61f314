"""The `corf` program: where it is, and how it is run."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path
from typing import Union

Argument = Union[str, int, float, "os.PathLike[str]"]


class CorfError(Exception):
    """Something that corf refuses, with what, where and what to do in its message."""

    def __init__(self, message: str, exit_code: int | None = None) -> None:
        super().__init__(message)
        self.exit_code = exit_code
        """Exit code of the program: 1 a check failed, 2 bad input, 130 interrupted; None where the program was not run."""


def program() -> str:
    """Path of the `corf` program: what ``CORF_BIN`` names, else the first `corf` in ``PATH``.

    Raises CorfError where there is none.
    """
    named = os.environ.get("CORF_BIN")
    if named:
        found = shutil.which(named)
        if found is None:
            raise CorfError(f"CORF_BIN={named}: there is no program of this name\n  help: name the corf program, e.g. target/release/corf")
        return found
    found = shutil.which("corf")
    if found is None:
        raise CorfError(
            "the corf program is not installed\n  help: run `cargo install --path crates/bench` in a checkout of corf, or set CORF_BIN to the program"
        )
    return found


def run(*arguments: Argument) -> str:
    """Runs `corf ARGUMENTS` to its end and returns its standard output.

    ``corf.run("dataset", "generate", "scenes/room-tiny.toml", "--out", "data/tiny")`` is the command line of the same words. Progress is not shown.

    Raises CorfError with the program's message where it does not end with exit code 0.
    """
    command = [program(), *(os.fspath(a) if isinstance(a, os.PathLike) else str(a) for a in arguments)]
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, encoding="utf-8", errors="replace", check=False)
    except (OSError, ValueError) as error:
        raise CorfError(f"{command[0]} cannot be run: {error}\n  help: set CORF_BIN to the corf program") from error
    if done.returncode != 0:
        raise CorfError(_message(done.stderr, done.stdout) or f"{' '.join(command)} ended with code {done.returncode}", done.returncode)
    return done.stdout


def _message(stderr: str, stdout: str) -> str:
    """The error in what the program said: from `error:` on; without one, all of it (a failed check says on standard output what failed)."""
    at = stderr.rfind("error: ")
    return stderr[at + len("error: ") :].strip() if at >= 0 else (stderr.strip() or stdout.strip())


def existing(path: str | os.PathLike[str], file: str, help_text: str) -> Path:
    """A folder that holds `file`; raises CorfError otherwise."""
    try:
        folder = Path(path)
        if not (folder / file).is_file():
            what = "is not there" if not folder.exists() else f"holds no {file}"
            raise CorfError(f"{folder} {what}\n  help: {help_text}")
        return folder
    except (OSError, ValueError, TypeError) as error:
        raise CorfError(f"{path!r} cannot be opened: {error}\n  help: {help_text}") from error
