"""Template of a case folder: example values, and comments that explain each entry and its measurement."""

from __future__ import annotations

from pathlib import Path

from pamjax.errors import refuse
from pamjax.records.case import MUSCLE_FILE, RECORDING_FILE
from pamjax.records.files import write_folder_atomically

#: Invented, so that the new folder reads at once: what the muscle below would show, with its sensors' noise.
_RECORDING_TEMPLATE = """\
# EXAMPLE ROWS: put your own in their place. Lines that begin with # are comments.
# One row a sample. Any unit will do: state it in the header, as in pressure [psi].
# A blank cell is "not measured".
# time      leave the column out if every row is an equilibrium and their order means nothing. Where it jumps,
#           the rig was moved: rubber and friction remember across the jump, or begin anew if you say so
#           (pamjax fit --gaps anew); --before settled says that the muscle had been through the same before
# pressure  gauge pressure at the muscle's inlet
# length    between the fittings
# force     tension, positive where the muscle pulls
# diameter  outer, mean over the length; optional
# cycle     number of the stroke or test, 0 while the rig settles; optional
time [s],pressure [kPa],length [mm],force [N],diameter [mm],cycle
0.0,200.0,200.00,819.6,20.47,1
0.5,200.1,190.00,690.4,,1
1.0,199.9,180.00,565.2,30.81,1
"""

_MUSCLE_TEMPLATE = """\
# What the muscle is. A quantity is a text with a unit, or {value = "...", sd = "..."} where sd, one standard
# deviation, says how well it was measured. A value without sd is taken as known. Lines that begin with # are
# comments: remove the # to use what stands behind it. ALL NUMBERS BELOW ARE EXAMPLES.

[muscle]
name = "example muscle"

# Between the fittings, not pressurised and pulled just straight. Contraction counts from here.
rest_length = "200 mm"

# The braid, in one of two forms.
# 1. Counted. thread_length: along one thread from fitting to fitting; follow one with a string, or cut one
#    out and lay it straight. turns: how often one thread winds around the muscle from end to end.
thread_length = {value = "214 mm", sd = "0.5 mm"}
turns = {value = 1.2, sd = 0.005}
# 2. By angle, where threads cannot be followed (a fluidic muscle, whose threads lie inside the rubber).
#    braid_angle: between thread and circumference, at rest. diameter: of the thread layer, at rest.
# braid_angle = {value = "69.2 deg", sd = "1 deg"}
# diameter = {value = "20.2 mm", sd = "0.5 mm"}

# Number of threads, both families together, and the cross-section of one: mass per length over density.
threads = 120
thread_area = "0.07 mm^2"

# Where the braid is clamped, outer diameter of the fitting. Optional.
# fitting_diameter = {value = "20 mm", sd = "0.5 mm"}

# The one length of a recording that has no length column.
# length = "200 mm"

[thread]
# Young's modulus: slope of stress against strain from a tensile test of one thread, or a data sheet (a yarn
# is softer than its polymer). Or the stiffness of all threads together, number x area x modulus. With
# neither, the threads start out inextensible.
modulus = {value = "70 GPa", sd = "15 GPa"}
# stiffness = {value = "0.59 MN", sd = "0.1 MN"}

# The rubber tube before it is built in, and its Young's modulus at small strain, which is three times the
# shear modulus.
# [bladder]
# inner_diameter = "14 mm"
# thickness = "1.5 mm"
# modulus = {value = "1 MPa", sd = "0.5 MPa"}

[sensors]
# Noise of one sample: the scatter of a reading while nothing moves. Leave out what is to be estimated.
force = "2 N"
pressure = "0.5 kPa"
diameter = "0.05 mm"
# Where lengths were set by ruler, one error for each setting: {sd = "1 mm", per = "setting"}
length = "0.02 mm"

[baseline]
# What you believe so far: "inelastic" threads, or "elastic" ones.
model = "elastic"

# Headers of recording.csv that are named differently.
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
        raise refuse("a case is a folder", f"the file {folder}", remedy="Choose another name.")
    for path in files:
        if path.exists():
            raise refuse(f"{path} is there already, and is not overwritten", remedy="Choose another folder.")
    with write_folder_atomically(folder) as temporary:
        (temporary / RECORDING_FILE).write_text(_RECORDING_TEMPLATE, encoding="utf-8", newline="\n")
        (temporary / MUSCLE_FILE).write_text(_MUSCLE_TEMPLATE, encoding="utf-8", newline="\n")
    return files
