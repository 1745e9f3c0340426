#!/bin/sh
# PyAV 18.1.0: the rate given to add_stream is a grid on which the times of all frames are snapped.
#
# Behaviour: frames with times of their own (pts with a time base of 1 ms) go into a stream with rate=30 and come
# out at exact multiples of 1/30 s. No error, no warning. With stream.codec_context.time_base set to 1/1000 as
# well, they come out as they were, to the tenth of a millisecond.
# One would guess otherwise because each frame carries its own pts and time base, MP4 stores a duration for each
# sample, and rate reads like the average that is written into the header.
# Whom it hurts: who re-encodes clips of telephones, whose frames are not evenly spaced: up to half a frame time
# of movement is in the wrong place, 17 ms, and a gyro log that fitted the original no longer fits the copy.
set -e
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check av==18.1.0 numpy==2.4.6
"$work/venv/bin/python" - "$work" > "$work/seen.txt" <<'PYTHON'
import sys
from fractions import Fraction
import av
import numpy as np

path = sys.argv[1] + "/clip.mp4"
times = [0, 31, 70, 98, 137, 171, 200, 229, 270, 300]  # ms
for base in (None, Fraction(1, 1000)):
    with av.open(path, "w") as file:
        stream = file.add_stream("mpeg4", rate=30)
        stream.width, stream.height, stream.pix_fmt = 64, 64, "yuv420p"
        if base:
            stream.codec_context.time_base = base
        for number, time in enumerate(times):
            frame = av.VideoFrame.from_ndarray(np.full((64, 64, 3), 20 * number, np.uint8), format="rgb24")
            frame.pts, frame.time_base = time, Fraction(1, 1000)
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
    with av.open(path) as file:
        print("time base", base or "not set", [round(frame.time * 1000, 1) for frame in file.decode(video=0)])
PYTHON
sed -n 's/^#> //p' "$0" | diff - "$work/seen.txt"
cat "$work/seen.txt"

# Output seen (on a change, diff shows it and the script ends with 1):
#> time base not set [0.0, 33.3, 66.7, 100.0, 133.3, 166.7, 200.0, 233.3, 266.7, 300.0]
#> time base 1/1000 [0.0, 31.0, 70.0, 98.0, 137.0, 171.0, 200.0, 229.0, 270.0, 300.0]
