#!/bin/sh
# pyvips 3.2.0 with libvips 8.18.7: AVIF of 10 or 12 bits saved from 16 bits is cut off, not rounded, and loaded as other values.
#
# Behaviour: heifsave makes levels of 10 bits from 16 by dropping six bits: a picture becomes darker by half a level on
# average, and a grey just below a level falls to the one under it. Loaded again, a level is shifted back up with zeros below: white
# comes back as 65472 (12 bits: 65520), not as 65535, though nothing but the number of bits changed and lossless was asked for.
# One would guess otherwise because libvips rounds where it converts between formats, and its AVIF loader gives 16 bits on
# the scale of its other loaders, where white is 65535.
# Whom it hurts: who writes HDR stills (PQ has 1023 levels for all light there is, so that half of one is seen in dark
# gradients), and who compares pixels before and after, or takes 65535 for white.
set -e
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check pyvips==3.2.0 pyvips-binary==8.18.7 numpy==2.4.6
"$work/venv/bin/python" - "$work" > "$work/seen.txt" <<'PYTHON'
import sys
import numpy as np
import pyvips

ramp = np.linspace(0, 65535, 256 * 64).round().astype(np.uint16).reshape(64, 256)
picture = np.repeat(ramp[..., None], 3, axis=2)
for bits in (10, 12):
    path = f"{sys.argv[1]}/grey{bits}.avif"
    image = pyvips.Image.new_from_array(picture).copy(interpretation="rgb16")
    image.heifsave(path, bitdepth=bits, lossless=True, compression="av1")
    read = pyvips.Image.new_from_file(path).numpy()[..., 1].astype(np.int64)
    level = 65536 >> bits
    off = (read - ramp.astype(np.int64)) / level
    print(f"{bits} bits: off by {off.mean():.1f} levels on average, {off.min():.1f} to {off.max():.1f}; white is {read.max()}")
PYTHON
sed -n 's/^#> //p' "$0" | diff - "$work/seen.txt"
cat "$work/seen.txt"

# Output seen (on a change, diff shows it and the script ends with 1):
#> 10 bits: off by -0.5 levels on average, -1.0 to 0.0; white is 65472
#> 12 bits: off by -0.5 levels on average, -0.9 to 0.0; white is 65520
