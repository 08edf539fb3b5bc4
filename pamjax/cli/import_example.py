"""Example of an import file on the help page of `pamjax import`."""

from __future__ import annotations

#: Lines of import.toml for a spreadsheet export with semicolons and decimal commas.
IMPORT_EXAMPLE = """\
muscle = "mine/muscle.toml"  # `pamjax new mine` writes a template
files = {separator = ";", decimal = ","}
tests = [{file = "run.csv"}]

[columns]
time = {column = "t", unit = "s"}
pressure = {column = "p [bar]"}
length = {column = "L", unit = "mm"}
force = {column = "Load", unit = "N", zero = -3.3}
"""

#: Text below the options of the help page.
IMPORT_EPILOGUE = f"""\
Example: import.toml for run.csv with the header `t;p [bar];L;Load`.
The load cell reads -3.3 N without load.

{IMPORT_EXAMPLE}
Then run: pamjax import import.toml --out case
docs/files.md lists all entries in the section "An import".
"""
