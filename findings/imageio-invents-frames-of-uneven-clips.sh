#!/bin/sh
# imageio 2.38.1 with imageio-ffmpeg 0.8.1 (FFmpeg 9.0.2): reading an uneven clip gives more frames than it has.
#
# Behaviour: ten frames, two of them followed by a longer pause. The FFMPEG plug-in yields 17: pictures are repeated to
# fill an even grid of 30 a second; count_frames_and_secs of the same package says 10, as many as the pyav plug-in
# yields. (FFmpeg writes raw pictures at a constant rate unless told otherwise, and the plug-in does not tell it.)
# One would guess otherwise because iterating over a reader yields what is in the file, and the package counts ten.
# Whom it hurts: who measures motion between frames: repeated frames look like a camera at rest, and frame numbers
# no longer point at the rows of a list of times that was read from the file.
set -e
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check imageio==2.38.1 imageio-ffmpeg==0.8.1 av==18.1.0 numpy==2.4.6 pillow==13.0.0
"$work/venv/bin/python" - "$work" > "$work/seen.txt" <<'PYTHON'
import sys
from fractions import Fraction
import av
import imageio.v3 as imageio
import imageio_ffmpeg
import numpy as np

path = sys.argv[1] + "/clip.mp4"
with av.open(path, "w") as file:
    stream = file.add_stream("mpeg4", rate=30)
    stream.width, stream.height, stream.pix_fmt = 64, 64, "yuv420p"
    stream.codec_context.time_base = Fraction(1, 1000)
    for number, time in enumerate([0, 100, 133, 167, 200, 400, 433, 467, 500, 533]):
        frame = av.VideoFrame.from_ndarray(np.full((64, 64, 3), 20 * number, np.uint8), format="rgb24")
        frame.pts, frame.time_base = time, Fraction(1, 1000)
        file.mux(stream.encode(frame))
    file.mux(stream.encode())
print("count_frames_and_secs:", imageio_ffmpeg.count_frames_and_secs(path)[0])
for plugin in ("pyav", "FFMPEG"):
    frames = [round(float(frame.mean()) / 20) for frame in imageio.imiter(path, plugin=plugin)]
    print(f"{plugin}: {len(frames)} frames: {frames}")
PYTHON
sed -n 's/^#> //p' "$0" | diff - "$work/seen.txt"
cat "$work/seen.txt"

# Output seen (on a change, diff shows it and the script ends with 1):
#> count_frames_and_secs: 10
#> pyav: 10 frames: [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]
#> FFMPEG: 17 frames: [0, 0, 0, 1, 2, 3, 4, 4, 4, 4, 4, 4, 5, 6, 7, 8, 9]
