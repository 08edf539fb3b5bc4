"""A recording from a CSV file alone."""

import warnings

from pamjax.errors import InputWarning
from pamjax.records.files import read_bytes
from pamjax.records.reading.table import parse_table


def read_table(path, columns=None, default_length=None):
    """Return the recording of a CSV file; its notes become warnings."""
    recording, notes, _ = parse_table(read_bytes(path), path.name, columns or {}, default_length)
    for note in notes:
        warnings.warn(note, InputWarning, stacklevel=2)
    return recording
