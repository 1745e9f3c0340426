"""The camera's pose at each row of the pictures of a 3D model, for programs that model rolling shutter."""
