"""Import the scripts of a folder in fits/, which is not a package."""

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

FITS = Path(__file__).parents[2] / "fits"


@contextmanager
def import_scripts(folder: str, *names: str) -> Iterator[list[ModuleType]]:
    """Yield the modules of a folder in fits/ by name; remove them from the imported modules afterwards."""
    own = {path.stem for path in (FITS / folder).glob("*.py")}
    before = {name: sys.modules.pop(name) for name in own if name in sys.modules}
    sys.path.insert(0, str(FITS / folder))
    try:
        yield [importlib.import_module(name) for name in names]
    finally:
        sys.path.remove(str(FITS / folder))
        for name in own:
            sys.modules.pop(name, None)
        sys.modules.update(before)
