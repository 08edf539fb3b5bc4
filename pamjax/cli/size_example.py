"""Example of a specification on the help page of `pamjax size`."""

from __future__ import annotations

#: Lines of spec.toml for a muscle of limited length and diameter.
SIZE_EXAMPLE = """\
minimise = "diameter"

[supply]
pressure = "5 bar"

[[force]]  # one table for each required force
at_least = "200 N"
contraction = "10 %"

[envelope]
length = "200 mm"  # with both end fittings
diameter = "30 mm"

[threads]  # by default all supplied materials
kinds = "aramid"
counts = [48, 72]

[bladders]
kinds = "latex"
"""

#: Text below the options of the help page.
SIZE_EPILOGUE = f"""\
Example: spec.toml for a muscle that fits into 200 mm.

{SIZE_EXAMPLE}
Then run: pamjax size spec.toml --out out/sized
docs/files.md lists all entries in the section "A sizing spec".
"""
