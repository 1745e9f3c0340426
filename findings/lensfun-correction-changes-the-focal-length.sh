#!/bin/sh
# lensfunpy 1.18.0 with its own database: correcting distortion also changes the scale of the picture's centre.
#
# Behaviour: the size of the step from one corrected pixel to the next, in pixels of the photo, at the centre is
# 1.054 for a 28 mm prime and from .998 to 1.019 for others, with scale=1. (no scaling asked for). The four
# coefficients of the "ptlens" model are normed to add up to one, so what stays in place is the circle that
# touches the picture's longer sides, not the centre.
# One would guess otherwise because the models of OpenCV and COLMAP keep the centre: their distortion goes to zero
# with the radius, and the focal length stays what it was.
# Whom it hurts: who goes on to use the focal length of the EXIF block or of a calibration after this correction,
# as for turning a gyro's angles into pixels: 5 % wrong in the centre, without a sign.
set -e
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check lensfunpy==1.18.0 numpy==2.4.6
"$work/venv/bin/python" - "$work" > "$work/seen.txt" <<'PYTHON'
import lensfunpy

database = lensfunpy.Database()
camera = database.find_cameras("NIKON CORPORATION", "NIKON D3S")[0]
width, height = 4288, 2844
for name in ("Nikkor 28mm f/2.8D AF", "Nikkor 50mm f/1.8D", "24-70mm f/2.8E", "14-24mm"):
    lens = database.find_lenses(camera, "Nikon", name)[0]
    modifier = lensfunpy.Modifier(lens, camera.crop_factor, width, height)
    modifier.initialize(lens.min_focal, 8, 100, scale=1.0)
    source = modifier.apply_geometry_distortion()  # where in the photo each corrected pixel comes from
    x, y = width // 2, height // 2
    centre = (source[y, x + 100, 0] - source[y, x - 100, 0]) / 200
    top, bottom = source[0, x, 1], source[-1, x, 1]
    print(f"{lens.model}: centre {centre:.3f}, height {(bottom - top) / (height - 1):.3f}")
PYTHON
sed -n 's/^#> //p' "$0" | diff - "$work/seen.txt"
cat "$work/seen.txt"

# Output seen (on a change, diff shows it and the script ends with 1):
#> Nikon AF Nikkor 28mm f/2.8D 62: centre 1.054, height 1.000
#> Nikon AF Nikkor 50mm f/1.8D: centre 0.998, height 1.000
#> Nikon AF-S Nikkor 24-70mm f/2.8E ED VR 170: centre 1.019, height 1.000
#> Nikon AF-S Zoom-Nikkor 14-24mm f/2.8G ED 146: centre 1.013, height 1.000
