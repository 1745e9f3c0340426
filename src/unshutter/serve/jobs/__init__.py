"""Jobs that worker processes run on photos and clips, independent of requests, responses and the server.

The server imports these modules, too, to submit jobs, but never runs one. Anything that pulls in NumPy, OpenCV or PyAV
is therefore imported inside functions, which saves the server 0.1 s at startup and memory that it would never use. All
other imports are at the top.
"""
