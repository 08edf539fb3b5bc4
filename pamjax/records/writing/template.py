"""Template of a case folder: example values, and comments that explain each entry and its measurement."""

from __future__ import annotations

from pathlib import Path

from pamjax.errors import BadInput
from pamjax.records.case import MUSCLE_FILE, RECORDING_FILE
from pamjax.records.files import write_folder_atomically

#: Rows of the example: the muscle below, simulated with friction that its muscle.toml does not state.
_EXAMPLE_ROWS = Path(__file__).with_name("example_recording.csv")

_RECORDING_COMMENTS = """\
# EXAMPLE ROWS, simulated with friction between the threads: replace them with your measurements.
# Lines that begin with # are comments.
# One row per sample. State the unit of each column in its header, in any unit, as in pressure [psi].
# A blank cell means "not measured".
# time      Omit this column if every row is an equilibrium and the order of the rows has no meaning.
#           The time may jump where the rig was moved. By default, the memory of rubber and friction
#           continues after a jump; "pamjax fit --gaps anew" resets it. By default, the muscle was at rest
#           before the first row; with "--before settled" it has already run through this recording once.
# pressure  gauge pressure at the inlet of the muscle
# length    distance between the fittings
# force     tension, positive when the muscle pulls
# diameter  outer diameter, mean over the length; optional
# cycle     number of the stroke or test, 0 while the rig settles; optional
"""

MUSCLE_TEMPLATE = """\
# Description of the muscle. A quantity is a text with a unit, or {value = "...", sd = "..."}. The sd is one
# standard deviation of the measured value. A value without sd is exact. Lines that begin with # are comments;
# to use an entry in a comment, remove the #. ALL VALUES BELOW ARE EXAMPLES: replace them with yours.

[muscle]
name = "example muscle"

# Distance between the fittings without pressure, with the muscle just straight. The contraction is 0 here.
rest_length = "200 mm"

# The braid, in one of two forms.
# 1. By thread length and turns. thread_length: along one thread from fitting to fitting. Measure it with a
#    string along a thread, or on a thread that was cut out. turns: number of turns of one thread around the
#    muscle from end to end.
thread_length = {value = "214 mm", sd = "0.5 mm"}
turns = {value = 1.2, sd = 0.005}
# 2. By angle and diameter, if the threads are not visible (in a fluidic muscle they are inside the rubber).
#    braid_angle: between thread and circumference, at rest. diameter: of the thread layer, at rest.
# braid_angle = {value = "69.2 deg", sd = "1 deg"}
# diameter = {value = "20.2 mm", sd = "0.5 mm"}

# Number of threads of both families, and cross-sectional area of one thread: mass per length / density.
threads = 120
thread_area = "0.07 mm^2"

# Outer diameter of the fitting where the braid is clamped. Optional.
# fitting_diameter = {value = "20 mm", sd = "0.5 mm"}

# Length of a recording at one length, if recording.csv has no column "length".
# length = "200 mm"

[thread]
# modulus: Young's modulus of a thread, from a tensile test of one thread or from a data sheet. The modulus of
# a yarn is below that of its polymer. stiffness: of all threads together, number x area x modulus.
# State one of them. Without both, the threads are inextensible at the start of a fit.
modulus = {value = "70 GPa", sd = "15 GPa"}
# stiffness = {value = "0.59 MN", sd = "0.1 MN"}

# The rubber tube before assembly. modulus: Young's modulus at small strain, three times the shear modulus.
# [bladder]
# inner_diameter = "14 mm"
# thickness = "1.5 mm"
# modulus = {value = "1 MPa", sd = "0.5 MPa"}

# A test without a load, or with a hung weight: the force is set, and the length is measured.
# Then recording.csv needs no column "force", and a fit usually needs the rubber: --with bladder_elasticity.
# [test]
# measured = "length"
# load = "0 N"

[sensors]
# Noise of one sample, one standard deviation: the scatter of a reading while nothing moves. If you omit force
# or diameter, pamjax estimates its noise. If you omit pressure or length, it counts as exact.
force = "2 N"
pressure = "0.5 kPa"
diameter = "0.05 mm"
length = "0.02 mm"
# If each length is set with a ruler, all rows of a setting have the same error. Then write instead:
# length = {sd = "1 mm", per = "setting"}

[baseline]
# Model that you assume before a diagnosis: "inelastic" or "elastic" threads.
model = "elastic"

# Origin of the recording, for `pamjax fleet`. Optional.
# [specimen]
# bench = "north"
# serial = "A-0012"
# date = 2026-03-02

# Your headers in recording.csv, if they differ from the names of the channels.
# [columns]
# force = "Load (lbf)"
"""


def write_template(folder: str | Path) -> tuple[Path, Path]:
    """Write the template of a case folder, and return the paths of its two files.

    Raises:
        BadInput: if one of the files exists.
    """
    folder = Path(folder)
    files = folder / RECORDING_FILE, folder / MUSCLE_FILE
    if folder.exists() and not folder.is_dir():
        raise BadInput.from_rule(
            "a case must be a folder", f"the file {folder}", remedy="Choose another name."
        )
    for path in files:
        if path.exists():
            raise BadInput.from_rule(
                f"{path} already exists and is not overwritten", remedy="Choose another folder."
            )
    with write_folder_atomically(folder) as temporary:
        recording = _RECORDING_COMMENTS + _EXAMPLE_ROWS.read_text(encoding="utf-8")
        (temporary / RECORDING_FILE).write_text(recording, encoding="utf-8", newline="\n")
        (temporary / MUSCLE_FILE).write_text(MUSCLE_TEMPLATE, encoding="utf-8", newline="\n")
    return files
