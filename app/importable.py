"""Python interface of the installed package, as ``co_speech_motion/__init__.py``.

A checkout has ``app.notebook`` instead. The folders ``app``, ``model`` and the other roots lie next
to it, and are added to the end of the search path at the first use of an attribute.
"""

import sys
from importlib import import_module
from pathlib import Path
from typing import Any

_HERE = Path(__file__).resolve().parent


def __getattr__(name: str) -> Any:
    if name.startswith("__"):
        raise AttributeError(name)
    if str(_HERE) not in sys.path:
        sys.path.append(str(_HERE))
    app = import_module("app")
    if Path(str(app.__file__)).resolve().parent.parent != _HERE:
        raise ImportError(
            f"Another package called 'app' is found before this program's: {app.__file__}. Start "
            "Python in another folder."
        )
    return getattr(import_module("app.notebook"), name)


def __dir__() -> list[str]:
    return [*globals(), *import_module("app.notebook").__all__] if "app" in sys.modules else []
