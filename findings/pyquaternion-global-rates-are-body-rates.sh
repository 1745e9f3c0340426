#!/bin/sh
# pyquaternion 0.9.9: integrate() and derivative() turn about the body's axes; their texts say the global ones.
#
# Behaviour: a camera that was rolled by 90 degrees about x turns by 90 degrees about z. By the docstrings ("about the
# global x, y and z axes") the result should be the turn times the start; it is the start times the turn.
# One would guess otherwise because both methods say so, in the same words, and because from the identity, where
# one tries such a thing first, the two are the same.
# Whom it hurts: who believes the text and turns the readings of a gyro into the global frame first: rates are then
# rotated twice. (Readings passed as they come from the gyro are integrated rightly.)
set -e
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check pyquaternion==0.9.9 numpy==2.4.6
"$work/venv/bin/python" - "$work" > "$work/seen.txt" <<'PYTHON'
import numpy as np
from pyquaternion import Quaternion

start = Quaternion(axis=[1, 0, 0], degrees=90)
turn = Quaternion(axis=[0, 0, 1], degrees=90)
found = Quaternion(start)
found.integrate([0, 0, np.pi / 2], 1)
rate = start.derivative([0, 0, 2])
spin = Quaternion(vector=[0, 0, 1])
print("integrate:", found.elements.round(3) + 0.0)
print("turn * start (global axes):", (turn * start).elements.round(3) + 0.0)
print("start * turn (body axes):  ", (start * turn).elements.round(3) + 0.0)
print("derivative:", rate.elements.round(3) + 0.0)
print("spin * start (global axes):", (spin * start).elements.round(3) + 0.0)
print("start * spin (body axes):  ", (start * spin).elements.round(3) + 0.0)
PYTHON
sed -n 's/^#> //p' "$0" | diff - "$work/seen.txt"
cat "$work/seen.txt"

# Output seen (on a change, diff shows it and the script ends with 1):
#> integrate: [ 0.5  0.5 -0.5  0.5]
#> turn * start (global axes): [0.5 0.5 0.5 0.5]
#> start * turn (body axes):   [ 0.5  0.5 -0.5  0.5]
#> derivative: [ 0.     0.    -0.707  0.707]
#> spin * start (global axes): [0.    0.    0.707 0.707]
#> start * spin (body axes):   [ 0.     0.    -0.707  0.707]
