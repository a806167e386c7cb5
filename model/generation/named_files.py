"""Files of a family that lie on a person's machine, and what is found of them."""

from dataclasses import dataclass


@dataclass(frozen=True)
class FileFlag:
    """A file or folder that a flag of every command names, or a variable of the environment."""

    flag: str
    """With its two dashes."""
    variable: str
    metavar: str
    help: str


@dataclass(frozen=True)
class FileReport:
    """What ``python -m app doctor`` says of one of them."""

    name: str
    detail: str = ""
    """What was found, where it works."""
    error: Exception | None = None
    """Why it does not."""
    advice: str = ""
    is_needed: bool = True
