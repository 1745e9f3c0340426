#!/bin/sh
# PyAV 18.1.0 with its FFmpeg 8.1.2: an MP4 edit list that begins between two frames moves the whole clip.
#
# Behaviour: twelve frames at 30 a second, and an edit list that cuts the first 0, 20, 50 or 80 ms, as it is written
# when a clip is trimmed without encoding it again. After a cut of 20 ms frame 1 (at 33.3 ms of the media) belongs at 13.3 ms;
# it is given at 0. The frame that is on screen at the cut is dropped, and the next is moved to zero with all that
# follow: times are early by up to a frame. The option advanced_editlist=0 gives the true times, the cut
# frames among them with times below zero.
# One would guess otherwise because the list is exact to a tick of the media's clock, and because a reader that
# drops frames to honour the list would seem to keep the times of those that it shows.
# Whom it hurts: who joins frames with a gyro log by time after a trim: wrong by 13, 17 or 20 ms here, as
# much as the readout time of a rolling shutter, and by another amount in each trimmed clip.
set -e
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check av==18.1.0 numpy==2.4.6
"$work/venv/bin/python" - "$work" > "$work/seen.txt" <<'PYTHON'
import struct
import sys
import av
import numpy as np

path = sys.argv[1] + "/clip.mp4"
with av.open(path, "w") as file:
    stream = file.add_stream("mpeg4", rate=30)
    stream.width, stream.height, stream.pix_fmt, stream.gop_size = 64, 64, "yuv420p", 1
    for number in range(12):
        frame = av.VideoFrame.from_ndarray(np.full((64, 64, 3), 20 * number, np.uint8), format="rgb24")
        frame.pts = number
        file.mux(stream.encode(frame))
    file.mux(stream.encode())
data = bytearray(open(path, "rb").read())
entry = data.index(b"elst") + 12  # the only entry: duration [ms], start in the media [ticks of 1/15360 s]
for cut in (0, 20, 50, 80):
    struct.pack_into(">Ii", data, entry, 400 - cut, cut * 15360 // 1000)
    open(path, "wb").write(data)
    for options in ({}, {"advanced_editlist": "0"}):
        with av.open(path, options=options) as file:
            assert file.streams.video[0].time_base.denominator == 15360
            shown = [
                (round(float(frame.to_ndarray(format="rgb24").mean()) / 20), round(frame.time * 1000, 1))
                for frame in file.decode(video=0)
            ]
        print(f"cut {cut} ms{', ' + str(options) if options else ''}:", ", ".join([f"frame {n} at {t}" for n, t in shown if t >= 0][:3]))
PYTHON
sed -n 's/^#> //p' "$0" | diff - "$work/seen.txt"
cat "$work/seen.txt"

# Output seen (on a change, diff shows it and the script ends with 1):
#> cut 0 ms: frame 0 at 0.0, frame 1 at 33.3, frame 2 at 66.7
#> cut 0 ms, {'advanced_editlist': '0'}: frame 0 at 0.0, frame 1 at 33.3, frame 2 at 66.7
#> cut 20 ms: frame 1 at 0.0, frame 2 at 33.3, frame 3 at 66.7
#> cut 20 ms, {'advanced_editlist': '0'}: frame 1 at 13.3, frame 2 at 46.7, frame 3 at 80.0
#> cut 50 ms: frame 2 at 0.0, frame 3 at 33.3, frame 4 at 66.7
#> cut 50 ms, {'advanced_editlist': '0'}: frame 2 at 16.7, frame 3 at 50.0, frame 4 at 83.3
#> cut 80 ms: frame 3 at 0.0, frame 4 at 33.3, frame 5 at 66.7
#> cut 80 ms, {'advanced_editlist': '0'}: frame 3 at 20.1, frame 4 at 53.4, frame 5 at 86.7
