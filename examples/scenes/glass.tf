# A transfer function: what a value looks like.
transfer 1                # the format and its version
strength extinction       # per world unit; or opacity_per_unit, from 0 to 1
color srgb                # or linear
# value  red green blue  strength
  0      0.3 0.6  0.8    0
  30     0.3 0.6  0.8    0.005
  90     0.5 0.8  0.9    0.12
  140    0.9 0.9  0.8    0
