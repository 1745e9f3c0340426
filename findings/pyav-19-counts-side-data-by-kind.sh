#!/bin/sh
# PyAV 19.0.2: len() of a frame's side data is the number of kinds, while numbers up to that of all pieces are valid.
#
# Behaviour: the first frame of an HEVC stream by x265 has two user data messages (the encoder's settings), and
# with HDR10 a mastering display and light levels. len(frame.side_data) is 3, but frame.side_data[3] exists: it is the light level.
# A loop over range(len(...)), right in PyAV 18, where the same frame has the length 4, now misses the last
# piece without an error, and only in frames that have some kind twice: keyframes, usually.
# One would guess otherwise because an object that takes numbers has as many of them as its length says.
# Whom it hurts: tools that copy HDR metadata: the light levels, or HDR10+, of exactly those frames are lost from which players start.
set -e
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"${PYTHON:-python3}" -m venv "$work/venv" # of Python 3.12 or newer, as PyAV 19 asks for: PYTHON names it
"$work/venv/bin/pip" install --quiet --disable-pip-version-check av==19.0.2 numpy==2.4.6
"$work/venv/bin/python" - "$work/made.mp4" > "$work/seen.txt" <<'PYTHON'
import sys
import av
import numpy as np

params = "log-level=error:hdr10=1:max-cll=1000,400:master-display=G(8500,39850)B(6550,2300)R(35400,14600)WP(15635,16450)L(10000000,1)"
with av.open(sys.argv[1], "w") as out:
    stream = out.add_stream("libx265", rate=25, options={"x265-params": params, "preset": "ultrafast"})
    stream.width, stream.height, stream.pix_fmt = 128, 128, "yuv420p10le"
    for number in range(3):
        grey = np.full((128, 128, 3), 60 + 40 * number, np.uint8)
        out.mux(stream.encode(av.VideoFrame.from_ndarray(grey, format="rgb24")))
    out.mux(stream.encode(None))
with av.open(sys.argv[1]) as clip:
    for number, frame in enumerate(clip.decode(video=0)):
        pieces = []
        try:
            while True:
                pieces.append(frame.side_data[len(pieces)].type.name)
        except IndexError:
            pass
        if number < 2:
            print(f"frame {number}: length {len(frame.side_data)}, pieces {len(pieces)}, the last one {pieces[-1]}")
PYTHON
sed -n 's/^#> //p' "$0" | diff - "$work/seen.txt"
cat "$work/seen.txt"

# Output seen (on a change, diff shows it and the script ends with 1):
#> frame 0: length 3, pieces 4, the last one CONTENT_LIGHT_LEVEL
#> frame 1: length 3, pieces 3, the last one CONTENT_LIGHT_LEVEL
