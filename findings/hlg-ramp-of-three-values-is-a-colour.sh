#!/bin/sh
# colour-science 0.4.7: the HLG curve gives other values for three numbers than for the same numbers one by one.
#
# Behaviour: eotf_BT2100_HLG of .25, .5 and .75 as a list of three is 12.5, 50.0 and 158.9 cd/m2; each alone, or with
# a fourth beside them, 9.6, 50.7 and 203.2. A last axis of length three is taken as red, green and blue, whose common
# luminance sets the system gamma; any other shape is taken as greys. The PQ curve is the same either way.
# One would guess otherwise because a transfer function is applied number by number to an array of any shape, as the
# PQ curve beside it is.
# Whom it hurts: who samples the curve (a table with three knots, a grey picture three pixels wide, three patches):
# errors of 20 and 30 % that vanish as soon as one looks at the values singly.
set -e
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check colour-science==0.4.7 numpy==2.4.6 scipy==1.17.1 imageio==2.38.1 pillow==13.0.0
"$work/venv/bin/python" - "$work" > "$work/seen.txt" <<'PYTHON'
import warnings

warnings.simplefilter("ignore")
import numpy as np
from colour.models import eotf_BT2100_HLG, eotf_BT2100_PQ

values = [0.25, 0.5, 0.75]
for curve in (eotf_BT2100_HLG, eotf_BT2100_PQ):
    print(curve.__name__)
    print("  three:", curve(np.array(values)).round(1))
    print("  singly:", np.array([curve(value) for value in values]).round(1))
    print("  with a fourth:", curve(np.array([*values, 1.0]))[:3].round(1))
PYTHON
sed -n 's/^#> //p' "$0" | diff - "$work/seen.txt"
cat "$work/seen.txt"

# Output seen (on a change, diff shows it and the script ends with 1):
#> eotf_BT2100_HLG
#>   three: [  12.5   50.   158.9]
#>   singly: [   9.6   50.7  203.2]
#>   with a fourth: [   9.6   50.7  203.2]
#> eotf_BT2100_PQ
#>   three: [   5.2   92.2  983.4]
#>   singly: [   5.2   92.2  983.4]
#>   with a fourth: [   5.2   92.2  983.4]
