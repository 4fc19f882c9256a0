"""Where priors and ranges of outlines come from.

They are wide: each standard deviation covers children's small to adults' large sizes.
"""

ARTF = "ranges of the aRTF templates (Lips et al. 2024, synthetic-cloth-data, cloth_meshes.py), widened"
SIZES = "EN 13402-3 body girths, children 116 to adult 3XL, with 0 to 30 % ease; half of the girth lies flat"
FREE = "no table: wide"
