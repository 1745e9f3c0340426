#!/bin/sh
# pycolmap 4.2.1: its text model cannot hold the name of a picture that has a space in it.
#
# Behaviour: write_text writes "IMG 0001.jpg" whole, read_text of the same version gives back "IMG". Two pictures
# can so end up with one name, and no warning is printed. The binary model keeps the names.
# One would guess otherwise because the name is the last field of its line, where a reader can take the rest of
# the line, and because writer and reader are a pair in one library.
# Whom it hurts: who edits or converts a model as text when names hold spaces ("IMG 0001.jpg", "frame (2).png"):
# poses are then attached to no file, or several to the same.
set -e
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check pycolmap==4.2.1 numpy==2.4.6
"$work/venv/bin/python" - "$work" > "$work/seen.txt" <<'PYTHON'
import sys
import pycolmap

model = pycolmap.Reconstruction()
camera = pycolmap.Camera(camera_id=1, model="PINHOLE", width=640, height=480, params=[500, 500, 320, 240])
model.add_camera_with_trivial_rig(camera)
for number in (1, 2):
    image = pycolmap.Image(name=f"IMG {number:04d}.jpg", camera_id=1, image_id=number)
    model.add_image_with_trivial_frame(image, pycolmap.Rigid3d())
folder = sys.argv[1]
model.write_text(folder)
written = [line.rstrip() for line in open(folder + "/images.txt") if line.rstrip().endswith(".jpg")]
print("in the file:", [line.split(" ", 9)[9] for line in written])
text = pycolmap.Reconstruction()
text.read_text(folder)
print("read_text:", sorted(image.name for image in text.images.values()))
model.write_binary(folder)
binary = pycolmap.Reconstruction()
binary.read_binary(folder)
print("read_binary:", sorted(image.name for image in binary.images.values()))
PYTHON
sed -n 's/^#> //p' "$0" | diff - "$work/seen.txt"
cat "$work/seen.txt"

# Output seen (on a change, diff shows it and the script ends with 1):
#> in the file: ['IMG 0001.jpg', 'IMG 0002.jpg']
#> read_text: ['IMG', 'IMG']
#> read_binary: ['IMG 0001.jpg', 'IMG 0002.jpg']
