"""Jobs: what the worker processes do with photos and clips. No request, answer or server is known here.

The server knows these modules, too, since it names the jobs, but does none of them. What brings NumPy, OpenCV or PyAV
is therefore imported inside the functions: that saves 0.1 s of its start, and memory that it would never use. All else
is imported at the top.
"""
