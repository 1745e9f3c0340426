#!/bin/sh
# pyvips 3.2.0 with libvips 8.18.7: flipping a gain-map JPEG (Ultra HDR) flips the picture, not its gain map.
#
# Behaviour: a light of four times white on the left, a dim wall on the right. Loaded with uhdrload, flipped with fliphor and
# saved with uhdrsave, the file is a valid gain-map JPEG whose base picture is mirrored and whose gain map is not:
# where HDR is shown the light has lost its brightness and the wall opposite glows. On a screen without HDR
# nothing is to be seen.
# One would guess otherwise because the loader takes the map along unasked and the saver writes it unasked: one
# never meets it, and would think it turned along, made anew from the pixels, or left out.
# Whom it hurts: tools that flip or turn telephone photos through it and are tried on a screen without HDR.
set -e
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check pyvips==3.2.0 pyvips-binary==8.18.7 numpy==2.4.6
"$work/venv/bin/python" - "$work" > "$work/seen.txt" <<'PYTHON'
import sys
import numpy as np
import pyvips

made, flipped = sys.argv[1] + "/made.jpg", sys.argv[1] + "/flipped.jpg"
scene = np.full((128, 256, 3), 0.2, np.float32)  # scRGB: 1 is white
scene[:, :64] = 4
pyvips.Image.new_from_array(scene).copy(interpretation="scrgb").uhdrsave(made, Q=95)


def show(name, path):
    photo = pyvips.Image.uhdrload(path)
    base, light = photo.numpy(), photo.uhdr2scRGB().numpy()
    print(f"{name}: base {base[64, 16, 1]} and {base[64, 240, 1]}, HDR {light[64, 16, 1]:.1f} and {light[64, 240, 1]:.1f}")


pyvips.Image.uhdrload(made).fliphor().uhdrsave(flipped, Q=95)
show("left and right as made", made)
show("left and right flipped", flipped)
PYTHON
sed -n 's/^#> //p' "$0" | diff - "$work/seen.txt"
cat "$work/seen.txt"

# Output seen (on a change, diff shows it and the script ends with 1):
#> left and right as made: base 231 and 113, HDR 4.0 and 0.2
#> left and right flipped: base 113 and 231, HDR 0.8 and 1.0
